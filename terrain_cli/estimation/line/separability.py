"""How far noise in the sensors may have turned a line: bounds on φ from the channels.

x and y are computed from load, torque, sinkage and slip, all of them noisy, so that least
squares is biased however long the window: noise in the load or the slip flattens the line,
noise in the sinkage turns it towards the origin. Two channels come from different sensors,
though, and share no noise. With g = y − c − x tan φ taken at the true soil, a channel q is
correlated with g only through its own noise, cov(q, g) = (∂g/∂q) var(noise of q), and the sign
of ∂g/∂q is known: positive for the torque, negative for load, sinkage and slip (for a soil
with c ≥ 0 and φ ≥ 0). Each channel therefore bounds tan φ from one side by the slope
cov(q, y)/cov(q, x) that it gives as an instrument. Load bounds it from below and torque from
above (Frisch 1934; Klepper & Leamer 1984).

Where nothing but noise varies, the bounds are those of any soil.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.moments import CHANNELS, LOAD, SINKAGE, SLIP, TORQUE, X, Y
from terrain_cli.vocabulary.choices import LARGEST_PHI

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.line.moments import WindowMoments

    Array = NDArray[np.float64]

#: Sign of ∂g/∂q.
_SIGN = {LOAD: -1.0, TORQUE: 1.0, SINKAGE: -1.0, SLIP: -1.0}

#: Standard errors by which cov(q, x) must differ from zero for the channel to be heard.
_SIGNIFICANT = 3.0

#: A channel that varies by more than this share of its mean, and takes x along with this
#: correlation, varies in truth: no sensor in use drifts so far. A smooth undulation has few
#: independent samples, and the less noise lies on it the fewer they look.
_PLAIN_VARIATION = 0.05
_PLAIN_CORRELATION = 0.8


def phi_bounds(moments: WindowMoments, *, correlated: bool) -> tuple[Array, Array]:
    """Bounds of φ, in rad between 0 and 60°, that hold for any amount of noise in any of the four sensors."""
    low, high = np.zeros_like(moments.count), np.full_like(moments.count, LARGEST_PHI)
    for channel in CHANNELS:
        with np.errstate(divide="ignore", invalid="ignore"):
            phi = np.arctan(moments[0, channel, Y] / moments[0, channel, X])
        heard = (
            moments.varies(X)
            & moments.varies(channel)
            & _significant(moments, channel, correlated=correlated)
        )
        above = _SIGN[channel] * moments[0, channel, X] > 0.0
        high = np.where(heard & above, np.minimum(high, phi), high)
        low = np.where(heard & ~above, np.maximum(low, phi), low)
    # Two bounds that have crossed differ by sampling error only.
    low, high = np.minimum(low, high), np.maximum(low, high)
    return np.clip(low, 0.0, LARGEST_PHI), np.clip(high, 0.0, LARGEST_PHI)


def distance_to_bounds(phi: Array, low: Array, high: Array) -> Array:
    """Root mean square distance of φ to a truth that lies anywhere between its bounds, in rad."""
    return np.asarray(np.sqrt((high - low) ** 2 / 12.0 + (0.5 * (low + high) - phi) ** 2))


def _significant(moments: WindowMoments, channel: int, *, correlated: bool) -> NDArray[np.bool_]:
    """Whether x follows a channel by more than chance (Fisher's z of their correlation).

    The samples are worth as many as are independent in what the channel leaves of x, so that
    one clear step of the load counts for more than a slow drift of two sensors.
    """
    own, shared, x = moments[0, channel, channel], moments[0, channel, X], moments[0, X, X]
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.clip(shared / np.sqrt(own * x), -1.0, 1.0)
        independent = moments.count
        if correlated:
            slope = shared / own
            rest = x - slope * shared
            rest1 = (
                moments[1, X, X]
                - 2.0 * slope * moments[1, channel, X]
                + slope**2 * moments[1, channel, channel]
            )
            common = _unbiased(rest1 / rest, moments.count) * _unbiased(
                moments[1, channel, channel] / own, moments.count
            )
            independent = independent * (1.0 - common) / (1.0 + common)
        z = np.arctanh(np.abs(correlation)) * np.sqrt(np.maximum(independent - 3.0, 1.0))
        varies = np.sqrt(own / moments.count) > _PLAIN_VARIATION * np.abs(moments.mean[channel])
    plain = varies & (np.abs(correlation) > _PLAIN_CORRELATION)
    return np.asarray((z > _SIGNIFICANT) | plain)


def _unbiased(correlation: Array, count: Array) -> Array:
    """Lag-1 autocorrelation with its small-sample bias −(1 + 3ρ)/n put back (Marriott & Pope 1954).

    Nothing is left of x where a channel explains all of it; that is not correlated.
    """
    unbiased = (count * correlation + 1.0) / np.maximum(count - 3.0, 1.0)
    return np.nan_to_num(np.clip(unbiased, 0.0, 1.0))
