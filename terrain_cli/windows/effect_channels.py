"""What the effects of a model use, in windows of samples that were read without that model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.errors import InputError
from terrain_cli.telemetry.derive import effect_inputs, usable_samples
from terrain_cli.windows.cut_windows import Windows

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.effects import Effect


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
    return Windows(
        replace(samples, drivers={**samples.drivers, **found}, set_aside=reasons),
        windows.rows[kept],
        # A window of which nothing is left is none.
        np.unique(before[windows.bounds]),
        windows.x[kept],
        windows.y[kept],
    )
