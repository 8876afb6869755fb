"""Windows with what effects need of their samples; those of the same wheel in several inputs joined."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from formats import Labels
from terrain_cli.effects import Effect
from terrain_cli.errors import InputError
from terrain_cli.telemetry import Samples, effect_inputs, usable_samples
from terrain_cli.telemetry.long_logs import joined
from terrain_cli.windows.cut_windows import Windows

_PAUSE = 1000.0  # s between the end of an input and the start of the next


def with_channels(windows: Windows, effects: Sequence[Effect]) -> Windows:
    """Compute what effects use and is not there yet; samples without it are set aside, as reading does."""
    samples = windows.samples
    new = [effect for effect in effects if not samples.drivers.keys() >= {*effect.reads}]
    if not new:
        return windows
    lacks = effect_inputs.not_read(samples, new)
    if lacks:
        raise InputError(
            f"{samples}: {'; '.join(dict.fromkeys(lack.because for lack in lacks))}",
            hint="terrain-est inspect shows what each channel is read from",
        )
    found = effect_inputs.of_samples(samples, new)
    reasons = samples.set_aside
    for name, values in found.items():
        reasons = usable_samples.also_aside(reasons, f"no {name}", ~np.isfinite(values))
    kept = reasons.codes[windows.rows] < 0
    needed = {name for effect in new for name in effect.needs if effect_inputs.sources(name)}
    if not kept.any() or not found.keys() >= needed:
        raise InputError(f"{samples}: no sample has all that {', '.join(e.id for e in new)} needs")
    before = np.concatenate([[0], np.cumsum(kept)])
    known = replace(samples, drivers={**samples.drivers, **found}, set_aside=reasons)
    # A window of which nothing is left is none.
    return replace(windows.taken(kept, np.unique(before[windows.bounds])), samples=known)


def by_wheel(several: Sequence[Windows], effects: Iterable[Effect] = ()) -> list[Windows]:
    """Join inputs of the same wheel and geometry, tables of test points apart, with what effects need."""
    effects = list(effects)
    parts: dict[tuple[object, ...], list[Windows]] = {}
    for known in with_inputs(several, effects):
        parts.setdefault(which_wheel(known.samples), []).append(known)
    # Where the grousers stood as each input began shows only in all of them.
    turning = [effect for effect in effects if effect_inputs.ANGLE in effect.reads]
    return [_joined(some, turning) if len(some) > 1 else some[0] for some in parts.values()]


def which_wheel(samples: Samples) -> tuple[object, ...]:
    """Return what tells wheels apart, and tables of test points from drives."""
    return samples.wheel, samples.geometry, samples.time is None


def with_inputs(several: Sequence[Windows], effects: Sequence[Effect]) -> list[Windows]:
    """Compute what effects need of each input, as far as the channels allow."""
    found = []
    for windows in several:
        samples = windows.samples
        drivers = {**samples.drivers, **effect_inputs.of_samples(samples, effects)}
        found.append(replace(windows, samples=replace(samples, drivers=drivers)))
    return found


def _joined(parts: Sequence[Windows], turning: Sequence[Effect]) -> Windows:
    samples = [windows.samples for windows in parts]
    aside = [np.zeros(len(one), dtype=bool) if one.aside is None else one.aside for one in samples]
    whole = replace(
        joined(list(_in_turn(samples))),
        source=", ".join(dict.fromkeys(one.source for one in samples)),
        remarks=[remark for one in samples for remark in one.remarks],
        drive=None,
        aside=None if all(one.aside is None for one in samples) else np.concatenate(aside),
        total=None,
    )
    whole.drivers.update(effect_inputs.of_samples(whole, turning))
    starts = np.cumsum([0, *map(len, samples)])
    bounds = np.cumsum([0, *(len(windows.rows) for windows in parts)])
    rows = [windows.rows + at for windows, at in zip(parts, starts, strict=False)]
    inner = [windows.bounds[1:] + at for windows, at in zip(parts, bounds, strict=False)]
    x, y = (np.concatenate([getattr(windows, axis) for windows in parts]) for axis in ("x", "y"))
    return Windows(
        samples=whole,
        rows=np.concatenate(rows),
        bounds=np.concatenate([[0], *inner]).astype(np.intp),
        x=x,
        y=y,
        by_soil=all(windows.by_soil for windows in parts),
    )


def _in_turn(samples: Sequence[Samples]) -> Iterator[Samples]:
    """Let each input begin after the one before it has ended, whatever its clock says."""
    names = dict.fromkeys(["run", *(name for one in samples for name in one.labels)])
    measured = all(one.distance is not None for one in samples)
    end, stretch = 0.0, 0
    for number, one in enumerate(samples, 1):
        time = one.time
        if time is not None:
            known = time[np.isfinite(time)]
            time = time - (float(known.min()) if len(known) else 0.0) + end
            end = float(np.nanmax(time, initial=end)) + _PAUSE
        yield replace(
            one,
            time=time,
            labels=_labels(one, names, f"input {number}"),
            stretch=one.stretch + stretch,
            distance=one.distance if measured else None,
        )
        stretch += 1 + int(one.stretch.max(initial=-1))


def _labels(samples: Samples, names: Iterable[str], place: str) -> dict[str, Labels]:
    """Return all labels of an input: its runs are its own, and without any it is one."""
    found = {
        name: samples.labels.get(name, Labels(np.full(len(samples), -1, dtype=np.int32), ()))
        for name in names
    }
    runs = samples.labels.get("run")
    if runs is None:
        return found | {"run": Labels(np.zeros(len(samples), dtype=np.int32), (place,))}
    return found | {"run": Labels(runs.codes, tuple(f"{place} {run}" for run in runs.names))}
