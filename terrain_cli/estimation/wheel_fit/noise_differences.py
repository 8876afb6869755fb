"""Noise of the sensors from differences between neighbouring samples, scaled by the residuals of a fit.

For `comparison` and `diagnosis`, which whiten residuals by the part of them that is not smooth, so that
what a model misses does not pass for noise. For estimates with errors see `noise_likelihood`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.wheel_fit.channel_noise import CHANNELS, Noise, level

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from terrain_cli.estimation.line.moments import Bounds
    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.estimation.wheel_fit.linearised import Equations

    Array = NDArray[np.float64]

#: What is assumed of a channel of which nothing else is known.
USUAL = 0.03
#: Channels that pass through zero: their noise is no share of their value.
_ABSOLUTE = frozenset({"drawbar_pull"})
#: Median of the magnitude of a standard normal number.
_NORMAL_MEDIAN = 0.6745
#: Least noise of noise-free data, as a share.
_LEAST = 1e-6
#: Rounds at the most, and the change of the noise that is the last.
ROUNDS, _SETTLED = 12, 0.03


class ScaledDifferences:
    """Scales the noise until the residuals are as large as it says.

    The noise is one for all windows, as the sensors are. Of samples in time only the white part of
    the residuals counts: what is left of them follows from the model.
    """

    rounds, lasting = ROUNDS, 1.0
    #: Of all windows together, enough to know the noise by 2 %.
    samples = 6_000

    def __init__(self, data: FitData, *, ordered: bool) -> None:
        self._ordered = ordered
        self.noise = from_differences(data.channels, data.bounds) if ordered else assumed(data.channels)

    def begin(self, data: FitData) -> None:
        """Begin a round."""
        self._data, self._residual = data, np.zeros_like(data.measured)

    def add(self, block: NDArray[np.intp], _: FitData, found: Equations) -> None:
        """Keep the residuals of some windows."""
        bounds = self._data.bounds
        self._residual[:, bounds[block[0]] : bounds[block[-1] + 1]] = found.bounded

    def settled(self, misfit: float, dof: float, _: tuple[Array, Array, Array]) -> bool:
        """Change the noise, and tell whether it has settled."""
        variance = misfit / dof
        if self._ordered:
            variance = min(variance, _white(self._residual, self._data))
        finest = min((share for share in self.noise.relative.values() if share > 0.0), default=1.0)
        factor = max(float(np.sqrt(variance)), _LEAST / finest, 1e-3)
        self.noise = self.noise.scaled(factor)
        return abs(factor - 1.0) < _SETTLED or finest * factor <= 1.01 * _LEAST

    def others(self) -> tuple[Noise, ...]:
        """Return no other noise: it is taken for known."""
        return ()


def assumed(channels: Mapping[str, Array]) -> Noise:
    """Noise of steady test points, the same share in all, to be scaled by the residuals about the fit."""
    size = {name: level(channels[name]) for name in CHANNELS if name in channels}
    return Noise(
        {name: USUAL for name in size if name not in _ABSOLUTE},
        {name: USUAL * level for name, level in size.items() if name in _ABSOLUTE},
    )


def from_differences(channels: Mapping[str, Array], bounds: Bounds) -> Noise:
    """White part of each channel, from second differences within the windows.

    Samples are in their order in time, NaN where not measured. A true value that varies from sample to sample
    passes for noise here; the residuals of a fit tell by how much.
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
        usual = USUAL * (level(column) if size is None else 1.0)
        deviation = float(np.median(second)) / _NORMAL_MEDIAN if len(second) else usual
        (absolute if size is None else relative)[name] = deviation
    # One channel of which the file gives few digits, or a constant, is not without noise.
    return Noise({name: max(share, 1e-3) for name, share in relative.items()}, absolute)


def inner(bounds: Bounds) -> NDArray[np.bool_]:
    """Tell which of the samples 1 to n − 2 have a neighbour of their own window on either side."""
    n = int(bounds[-1])
    window = np.repeat(np.arange(len(bounds) - 1), np.diff(bounds))
    return np.asarray(window[2:] == window[:-2]) if n > 2 else np.zeros(0, dtype=bool)


def _white(residual: Array, data: FitData) -> float:
    """Return the variance of neighbours' differences in the residuals; infinite where there are none."""
    if residual.shape[1] < 3:
        return np.inf
    whole = np.asarray(data.seen.all(axis=0))
    neighbours = inner(data.bounds) & whole[1:-1]
    if neighbours.sum() < 10:
        return np.inf
    second = (residual[:, :-2] - 2.0 * residual[:, 1:-1] + residual[:, 2:])[:, neighbours]
    return float(np.mean(second**2) / 6.0)
