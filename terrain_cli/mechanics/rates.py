"""Rates of change of channels, and the angle that the wheel has turned, for the effects that need them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

#: Neighbours on either side among which is chosen, and samples that are enough to choose by.
_REACHES = (2, 4, 8, 16, 32)
_TELLING = 20_000


def rate(time: ArrayLike, stretch: ArrayLike, values: ArrayLike, *, reach: int | None = None) -> Array:
    """Differentiate a channel by time: the slope of a line through each sample and its neighbours.

    Parameters
    ----------
    time : array_like, shape (n,)
        In s, rising within a stretch.
    stretch : array_like of int, shape (n,)
        Samples of different stretches are no neighbours.
    values : array_like, shape (n,)
    reach : int, optional
        Neighbours on either side; fewer at the ends of a stretch. If not given, as many as let the
        line predict best the samples that it passes (leave-one-out): the noisier the channel, the more.

    Returns
    -------
    ndarray, shape (n,)
        In the channel's unit per s; NaN where a stretch has a single sample.
    """
    time, values = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    stretch = np.asarray(stretch)
    if reach is None:
        some = slice(0, _TELLING)
        errors = [_left_out(_sums(time[some], stretch[some], values[some], near)) for near in _REACHES]
        reach = _REACHES[int(np.argmin(errors))]
    count, st, sv, stt, stv = _sums(time, stretch, values, reach)
    spread = count * stt - st * st
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(spread > 0.0, (count * stv - st * sv) / spread, np.nan))


def _sums(time: Array, stretch: NDArray[np.intp], values: Array, reach: int) -> Array:
    """Return number of neighbours and Σ t, Σ v, Σ t², Σ t v about each sample, so that nothing cancels."""
    n = len(time)
    sums = np.zeros((5, n))
    for shift in range(-reach, reach + 1):
        own = np.arange(max(0, -shift), min(n, n - shift))
        own = own[stretch[own] == stretch[own + shift]]
        dt, dv = time[own + shift] - time[own], values[own + shift] - values[own]
        known = np.isfinite(dv)
        own, dt, dv = own[known], dt[known], dv[known]
        sums[:, own] += (np.ones_like(dt), dt, dv, dt * dt, dt * dv)
    return sums


def _left_out(sums: Array) -> float:
    """Return the mean square by which lines through the neighbours alone miss the samples."""
    count, st, sv, stt, stv = sums
    spread = count * stt - st * st
    enough = (count >= 4.0) & (spread > 0.0)
    if not enough.any():
        return np.inf
    count, st, sv, stt, stv, spread = (part[enough] for part in (*sums, spread))
    level, leverage = (stt * sv - st * stv) / spread, stt / spread
    return float(np.mean((level / (1.0 - leverage)) ** 2))


def wheel_angle(time: ArrayLike, stretch: ArrayLike, angular_velocity: ArrayLike) -> Array:
    """Integrate the angle (rad) that the wheel turned since its stretch began, by the trapezoidal rule."""
    time, omega = np.asarray(time, dtype=float), np.asarray(angular_velocity, dtype=float)
    stretch = np.asarray(stretch)
    if len(time) == 0:
        return np.zeros(0)
    follows = stretch[1:] == stretch[:-1]
    turned = np.where(follows, 0.5 * (omega[1:] + omega[:-1]) * np.diff(time), 0.0)
    total = np.concatenate([[0.0], np.cumsum(np.nan_to_num(turned))])
    first = np.flatnonzero(np.concatenate([[True], ~follows]))
    lengths = np.diff(np.append(first, len(time)))
    return np.asarray(total - np.repeat(total[first], lengths))
