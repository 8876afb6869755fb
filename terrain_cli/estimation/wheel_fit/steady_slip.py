"""A slip that stays the same throughout a window: all that varies of what was measured is noise.

The true slip is sought sample by sample (`linearised`). Where it never varies the noise of its sensor stands
for variation that no force follows: torque seems not to depend on slip, so that k is near 0, with a small
error. It is the attenuation of a slope by noise of the regressor (Fuller 1987, Measurement Error Models,
section 1.1), where the regressor is nothing but noise.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum, window_products
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.vocabulary.arrays import Array, Bounds, Mask


#: Standard deviations beyond chance at which slip varies from more than noise, or a channel follows it.
_PLAIN = 3.0
#: Samples of a window that tell noise from soil.
EACH = 30
#: Added to correlations, so that of channels that are the same something is left.
_ROUNDING = 1e-9


def steadied(data: FitData) -> FitData:
    """Hold the slip at its mean in the windows in which it only seems to vary.

    There it changes from sample to sample as white noise does (the ratio of von Neumann 1941, Annals of
    Mathematical Statistics 12, 367), and no other channel follows it, given the rest of the inputs.
    """
    if "slip" not in data.inputs:
        return data
    slip, given = data.channels["slip"], {n: data.channels[n] for n in data.inputs if n != "slip"}
    outputs = {
        name: np.where(data.seen[row], data.measured[row], np.nan)
        for row, name in enumerate(data.outputs)
        if name != BALANCE
    }
    still = (data.count >= EACH) & _white(slip, data.bounds)
    for name, responds in {**given, **outputs}.items():
        others = [column for other, column in given.items() if other != name]
        still &= ~_follows(responds, slip, others, data.bounds)
    steady = np.repeat(still, data.count)
    mean = segment_sum(slip, data.bounds) / np.maximum(data.count, 1)
    held = np.where(steady, np.repeat(mean, data.count), slip)
    return replace(data, channels={**data.channels, "slip": held}, steady=steady)


def _white(column: Array, bounds: Bounds) -> Mask:
    """Tell in which windows neighbours are no more alike than chance has it, shape (w,)."""
    count = np.diff(bounds)
    mean = segment_sum(column, bounds) / np.maximum(count, 1)
    power = segment_sum((column - np.repeat(mean, count)) ** 2, bounds)
    step = np.zeros_like(column)
    step[1:] = np.diff(column) ** 2
    step[bounds[:-1][count > 0]] = 0.0
    steps = segment_sum(step, bounds)
    return np.asarray(steps > 2.0 * (1.0 - _PLAIN / np.sqrt(np.maximum(count, 1))) * power)


def _follows(channel: Array, column: Array, given: Sequence[Array], bounds: Bounds) -> Mask:
    """Tell in which windows a channel follows another one beyond chance, some others given, shape (w,)."""
    table = np.stack([np.ones_like(column), *given, column, channel])[None]
    known = np.asarray(np.isfinite(table[0]).all(axis=0))
    table = np.where(known, table, 0.0)
    products = window_products(table, table, bounds)
    size = np.sqrt(np.maximum(np.einsum("waa->wa", products), np.finfo(float).tiny))
    related = products / (size[:, :, None] * size[:, None, :])
    left = np.linalg.inv(related + _ROUNDING * np.eye(related.shape[1]))
    share = left[:, -1, -2] ** 2 / (left[:, -1, -1] * left[:, -2, -2])
    free = np.maximum(segment_sum(known.astype(float), bounds) - related.shape[1], 0.0)
    return np.asarray(free * share > _PLAIN**2 * (1.0 - share))
