"""Two models side by side on the same blocks."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from terrain_cli.comparison import blocks
from terrain_cli.comparison.blocks import Interval
from terrain_cli.comparison.comparison_outcome import UNITS, Comparison, Difference, Soils, segment_soils
from terrain_cli.vocabulary.arrays import Array, Mask


def against(first: Comparison, second: Comparison) -> list[Difference]:
    """Tell what a second model changes on the same windows: channels, then c (Pa) and φ (rad) by segment.

    Held-out errors are compared block by block (`root_intervals`). c and φ of a segment are compared with
    their standard errors as if these were independent, which is too careful: the data are the same.
    """
    names = both_predict(first, second)
    sums, _ = paired_sums(first, second, names)
    known = [(name, sums[:, column]) for column, name in enumerate(names) if sums[:, column, 2].any()]
    return [*(_error(*one) for one in known), *between_soils(paired_soils(first, second))]


def between_soils(pairs: Iterable[tuple[Soils, Soils]]) -> list[Difference]:
    """Tell how c and φ of every segment differ with a second model."""
    return [one for both in pairs for one in _soil(*both)]


def paired_soils(first: Comparison, second: Comparison) -> list[tuple[Soils, Soils]]:
    """Return the soils of each wheel with two models, on the segments of the one that needs more of them."""
    pairs = []
    for both in zip(segment_soils(first), segment_soils(second), strict=True):
        cut = max((soils.segments for soils in both), key=len)
        pairs.append((both[0].on(cut), both[1].on(cut)))
    return pairs


def both_predict(first: Comparison, second: Comparison) -> list[str]:
    return [name for name in UNITS if name in first.channels and name in second.channels]


def paired_sums(
    first: Comparison, second: Comparison, names: Sequence[str], judging: Iterable[Mask | bool] | None = None
) -> tuple[Array, float]:
    """Sum held-out squares of two models block by block, so that what makes a block hard for both cancels.

    Counted are the samples that both predict, of those that `judging`, one mask for each wheel, tells.
    Returned are the squares of the first and of the second and the number of samples, shape (blocks,
    channels, 3), and the share of the samples that the second does not predict any more.
    """
    count = 1 + max(int(wheel.blocks.max(initial=0)) for wheel in first.wheels)
    sums = np.zeros((count, len(names), 3))
    predicted = missing = 0
    masks: Iterable[Mask | bool] = judging or [True] * len(first.wheels)
    for a, b, judged in zip(first.wheels, second.wheels, masks, strict=True):
        for column, name in enumerate(names):
            if name not in a.series or name not in b.series:
                continue
            before, after = (one.series[name].measured - one.series[name].heldout for one in (a, b))
            there = np.isfinite(before) & judged
            known = there & np.isfinite(after)
            predicted += int(there.sum())
            missing += int(there.sum() - known.sum())
            for k, values in enumerate((before**2, after**2, np.ones(len(known)))):
                sums[:, column, k] += np.bincount(a.blocks[known], values[known], count)
    return sums[sums[..., 2].sum(axis=1) > 0.0], missing / predicted if predicted else 0.0


def root_intervals(sums: Array) -> tuple[Interval, Interval, Interval, float]:
    """Return the error of a channel before and after, its change, and the change's standard error.

    `sums`, shape (blocks, 3), are those of `paired_sums`. Each block is left out in turn, for both models at
    once; how much that moves a result gives its standard error (the jackknife), and Student's t its 95 %
    interval. So a few blocks can prove what is plain, and nothing else.
    """
    sums = sums[sums[:, 2] > 0.0]
    before, after = blocks.root_intervals(sums)
    others = blocks.logarithmic_roots(sums.sum(axis=0) - sums)
    changes = np.diff(np.exp(others), axis=1)[:, 0]
    change = blocks.jackknife(after.value - before.value, changes)
    return before, after, change, blocks.jackknife_error(changes)


def _error(name: str, sums: Array) -> Difference:
    before, after, change, se = root_intervals(sums)
    return Difference(
        name=name,
        unit=UNITS[name],
        where=None,
        first=before.value,
        second=after.value,
        low=change.low,
        high=change.high,
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
