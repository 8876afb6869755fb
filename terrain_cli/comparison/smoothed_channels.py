"""The input channels of a wheel's model, smoothed so that they are without their own noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison import residual_noise, whitening
from terrain_cli.comparison.neighbours import from_neighbours

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from numpy.typing import NDArray

    from terrain_cli.vocabulary.arrays import Array, Index


#: Channels whose noise reaches the predictions, in the order in which the fit takes them.
NOISY = ("load", "sinkage", "slip")
#: Ways in which a channel is interpolated for a fit: samples left out beside each, and samples averaged.
_WAYS = ((2, 3), (1, 2), (0, 1))
#: Share by which a channel grows with the load, over the load's own: sinkage by 1 / (n + ½) of an ordinary
#: soil, less on a hard layer, torque as friction does.
_ANSWERS = {"sinkage": 0.75, "torque": 1.0}
#: Most by which an interpolation is drawn out, as its neighbours flatten what changes fast.
_MOST_SHARE = 1.5


#: Samples left out on either side where channels are first interpolated from their neighbours.
GAP = _WAYS[0][0]


@dataclass(frozen=True)
class RecordedWheel:
    """The usable samples of a wheel as they were measured."""

    channels: dict[str, Array]  # shape (n,)
    window: Index  # shape (n,)
    group: Index | None  # shape (n,): samples of one are neighbours in time; None for steady test points

    def conditions(self, names: Sequence[str]) -> Array:
        """Return under what conditions test points were run, each in the unit of a large difference."""
        columns = []
        for name in names:
            if name in self.channels:
                column = self.channels[name]
                # A load or sinkage scatters by some percent where it was meant to be the same.
                size = float(np.nanmax(np.abs(column))) * criteria.LARGE_DIFFERENCE
                span = float(np.nanmax(column) - np.nanmin(column))
                span = span if name == "slip" else max(span, size)
                columns.append(column / span if span > 0.0 else np.zeros(len(column)))
        return np.stack(columns, axis=1) if columns else np.zeros((len(self.window), 1))


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
    """Return the variance of the load, in N², that sinkage or torque answers to: noise has no part."""
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
    return float(np.clip(felt, 0.0, np.var(own)))
