"""Windows of wheel samples with known truth, many at a time.

Equations of their own: triangular stresses with their peak at θ1/2, integrated by hand, the
cohesion under the rear of the rim included. Nothing here imports terrain_cli.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

RADIUS, WIDTH, SHEAR_MODULUS = 0.125, 0.1, 0.018
GEOMETRY = {"radius": RADIUS, "width": WIDTH, "shear_modulus": SHEAR_MODULUS}
MEAN_LOAD, MEAN_SINKAGE, MEAN_SLIP = 90.0, 0.015, 0.3
PHI = float(np.radians(30.0))


@dataclass(frozen=True)
class Drive:
    """Channels of windows, shape (windows, samples), and the soil below them."""

    load: np.ndarray
    torque: np.ndarray
    sinkage: np.ndarray
    slip: np.ndarray
    cohesion: float
    phi: float

    @property
    def bounds(self):
        windows, samples = self.load.shape
        return np.arange(windows + 1) * samples

    @property
    def channels(self):
        return {name: getattr(self, name).ravel() for name in ("load", "torque", "sinkage", "slip")}


def torque_of(load, sinkage, slip, cohesion, phi):
    """Torque and peak normal stress of the triangular stresses under a load."""
    entry = np.arccos(1.0 - sinkage / RADIUS)
    peak = entry / 2.0
    mobilised = -np.expm1(-(RADIUS / SHEAR_MODULUS) * (peak - (1.0 - slip) * (np.sin(entry) - np.sin(peak))))
    # Integrals of the triangle times cos and sin over the rim, and of what the rear adds for c.
    upright = (2.0 * np.cos(peak) - np.cos(entry) - 1.0) / peak
    along = (2.0 * np.sin(peak) - np.sin(entry)) / peak
    rear = 1.0 - np.sin(peak) / peak
    shear = mobilised * along
    stress = (load / (RADIUS * WIDTH) - cohesion * (shear + rear)) / (upright + shear * np.tan(phi))
    peak_shear = mobilised * (cohesion + stress * np.tan(phi))
    return RADIUS**2 * WIDTH * entry / 4.0 * (2.0 * peak_shear + cohesion)


def noise(rng, shape, rho=0.0):
    """Return normal noise of deviation 1, first-order correlated along the last axis."""
    values = rng.standard_normal(shape)
    for t in range(1, shape[-1]) if rho else ():
        values[..., t] = rho * values[..., t - 1] + np.sqrt(1.0 - rho**2) * values[..., t]
    return values


def variation(kind, windows, samples, rng):
    """Return how a channel varies, between −1 and 1."""
    place = np.arange(samples) / samples
    phase = rng.uniform(0.0, 1.0, (windows, 1))
    if kind == "scatter":
        return rng.uniform(-1.0, 1.0, (windows, samples))
    if kind == "steps":
        return np.where(np.floor(3.0 * place + phase) % 2 == 0, 1.0, -1.0)
    if kind == "undulation":
        return np.sin(2.0 * np.pi * (rng.uniform(1.0, 4.0, (windows, 1)) * place + phase))
    return np.zeros((windows, samples))


def drive(
    windows,
    samples,
    seed,
    *,
    kind="constant",
    share=0.0,
    slip_share=0.0,
    noises=0.0,
    rho=0.0,
    cohesion=800.0,
    phi=PHI,
):
    """Drive windows of one soil: the load varies by ± share of its mean, the slip by ± slip_share at random.

    noises is the deviation of load, torque, sinkage and slip as a share of their values: one
    for all, or four.
    """
    rng = np.random.default_rng(seed)
    load = MEAN_LOAD * (1.0 + share * variation(kind, windows, samples, rng))
    slip = MEAN_SLIP * (1.0 + slip_share * variation("scatter", windows, samples, rng))
    sinkage = MEAN_SINKAGE * (load / MEAN_LOAD) ** (2.0 / 3.0) * (1.0 + slip) / (1.0 + MEAN_SLIP)
    torque = torque_of(load, sinkage, slip, cohesion, phi)
    measured = [
        value * (1.0 + deviation * noise(rng, value.shape, rho))
        for value, deviation in zip((load, torque, sinkage, slip), np.broadcast_to(noises, 4), strict=True)
    ]
    return Drive(*measured, cohesion, phi)
