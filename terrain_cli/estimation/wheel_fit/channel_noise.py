"""Noise of the sensors: standard deviations by channel, given or learnt from the data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from terrain_cli.estimation.line.moments import Bounds

    Array = NDArray[np.float64]

#: Channels whose noise counts.
CHANNELS = ("load", "torque", "sinkage", "slip", "drawbar_pull")
#: No channel is taken for better than this share of its value.
FLOOR = 1e-7
#: What is assumed of a channel of which nothing else is known.
USUAL = 0.03
#: Channels that pass through zero: their noise is no share of their value.
_ABSOLUTE = frozenset({"drawbar_pull"})
#: Second differences beyond this many times the median one are steps or wild values.
_NORMAL_MEDIAN = 0.6745


@dataclass(frozen=True)
class Noise:
    """Standard deviations of independent errors: the root of (relative · value)² + absolute².

    Parameters
    ----------
    relative : mapping of str to float
        Channel → share of the value. A channel not named here nor in `absolute` is exact.
    absolute : mapping of str to float
        Channel → in the channel's SI unit.

    Raises
    ------
    UsageError
        Unknown channel, or a negative deviation.
    """

    relative: Mapping[str, float] = field(default_factory=dict)
    absolute: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, deviation in (*self.relative.items(), *self.absolute.items()):
            if name not in CHANNELS:
                raise UsageError(
                    f"no noise is known of a channel {name!r}", hint=f"one of {', '.join(CHANNELS)}"
                )
            if not 0.0 <= deviation < np.inf:
                raise UsageError(f"noise of {name}: {deviation!r} is no standard deviation")

    @classmethod
    def equal(cls, relative: float) -> Noise:
        """Return the same relative noise in every channel."""
        return cls(dict.fromkeys(CHANNELS, relative))

    def variance(self, channel: str, value: Array) -> Array:
        """Variance of a channel's error.

        Parameters
        ----------
        value : ndarray
            True values of the channel, SI unit.

        Returns
        -------
        ndarray
            In the unit squared.
        """
        share, constant = self.relative.get(channel, 0.0), self.absolute.get(channel, 0.0)
        return (share * value) ** 2 + constant**2

    def scaled(self, factor: float) -> Noise:
        """Return the same noise, larger or smaller in all channels."""
        return Noise(
            {name: factor * deviation for name, deviation in self.relative.items()},
            {name: factor * deviation for name, deviation in self.absolute.items()},
        )


def assumed(channels: Mapping[str, Array]) -> Noise:
    """Noise of steady test points, of which only the scatter about the fit tells: the same share in all.

    Parameters
    ----------
    channels : mapping of str to ndarray, shape (n,)
        Those measured.

    Returns
    -------
    Noise
        To be scaled by the residuals.
    """
    size = {name: _level(channels[name]) for name in CHANNELS if name in channels}
    return Noise(
        {name: USUAL for name in size if name not in _ABSOLUTE},
        {name: USUAL * level for name, level in size.items() if name in _ABSOLUTE},
    )


def from_differences(channels: Mapping[str, Array], bounds: Bounds) -> Noise:
    """White part of each channel, from second differences within the windows.

    A true value that varies from sample to sample passes for noise here; the residuals of a fit
    tell by how much.

    Parameters
    ----------
    channels : mapping of str to ndarray, shape (n,)
        Samples in their order in time; NaN where not measured.
    bounds : ndarray of int, shape (w + 1,)
    """
    relative: dict[str, float] = {}
    absolute: dict[str, float] = {}
    inside = inner(bounds)
    for name in CHANNELS:
        if name not in channels:
            continue
        column = channels[name]
        size = np.abs(column[1:-1][inside]) if name not in _ABSOLUTE else None
        second = np.abs(column[:-2] - 2.0 * column[1:-1] + column[2:])[inside] / np.sqrt(6.0)
        if size is not None:
            second = np.divide(second, size, out=np.full_like(second, np.nan), where=size > 0.0)
        second = second[np.isfinite(second)]
        usual = USUAL * (_level(column) if size is None else 1.0)
        deviation = float(np.median(second)) / _NORMAL_MEDIAN if len(second) else usual
        (absolute if size is None else relative)[name] = deviation
    # One channel of which the file gives few digits, or a constant, is not without noise.
    return Noise({name: max(share, 1e-3) for name, share in relative.items()}, absolute)


def inner(bounds: Bounds) -> NDArray[np.bool_]:
    """Tell which samples have a neighbour of their own window on either side.

    Parameters
    ----------
    bounds : ndarray of int, shape (w + 1,)

    Returns
    -------
    ndarray of bool, shape (max(n − 2, 0),)
        Of samples 1 to n − 2.
    """
    n = int(bounds[-1])
    window = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    return np.asarray(window[2:] == window[:-2]) if n > 2 else np.zeros(0, dtype=bool)


def _level(column: Array) -> float:
    known = column[np.isfinite(column)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 1.0
