"""Two models side by side on the same blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison.blocks import resample
from terrain_cli.comparison.comparison_outcome import UNITS, Difference, segment_soils

if TYPE_CHECKING:
    from collections.abc import Iterator

    from terrain_cli.comparison.comparison_outcome import Comparison, Soils
    from terrain_cli.vocabulary.arrays import Array


def against(first: Comparison, second: Comparison, *, seed: int = 0) -> list[Difference]:
    """Tell what a second model changes on the same windows: channels, then c (Pa) and φ (rad) by segment.

    Held-out errors are compared on the samples and blocks of the first, block by block, so that what makes a
    block hard for both does not count. c and φ of a segment are compared with their standard errors as if
    these were independent, which is too careful: the data are the same.
    """
    errors = [one for one in (_error(first, second, name, seed) for name in UNITS) if one is not None]
    return [*errors, *between_soils(first, second)]


def between_soils(first: Comparison, second: Comparison) -> list[Difference]:
    """Tell how c and φ of every segment differ with a second model."""
    both = zip(segment_soils(first), segment_soils(second), strict=True)
    return [difference for one, other in both for difference in _soil(one, other)]


def _error(first: Comparison, second: Comparison, name: str, seed: int) -> Difference | None:
    if name not in first.channels or name not in second.channels:
        return None
    count = 1 + max(int(wheel.blocks.max(initial=0)) for wheel in first.wheels)
    sums = np.zeros((count, 3))
    for a, b in zip(first.wheels, second.wheels, strict=True):
        if name not in a.series or name not in b.series:
            continue
        errors = [one.series[name].measured - one.series[name].heldout for one in (a, b)]
        known = np.isfinite(errors[0]) & np.isfinite(errors[1])
        for column, error in enumerate(errors):
            sums[:, column] += np.bincount(a.blocks[known], error[known] ** 2, count)
        sums[:, 2] += np.bincount(a.blocks[known], minlength=count)
    sums = sums[sums[:, 2] > 0.0]
    if len(sums) == 0:
        return None

    def both(drawn: Array) -> Array:
        return np.sqrt(drawn[:, :2] / np.maximum(drawn[:, 2:], 1.0))

    one, other = both(sums.sum(axis=0)[None])[0]
    se = low = high = np.nan
    if len(sums) > 1:
        draws = resample(sums, lambda drawn: np.diff(both(drawn), axis=1)[:, 0], seed=seed)
        low, high = (float(v) for v in np.quantile(draws, [0.025, 0.975]))
        se = float(np.std(draws))
    return Difference(
        name=name,
        unit=UNITS[name],
        where=None,
        first=float(one),
        second=float(other),
        low=low,
        high=high,
        se=se,
    )


def _soil(one: Soils, other: Soils) -> Iterator[Difference]:
    samples, estimates = one.segments.samples, (one.estimates, other.estimates)
    columns = (
        ("c", "Pa", [(of.c, of.c_se) for of in estimates]),
        ("phi", "rad", [(of.phi, of.phi_se) for of in estimates]),
    )
    for segment in range(len(one.segments)):
        for name, unit, ((first, first_se), (second, second_se)) in columns:
            change = float(second[segment] - first[segment])
            se = float(np.hypot(first_se[segment], second_se[segment]))
            yield Difference(
                name=name,
                unit=unit,
                where=(samples.source, samples.wheel, segment + 1),
                first=float(first[segment]),
                second=float(second[segment]),
                low=change - 1.96 * se,
                high=change + 1.96 * se,
                se=se,
            )
