"""Windows with what effects need of their samples; those of the same wheel in several inputs joined."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from formats import Labels
from terrain_cli.errors import InputError
from terrain_cli.telemetry import effect_inputs, usable_samples
from terrain_cli.telemetry.raw_columns import join_labels
from terrain_cli.telemetry.wheel_samples import joined_columns
from terrain_cli.windows.cut_windows import Windows

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from terrain_cli.effects import Effect
    from terrain_cli.telemetry import Samples
    from terrain_cli.vocabulary.arrays import Array, Mask

#: s between the end of an input and the start of the next.
_PAUSE = 1000.0


def with_channels(windows: Windows, effects: Sequence[Effect]) -> Windows:
    """Compute what effects use, where it is not there yet, of samples with every channel and further column.

    Samples in which it is not known are set aside, as reading with the model does. InputError where an effect
    needs what was not measured, or it is known in no sample.
    """
    samples = windows.samples
    new = [effect for effect in effects if not samples.drivers.keys() >= {*effect.reads}]
    if not new:
        return windows
    place = f"{samples.source}: wheel {samples.wheel}"
    lacks = effect_inputs.not_read(samples, new)
    if lacks:
        raise InputError(
            f"{place}: {'; '.join(dict.fromkeys(lack.because for lack in lacks))}",
            hint="terrain-est inspect shows what each channel is read from",
        )
    found = effect_inputs.of_samples(samples, new)
    reasons = samples.set_aside
    for name, values in found.items():
        reasons = usable_samples.also_aside(reasons, f"no {name}", ~np.isfinite(values))
    kept = reasons.codes[windows.rows] < 0
    needed = {name for effect in new for name in effect.needs if effect_inputs.sources(name)}
    if not kept.any() or not found.keys() >= needed:
        raise InputError(f"{place}: in no sample is all known that {', '.join(e.id for e in new)} needs")
    before = np.concatenate([[0], np.cumsum(kept)])
    known = replace(samples, drivers={**samples.drivers, **found}, set_aside=reasons)
    # A window of which nothing is left is none.
    return replace(windows.taken(kept, np.unique(before[windows.bounds])), samples=known)


def by_wheel(several: Sequence[Windows], effects: Iterable[Effect] = ()) -> list[Windows]:
    """Join what was measured, with every channel, of the same wheel in several inputs.

    One for each wheel and geometry, of which tables of test points and logs are kept apart; each input has
    runs of its own. What effects need is computed, as far as the channels allow.
    """
    effects = list(effects)
    parts: dict[tuple[object, ...], list[Windows]] = {}
    for known in with_inputs(several, effects):
        samples = known.samples
        parts.setdefault((samples.wheel, samples.geometry, samples.time is None), []).append(known)
    # Where the grousers stood as each input began shows only in all of them.
    turning = [effect for effect in effects if effect_inputs.ANGLE in effect.reads]
    return [_joined(some, turning) if len(some) > 1 else some[0] for some in parts.values()]


def with_inputs(several: Sequence[Windows], effects: Sequence[Effect]) -> list[Windows]:
    """Compute what effects need of each input, as far as the channels allow."""
    return [
        replace(
            windows,
            samples=replace(
                windows.samples,
                drivers={**windows.samples.drivers, **effect_inputs.of_samples(windows.samples, effects)},
            ),
        )
        for windows in several
    ]


def _joined(parts: Sequence[Windows], turning: Sequence[Effect]) -> Windows:
    samples = [windows.samples for windows in parts]
    sizes = [len(one) for one in samples]
    starts = np.concatenate([[0], np.cumsum(sizes)])
    stretches = np.concatenate([[0], np.cumsum([1 + int(one.stretch.max(initial=-1)) for one in samples])])
    bounds = np.concatenate([[0], np.cumsum([len(windows.rows) for windows in parts])])
    first = samples[0]
    joined = replace(
        first,
        source=", ".join(dict.fromkeys(one.source for one in samples)),
        time=_times(samples),
        channels=joined_columns(samples, lambda one: one.channels),
        labels=_labels(samples),
        drive=None,
        aside=None if all(one.aside is None for one in samples) else np.concatenate([*map(_aside, samples)]),
        total=None,
        stretch=np.concatenate([one.stretch + at for one, at in zip(samples, stretches, strict=False)]),
        distance=None
        if any(one.distance is None for one in samples)
        else np.concatenate([one.distance for one in samples if one.distance is not None]),
        set_aside=join_labels([one.set_aside for one in samples]),
        remarks=[remark for one in samples for remark in one.remarks],
        drivers=joined_columns(samples, lambda one: one.drivers),
    )
    joined.drivers.update(effect_inputs.of_samples(joined, turning))
    return Windows(
        joined,
        np.concatenate([windows.rows + at for windows, at in zip(parts, starts, strict=False)]),
        np.concatenate(
            [[0], *(windows.bounds[1:] + at for windows, at in zip(parts, bounds, strict=False))]
        ).astype(np.intp),
        np.concatenate([windows.x for windows in parts]),
        np.concatenate([windows.y for windows in parts]),
    )


def _aside(samples: Samples) -> Mask:
    return np.zeros(len(samples), dtype=bool) if samples.aside is None else samples.aside


def _times(samples: Sequence[Samples]) -> Array | None:
    """Let each input begin after the one before it has ended, whatever its clock says."""
    parts, end = [], 0.0
    for one in samples:
        if one.time is None:
            return None
        known = one.time[np.isfinite(one.time)]
        start = float(known.min()) if len(known) else 0.0
        moved = one.time - start + end
        parts.append(moved)
        end = float(np.nanmax(moved, initial=end)) + _PAUSE
    return np.concatenate(parts)


def _labels(samples: Sequence[Samples]) -> dict[str, Labels]:
    """Join the labels; runs of different inputs are different, and an input without them is one."""
    found = {}
    for name in dict.fromkeys(["run", *(name for one in samples for name in one.labels)]):
        parts = []
        for number, one in enumerate(samples):
            own = one.labels.get(name)
            if name == "run" and own is None:
                parts.append(Labels(np.zeros(len(one), dtype=np.int32), (f"input {number + 1}",)))
            elif own is None:
                parts.append(Labels(np.full(len(one), -1, dtype=np.int32), ()))
            elif name == "run":
                parts.append(Labels(own.codes, tuple(f"input {number + 1} {run}" for run in own.names)))
            else:
                parts.append(own)
        found[name] = join_labels(parts)
    return found
