"""Two models on blocks that neither was fitted to: by how much their errors differ."""

from collections.abc import Iterator

import numpy as np

from terrain_cli.comparison import Comparison, kept_aside
from terrain_cli.comparison.blocks import Interval, exponential, jackknife, logarithmic_roots
from terrain_cli.comparison.comparison_outcome import UNITS
from terrain_cli.comparison.two_models import both_predict, paired_sums, root_intervals
from terrain_cli.improvement.improvement_outcome import ChannelChange, HeldOutEvidence
from terrain_cli.vocabulary.arrays import Array, Mask

_UNKNOWN = Interval(np.nan, np.nan, np.nan)


def weigh(
    first: Comparison, second: Comparison, own: Comparison | None = None
) -> tuple[list[ChannelChange], HeldOutEvidence]:
    """Tell by how much held-out errors differ: of every channel (`root_intervals`), and of all together.

    Counted are the samples that both models predict, and where some are kept aside only those. `own` is the
    second model on blocks of its own, if those are others: they tell its noise beside where it fails.

    Channels have different units, and one may miss by far more than its noise. So what is said of all
    together is the mean of the logarithms of the ratios of their errors, each weighted by its samples: the
    likelihood of held-out data where the size of each channel's error is not known beforehand. A channel that
    goes the other way than they do counts as unchanged where its greater error is noise: the better soil may
    pass more of the noise of slip, load and sinkage on, as a hard layer does that of the sinkage.

    Another base reads other channels, and their noise is in what it predicts. So its errors are counted with
    the noise that reaches the first: what is compared is what a model could have known. A channel that only
    one of them predicts has no difference.
    """
    own = second if own is None else own
    names = both_predict(first, second)
    sums, lost = paired_sums(first, second, names, _judging(first))
    if _other_base(first, second):
        for column, name in enumerate(names):
            more = first.channels[name].noise ** 2 - own.channels[name].noise ** 2
            sums[:, column, 1] += sums[:, column, 2] * (more if np.isfinite(more) else 0.0)
    overall = _overall(sums)
    # Where a model misses, its misfit is in what passes for noise.
    better = (first, own) if overall.value > 1.0 or _other_base(first, second) else (own, first)
    channels = []
    for name in UNITS:
        levels = [one.channels[name].noise for one in better if name in one.channels]
        noise = next((level for level in levels if np.isfinite(level)), np.nan)
        if not levels:
            continue
        place = names.index(name) if name in names else None
        if place is None:
            before, after, change = held_out_error(first, name), held_out_error(second, name), _UNKNOWN
        else:
            before, after, change, _ = root_intervals(sums[:, place])
        channels.append(
            ChannelChange(
                name=name, unit=UNITS[name], before=before, after=after, noise=noise, difference=change
            )
        )
        other_way = (change.value > 0.0) != (overall.value > 1.0)
        if place is not None and other_way and not channels[-1].misses:
            sums[:, place, 1] = sums[:, place, 0]
    overall = _overall(sums)
    aside = 0 if _every(first) else sum(int(one.sum()) for one in _judging(first))
    short = kept_aside.too_short(wheel.windows.samples for wheel in first.wheels)
    return channels, HeldOutEvidence(overall, len(sums), lost, aside, short)


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


def _overall(sums: Array) -> Interval:
    """Return the ratio of the errors of all channels, after to before, with its interval."""
    total = sums.sum(axis=0)
    return exponential(jackknife(_logarithm(total[None])[0], _logarithm(total - sums)))


def _logarithm(sums: Array) -> Array:
    """Return the logarithm of the error of all channels after over that before, shape (any,)."""
    ratios = np.nan_to_num(np.diff(logarithmic_roots(sums), axis=-1)[..., 0])
    n = sums[..., 2]
    return np.asarray((ratios * n).sum(axis=1) / np.maximum(n.sum(axis=1), 1.0))


def held_out_error(comparison: Comparison, name: str) -> Interval:
    """Return the held-out error of a channel as `compare` has it; NaN where the model does not predict it."""
    errors = comparison.channels.get(name)
    return Interval(errors.heldout_rmse, errors.heldout_low, errors.heldout_high) if errors else _UNKNOWN
