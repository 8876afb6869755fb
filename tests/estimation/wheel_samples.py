"""Windows of samples of the full wheel model with known truth, by the simulator's scalar integrals.

θm is θ1/2, as in a model without effects. Nothing here imports terrain_cli.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from simulator import Soil, forces, sinkage_under
from simulator.paper import LOAD, TABLE_II, VARIATION, WHEEL

CHANNELS = ("load", "torque", "sinkage", "slip", "drawbar_pull")


@dataclass(frozen=True)
class Truth:
    """Channels by name, shape (windows · size,), and one soil for each window."""

    channels: dict[str, np.ndarray]
    soils: tuple[Soil, ...]
    size: int

    @property
    def bounds(self) -> np.ndarray:
        return np.arange(len(self.soils) + 1) * self.size

    @property
    def cohesion(self) -> np.ndarray:
        return np.array([soil.cohesion for soil in self.soils])

    @property
    def phi(self) -> np.ndarray:
        return np.array([soil.friction_angle for soil in self.soils])

    @property
    def stiffness(self) -> np.ndarray:
        return np.array([soil.stiffness(WHEEL.width) for soil in self.soils])

    @property
    def exponent(self) -> np.ndarray:
        return np.array([soil.exponent for soil in self.soils])

    @property
    def shear_modulus(self) -> np.ndarray:
        return np.array([soil.shear_modulus for soil in self.soils])

    def measured(
        self, seed: int, noise: float, *, pull: float = 0.0, repeat: int = 1
    ) -> dict[str, np.ndarray]:
        """Return the channels with relative noise, and of the drawbar pull with one of `pull` newtons."""
        rng = np.random.default_rng(seed)
        noisy = {}
        for name in CHANNELS:
            column = np.tile(self.channels[name], repeat)
            error = rng.standard_normal(len(column))
            noisy[name] = column + pull * error if name == "drawbar_pull" else column * (1.0 + noise * error)
        return noisy


def soil(rng: np.random.Generator) -> Soil:
    """Draw a soil from the ranges of the paper's Table II."""
    return Soil("drawn", **{name: rng.uniform(*ends) for name, ends in TABLE_II.items()}, c1=0.5, c2=0.0)


@cache
def free(windows: int, size: int, seed: int, slips: tuple[float, float] = (0.1, 0.9)) -> Truth:
    """Return windows whose sinkage and slip vary widely: the load follows."""
    rng = np.random.default_rng(seed)
    soils = tuple(soil(rng) for _ in range(windows))
    rows = []
    for ground in soils:
        for _ in range(size):
            z, i = rng.uniform(0.008, 0.03), rng.uniform(*slips)
            f = forces(ground, WHEEL, z, i)
            rows.append((f.load, f.torque, z, i, f.pull))
    return Truth(dict(zip(CHANNELS, np.array(rows).T, strict=True)), soils, size)


@cache
def paper(windows: int, size: int, seed: int, slip: float) -> Truth:
    """Return windows as in the paper: load and slip vary by ±15 % about 98.1 N and `slip`."""
    rng = np.random.default_rng(seed)
    soils, rows = [], []
    while len(soils) < windows:
        ground, window = soil(rng), []
        try:
            for _ in range(size):
                load, i = (mean * (1.0 + VARIATION * rng.uniform(-1.0, 1.0)) for mean in (LOAD, slip))
                z = sinkage_under(ground, WHEEL, load, i)
                f = forces(ground, WHEEL, z, i)
                window.append((load, f.torque, z, i, f.pull))
        except ValueError:
            # It does not carry the wheel.
            continue
        soils.append(ground)
        rows += window
    return Truth(dict(zip(CHANNELS, np.array(rows).T, strict=True)), tuple(soils), size)
