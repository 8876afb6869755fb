"""Two models on blocks that neither was fitted to: by how much their errors differ."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.comparison import Comparison, distributions, kept_aside
from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.improvement.improvement_outcome import ChannelChange, HeldOutEvidence, Interval

if TYPE_CHECKING:
    from collections.abc import Iterator

    from terrain_cli.vocabulary.arrays import Array, Mask

#: Keeps the logarithm of an error of 0 finite.
_TINY = 1e-300
_UNKNOWN = Interval(np.nan, np.nan, np.nan)


def weigh(first: Comparison, second: Comparison) -> tuple[list[ChannelChange], HeldOutEvidence]:
    """Tell by how much held-out errors differ: of every channel, and of all together.

    Counted are the samples that both models predict, and where some are kept aside only those. Each block is
    left out in turn, for both models and all channels at once, so that what makes a block hard for both does
    not count; how much that moves a result gives its standard error (the jackknife), and Student's t its 95 %
    interval. So a few blocks can prove what is plain, and nothing else.

    Channels have different units, and one may miss by far more than its noise. So what is said of all
    together is the mean of the logarithms of the ratios of their errors, each weighted by its samples: the
    likelihood of held-out data where the size of each channel's error is not known beforehand.

    Another base reads other channels, and their noise is in what it predicts. So its errors are counted with
    the noise that reaches the first: what is compared is what a model could have known. A channel that only
    one of them predicts has no difference.
    """
    names = [name for name in UNITS if name in first.channels and name in second.channels]
    sums, lost = _sums(first, second, names)
    total = sums.sum(axis=0)
    without = total - sums
    roots, others = np.log(_roots(total[None])[0]), np.log(_roots(without))
    overall = _exp(_interval(_logarithm(total[None])[0], _logarithm(without)))
    # Where a model misses, its misfit is in what passes for noise.
    better = (first, second) if overall.value > 1.0 or _other_base(first, second) else (second, first)
    channels = []
    for name in UNITS:
        levels = [one.channels[name].noise for one in better if name in one.channels]
        noise = next((level for level in levels if np.isfinite(level)), np.nan)
        if name in names:
            column = names.index(name)
            before, after = (_exp(_interval(roots[column, k], others[:, column, k])) for k in (0, 1))
            change = _interval(_change(roots[column]), _change(others[:, column]))
        elif levels:
            before, after, change = _alone(first, name), _alone(second, name), _UNKNOWN
        else:
            continue
        channels.append(
            ChannelChange(
                name=name, unit=UNITS[name], before=before, after=after, noise=noise, difference=change
            )
        )
    aside = 0 if _every(first) else sum(int(one.sum()) for one in _judging(first))
    short = kept_aside.too_short(wheel.windows.samples for wheel in first.wheels)
    return channels, HeldOutEvidence(overall, len(sums), lost, aside, short)


def _sums(first: Comparison, second: Comparison, names: list[str]) -> tuple[Array, float]:
    """Sum squares before, after, and samples, (blocks, channels, 3); and the share not predicted any more."""
    count = 1 + max(int(wheel.blocks.max(initial=0)) for wheel in first.wheels)
    sums = np.zeros((count, len(names), 3))
    predicted = missing = 0
    for a, b, judged in zip(first.wheels, second.wheels, _judging(first), strict=True):
        for column, name in enumerate(names):
            if name not in a.series or name not in b.series:
                continue
            before, after = (one.series[name].measured - one.series[name].heldout for one in (a, b))
            there = np.isfinite(before) & judged
            known = there & np.isfinite(after)
            predicted += int(there.sum())
            missing += int(there.sum() - known.sum())
            more = first.channels[name].noise ** 2 - second.channels[name].noise ** 2
            # By so much more noise is in squares of the first, where bases differ.
            noise = more if _other_base(first, second) and np.isfinite(more) else 0.0
            squares = before**2, after**2 + noise, np.ones(len(known))
            for k, values in enumerate(squares):
                sums[:, column, k] += np.bincount(a.blocks[known], values[known], count)
    return sums[sums[..., 2].sum(axis=1) > 0.0], missing / predicted if predicted else 0.0


def _every(comparison: Comparison) -> bool:
    return all(wheel.windows.samples.aside is None for wheel in comparison.wheels)


def _judging(comparison: Comparison) -> Iterator[Mask]:
    """Yield the samples of each wheel on which a change is judged: those kept aside, if any are."""
    every = _every(comparison)
    for wheel in comparison.wheels:
        aside = wheel.windows.samples.aside
        yield np.full(len(wheel.blocks), every) if aside is None else aside[wheel.windows.rows]


def _other_base(first: Comparison, second: Comparison) -> bool:
    return first.wheels[0].model.base != second.wheels[0].model.base


def _roots(sums: Array) -> Array:
    """Return root mean squares before and after, shape (any, channels, 2)."""
    n = sums[..., 2:]
    squares = np.maximum(sums[..., :2], _TINY)
    return np.sqrt(np.divide(squares, n, out=np.full_like(squares, np.nan), where=n > 0.0))


def _change(logarithms: Array) -> Array:
    return np.asarray(np.exp(logarithms[..., 1]) - np.exp(logarithms[..., 0]))


def _logarithm(sums: Array) -> Array:
    """Return the logarithm of the error of all channels after over that before, shape (any,)."""
    logarithms = np.log(np.maximum(sums[..., :2], _TINY))
    n = sums[..., 2]
    halves = 0.5 * (logarithms[..., 1] - logarithms[..., 0]) * n
    return np.asarray(halves.sum(axis=1) / np.maximum(n.sum(axis=1), 1.0))


def _interval(value: Any, without: Array) -> Interval:
    """Return a value with its 95 % interval, from what it is without each block."""
    n = len(without)
    if n < 2:
        return Interval(float(value), np.nan, np.nan)
    se = float(np.sqrt((n - 1.0) / n * np.sum((without - without.mean()) ** 2)))
    reach = distributions.student_quantile(0.025, n - 1.0) * se
    return Interval(float(value), float(value) - reach, float(value) + reach)


def _exp(interval: Interval) -> Interval:
    return Interval(*(float(np.exp(value)) for value in interval))


def _alone(comparison: Comparison, name: str) -> Interval:
    errors = comparison.channels.get(name)
    return Interval(errors.heldout_rmse, errors.heldout_low, errors.heldout_high) if errors else _UNKNOWN
