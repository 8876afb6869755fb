"""What some effects need beside the channels: how fast they change, and how far the wheel has turned."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

#: Samples on either side of the one whose slope is taken.
_REACH = 2


def rate(time: ArrayLike, stretch: ArrayLike, values: ArrayLike, *, reach: int = _REACH) -> Array:
    """Differentiate a channel by time: the slope of a line through each sample and its neighbours.

    Parameters
    ----------
    time : array_like, shape (n,)
        In s, rising within a stretch.
    stretch : array_like of int, shape (n,)
        Samples of different stretches are no neighbours.
    values : array_like, shape (n,)
    reach : int
        Neighbours on either side; fewer at the ends of a stretch.

    Returns
    -------
    ndarray, shape (n,)
        In the channel's unit per s; NaN where a stretch has a single sample.
    """
    time, values = np.asarray(time, dtype=float), np.asarray(values, dtype=float)
    stretch = np.asarray(stretch)
    n = len(time)
    # Sums over the neighbours, about the sample itself so that nothing cancels.
    sums = np.zeros((5, n))
    for shift in range(-reach, reach + 1):
        own = np.arange(max(0, -shift), min(n, n - shift))
        own = own[stretch[own] == stretch[own + shift]]
        dt, dv = time[own + shift] - time[own], values[own + shift] - values[own]
        known = np.isfinite(dv)
        own, dt, dv = own[known], dt[known], dv[known]
        sums[:, own] += (np.ones_like(dt), dt, dv, dt * dt, dt * dv)
    count, st, sv, stt, stv = sums
    spread = count * stt - st * st
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(spread > 0.0, (count * stv - st * sv) / spread, np.nan))


def wheel_angle(time: ArrayLike, stretch: ArrayLike, angular_velocity: ArrayLike) -> Array:
    """Integrate the angle through which the wheel has turned since its stretch began.

    Parameters
    ----------
    time : array_like, shape (n,)
        In s.
    stretch : array_like of int, shape (n,)
    angular_velocity : array_like, shape (n,)
        ω in rad/s.

    Returns
    -------
    ndarray, shape (n,)
        In rad: the trapezoidal rule.
    """
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
