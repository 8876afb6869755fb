"""Two models side by side on the same blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison.bootstrap import resample
from terrain_cli.comparison.comparison_outcome import UNITS, Difference

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from terrain_cli.comparison.comparison_outcome import Comparison, WheelComparison

    Array = NDArray[np.float64]


def against(first: Comparison, second: Comparison, *, seed: int = 0) -> list[Difference]:
    """Tell what a second model changes on the same data.

    Held-out errors are compared on the samples and blocks of the first, block by block, so that what
    makes a block hard for both does not count. c and φ of a segment are compared with their standard
    errors as if these were independent, which is too careful: the data are the same.

    Parameters
    ----------
    first, second : Comparison
        Of the same windows.

    Returns
    -------
    list of Difference
        Channels first, then c (Pa) and φ (rad) of every segment.
    """
    errors = [one for one in (_error(first, second, name, seed) for name in UNITS) if one is not None]
    soil = [
        difference for a, b in zip(first.wheels, second.wheels, strict=True) for difference in _soil(a, b)
    ]
    return [*errors, *soil]


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
    change = float(other - one)
    return Difference(
        name=name,
        unit=UNITS[name],
        where=None,
        first=float(one),
        second=float(other),
        difference=change,
        low=low,
        high=high,
        se=se,
        moved=abs(change) > criteria.MOVED * se,
    )


def _soil(a: WheelComparison, b: WheelComparison) -> Iterator[Difference]:
    """Compare the soil of each segment; where the second model has joined several, with the one of them."""
    fits = a.fit, b.fit
    columns = (
        ("c", "Pa", [(fit.values["cohesion"], fit.errors["cohesion"]) for fit in fits]),
        ("phi", "rad", [(fit.phi, fit.phi_se) for fit in fits]),
    )
    starts = a.windows.bounds[:-1]
    other = np.clip(np.searchsorted(b.windows.bounds, starts, side="right") - 1, 0, len(b.windows) - 1)
    for segment in range(len(a.windows)):
        place = int(other[segment])
        for name, unit, ((first, first_se), (second, second_se)) in columns:
            change = float(second[place] - first[segment])
            se = float(np.hypot(first_se[segment], second_se[place]))
            yield Difference(
                name=name,
                unit=unit,
                where=(a.source, a.wheel, segment + 1),
                first=float(first[segment]),
                second=float(second[place]),
                difference=change,
                low=change - 1.96 * se,
                high=change + 1.96 * se,
                se=se,
                moved=abs(change) > criteria.MOVED * se,
            )
