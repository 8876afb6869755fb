"""Channels that a model and its effects read, without their own noise: from neighbours or conditions."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison import blocks, residual_noise, whitening
from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.vocabulary.arrays import Array, Index

#: Channels whose noise reaches the predictions, in the order in which the fit takes them.
NOISY = ("load", "sinkage", "slip")
#: What is interpolated: the speeds have the noise of the slip that is computed from them.
INTERPOLATED = (*NOISY, "velocity", "angular_velocity")
#: Ways in which a channel is interpolated for a fit: samples left out beside each, and samples averaged.
_WAYS = ((2, 3), (1, 2), (0, 1))
#: Share by which a channel grows with the load, over the load's own: sinkage by 1 / (n + ½) of an ordinary
#: soil, less on a hard layer, torque as friction does.
_ANSWERS = {"sinkage": 0.75, "torque": 1.0}
_MOST_SHARE = 1.5  # Most by which an interpolation is drawn out, as its neighbours flatten what changes fast
#: Samples left out on either side where channels are first interpolated from their neighbours.
GAPS = dict.fromkeys(INTERPOLATED, _WAYS[0][0])
#: Channels that are set beside slip and load where steady test points are run.
SET = ("slip_angle", "pitch", "roll", "pass_number")
#: Channels that change pull and torque in proportion, beside slip.
_CAUSES = ("load", "sinkage", "pitch", "acceleration")
#: Places between which pull and torque are straight in slip, at most; and samples for each.
_PLACES, _SAMPLES = 8, 40
#: Samples of a window that tell what to expect, and samples of which that is computed at a time.
_TELL, _SLAB = 4_000, 65_536


@dataclass(frozen=True)
class RecordedWheel:
    """The usable samples of a wheel as they were measured."""

    channels: dict[str, Array]  # shape (n,)
    window: Index  # shape (n,)
    group: Index | None  # shape (n,): samples of one are neighbours in time; None for steady test points

    def conditions(self, names: Sequence[str]) -> Array:
        """Return under what conditions test points were run, each in the unit of a large difference."""
        columns = []
        for name in (*names, *SET):
            column = self.channels.get(name, np.zeros(0))
            if np.isfinite(column).any():
                # A load or sinkage scatters by some percent where it was meant to be the same.
                size = float(np.nanmax(np.abs(column))) * criteria.LARGE_DIFFERENCE
                span = float(np.nanmax(column) - np.nanmin(column))
                span = span if name == "slip" else max(span, size)
                columns.append(column / span if span > 0.0 else np.zeros(len(column)))
        return np.stack(columns, axis=1) if columns else np.zeros((len(self.window), 1))


def inputs_known(channels: Mapping[str, Array]) -> NDArray[np.bool_]:
    """Tell which samples have all of load, sinkage and slip, as far as the channels do."""
    there = [np.isfinite(channels[name]) for name in NOISY if name in channels]
    return np.asarray(np.logical_and.reduce(there))


def without_noise(
    record: RecordedWheel, read: Mapping[str, Array], *, load_tells_sinkage: bool
) -> tuple[dict[str, Array], NDArray[np.bool_]]:
    """Return the channels from which to predict without their noise, and the samples of use.

    `read` has all channels as effects may read them, those of time series interpolated over `GAP`. Predicted
    from its own noisy sinkage a torque would be the less wrong the less a model makes of sinkage: where the
    load tells the sinkage, that is left out. Of no use are samples whose load or slip changes too fast to be
    interpolated.
    """
    use = np.ones(len(record.window), dtype=bool)
    channels = dict(read)
    if record.group is not None:
        for name in NOISY:
            if name not in channels:
                continue
            channels[name], known = _interpolated(record, record.group, name)
            use &= known | (name == "sinkage")
    elif "load" in channels:
        channels["load"] = _calibrated(record, "load", channels["load"])
    if load_tells_sinkage and "load" in channels:
        channels.pop("sinkage", None)
    return channels, use


def _interpolated(record: RecordedWheel, group: Index, name: str) -> tuple[Array, NDArray[np.bool_]]:
    """Return a channel from its neighbours, as far apart as its changes allow, and where that is right.

    Farther neighbours share less of the noise, nearer ones more of what changes; where even the
    nearest do not tell, the channel is taken as it was measured.
    """
    measured = record.channels[name]
    noise_of_it = float(np.sqrt(whitening.of_channels({name: measured}, group).covariance[0, 0]))
    for gap, reach in _WAYS:
        column = from_neighbours(measured, group, gap=gap, reach=reach)
        off = np.abs(measured - column)
        usual = float(np.nanmedian(off)) if np.isfinite(off).any() else 0.0
        # Own noise and that of the neighbours, as medians of normal deviates.
        if usual <= criteria.INTERPOLATION_OFF * 0.6745 * noise_of_it * np.sqrt(1.0 + 0.64 / reach):
            size = float(np.nanmax(np.abs(measured)))
            return _calibrated(record, name, column), off <= max(criteria.JUMP * usual, 1e-9 * size)
    return measured, np.ones(len(measured), dtype=bool)


def _calibrated(record: RecordedWheel, name: str, column: Array) -> Array:
    """Draw an interpolated channel to its mean by the share of noise that is left in it.

    Of a load that does not vary, all that an interpolation shows is noise: taken for true, the soil
    would be fitted to what it does not answer to (regression calibration, Carroll et al. 2006,
    Measurement Error in Nonlinear Models, chapter 4).
    """
    measured = record.channels[name]
    known = np.isfinite(column) & np.isfinite(measured)
    power = float(np.var(column[known])) if known.any() else 0.0
    if power == 0.0:
        return column
    middle = float(np.mean(column[known]))
    if record.group is None:
        others = [other for other in ("slip", "load") if other != name]
        off = measured - float(np.mean(measured[known]))
        level = float(np.nan_to_num(residual_noise.of_points(off, record.window, record.conditions(others))))
        told = float(np.var(measured[known])) - level**2
        if name == "load":
            # Test points at several loads look like repeated ones to whoever asks their slip alone.
            told = max(told, _felt(record))
        return np.asarray(middle + float(np.clip(told / power, 0.0, 1.0)) * (column - middle))
    # Neighbours share what is true of a sample, and none of its noise.
    share = float(np.mean((column[known] - middle) * (measured[known] - np.mean(measured[known])))) / power
    share = float(np.clip(share, 0.0, _MOST_SHARE))
    if name == "load" and share > 0.0:
        # Noise that lasts is shared too; but the wheel does not answer to it.
        felt = _felt(record) / (share**2 * power)
        share *= felt if felt < 0.5 else 1.0
    return np.asarray(middle + share * (column - middle))


def _felt(record: RecordedWheel) -> float:
    """Return the variance of the load, in N², that slip, sinkage or torque goes with: noise has no part."""
    return max(_answered(record, name, growth) for name, growth in _ANSWERS.items())


def _answered(record: RecordedWheel, name: str, growth: float) -> float:
    if name not in record.channels or "slip" not in record.channels:
        return 0.0
    load, answer, slip = (record.channels[one] for one in ("load", name, "slip"))
    known = np.isfinite(load) & np.isfinite(answer) & np.isfinite(slip)
    if known.sum() < (criteria.POINTS_OF_LOAD if record.group is None else criteria.NOISE_SAMPLES):
        return 0.0
    steady = np.stack([np.ones(int(known.sum())), slip[known], slip[known] ** 2], axis=1)
    own, other = (
        column[known] - steady @ np.linalg.lstsq(steady, column[known], rcond=None)[0]
        for column in (load, answer)
    )
    # Both are about 0: deviations would be 0, and their product is not, where rounding is all there is.
    size = float(np.sqrt(np.mean(own**2) * np.mean(other**2)))
    alike = float(np.mean(own * other)) / max(size, 1e-300)
    # Few points are alike by chance.
    if (
        record.group is None
        and alike * np.sqrt((known.sum() - 4.0) / max(1.0 - alike**2, 1e-12)) < criteria.ANSWERS_TO_LOAD
    ):
        return 0.0
    share = float(np.mean(own * other)) / max(abs(float(np.mean(answer[known]))), 1e-300)
    felt = share * float(np.mean(load[known])) / growth
    # Noise of the load cell does not follow slip: what does is true, as where hills shift the load.
    return float(np.var(load[known]) - np.var(own) + np.clip(felt, 0.0, np.var(own)))


def best_gaps(most: int, misfit: Callable[[Mapping[str, int]], Array]) -> dict[str, int]:
    """Choose how many samples of each channel are left out beside a sample where its neighbours tell it.

    Neighbours share noise that lasts; over too wide a gap what changes fast is lost. Taken is the widest of
    halved gaps, `most` at first, with which `misfit`, of parts of the samples, is as small as with the best.
    That is another one for a load that hardly varies than for a slip that changes fast.
    """
    halved = [most >> times for times in range(most.bit_length() + 1)]
    chosen = dict.fromkeys(INTERPOLATED, 0)
    for names in (
        (INTERPOLATED, ("load",), tuple(name for name in INTERPOLATED if name != "load")) if most else ()
    ):
        each = {gap: misfit({**chosen, **dict.fromkeys(names, gap)}) for gap in halved}
        least = min(each.values(), key=lambda parts: float(parts.sum()))
        good = criteria.AS_GOOD
        gap = next(g for g, parts in each.items() if (d := parts - least).sum() <= good * blocks.error(d))
        chosen.update(dict.fromkeys(names, gap))
    return chosen


def from_neighbours(values: Array, group: Index, *, gap: int, reach: int = 0) -> Array:
    """Interpolate each sample from its neighbours, itself and the nearest ones left out.

    As far as noise is forgotten within `gap` samples, the result has none of the sample's own. Means
    at distances g and 3 g on both sides weigh 9/16 and −1/16 each, which keeps a cubic; near the ends
    of a group only the nearer ones count, or those of one side.

    `gap` samples are left out on either side (0: only the sample itself), and `reach` averaged at each
    place, by default half as many, and three at least. Values, shape (n,), are NaN where not known, and the
    result where there is no neighbour. Samples of different groups are no neighbours; a group is contiguous.
    """
    n, reach = len(values), reach or max(3, gap // 2)
    if n == 0:
        return np.zeros(0)
    starts = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    lengths = np.diff(np.append(starts, n))
    first, last = np.repeat(starts, lengths), np.repeat(starts + lengths, lengths)
    known = np.isfinite(values)
    middle = float(np.mean(values[known])) if known.any() else 0.0
    # About the mean, so that running sums of long logs lose no digits.
    total = np.concatenate([[0.0], np.cumsum(np.where(known, values - middle, 0.0))])
    number = np.concatenate([[0], np.cumsum(known)])
    place = np.arange(n)

    def mean(low: Index, high: Index) -> Array:
        low, high = np.maximum(low, first), np.minimum(high, last)
        count = np.where(high > low, number[np.clip(high, 0, n)] - number[np.clip(low, 0, n)], 0)
        side = total[np.clip(high, 0, n)] - total[np.clip(low, 0, n)]
        return np.where(count > 0, side / np.maximum(count, 1), np.nan)

    def both(skip: int) -> tuple[Array, Array]:
        return mean(place - skip - reach, place - skip), mean(place + skip + 1, place + skip + 1 + reach)

    before, after = both(gap)
    # The middle of the nearer samples is gap + (reach + 1) / 2 away.
    farther = sum(both(3 * gap + reach + 1))
    near = 0.5 * (before + after)
    near = np.where(np.isfinite(near), near, np.where(np.isfinite(before), before, after))
    smooth = 1.125 * near - 0.0625 * farther
    inside = np.isfinite(before) & np.isfinite(after) & np.isfinite(smooth)
    return np.asarray(middle + np.where(inside, smooth, near))


def from_conditions(values: Array, channels: Mapping[str, Array], window: Index) -> Array:
    """Return what a channel is on average under the conditions of each sample, shape (n,).

    An effect may read what is to be explained: load-transfer the drawbar pull. Fed with the pull as it was
    measured, a model would predict the noise of a pull, or soil that varies, from themselves, and every such
    effect would seem to help. So it is given the part that slip, load, slope and acceleration explain
    (instrumental variables; Wooldridge 2010, Econometric Analysis of Cross Section and Panel Data, chapter
    5).

    `channels` are slip, and what else there is; each window has one soil. Values are NaN where not known;
    the result is NaN where slip is not known, or nothing is known of the window.
    """
    result = np.full(len(values), np.nan)
    if "slip" not in channels:
        return result
    slip = channels["slip"]
    # Where the load is known, sinkage follows from it.
    there = [name for name in _CAUSES if name in channels and not (name == "sinkage" and "load" in channels)]
    causes = [np.nan_to_num(channels[name]) for name in there]
    for label in range(int(window.max(initial=-1)) + 1):
        rows = np.flatnonzero((window == label) & np.isfinite(slip))
        known = rows[np.isfinite(values[rows])]
        if len(known) == 0:
            continue
        known = known[:: max(1, len(known) // _TELL)]
        count = int(np.clip(len(known) // _SAMPLES, 2, _PLACES))
        places = np.unique(np.quantile(slip[known], np.linspace(0.0, 1.0, count)))
        spans = [(float(np.mean(one[known])), float(np.std(one[known]))) for one in causes]
        varied = [(one, *span) for one, span in zip(causes, spans, strict=True) if span[1] > 0.0]
        found, *_ = np.linalg.lstsq(_table(slip, places, varied, known), values[known], rcond=1e-8)
        for start in range(0, len(rows), _SLAB):
            some = rows[start : start + _SLAB]
            result[some] = _table(slip, places, varied, some) @ found
    return result


def _table(slip: Array, places: Array, causes: Sequence[tuple[Array, float, float]], rows: Index) -> Array:
    """Return hats over slip, alone and times the first of the causes, and the causes."""
    hats = np.stack([np.interp(slip[rows], places, one) for one in np.eye(len(places))], axis=1)
    columns = [(one[rows] - middle) / deviation for one, middle, deviation in causes]
    crossed = [hats * columns[0][:, None]] if columns else []
    return np.concatenate([hats, *crossed, *(column[:, None] for column in columns[1:])], axis=1)
