"""Many drives over known soils, quickly: (x, y) of the simulator's wheel with noisy sensors.

The wheel's sinkage and torque come from `simulator`, which shares nothing with the program; only
x and y are the program's, as it computes them from what the sensors show.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import RectBivariateSpline
from simulator import SOILS, Wheel
from simulator.tables import forces_under

from terrain_cli.mechanics.linear import line_coordinates

WHEEL = Wheel()
SHEAR_MODULUS = 0.018
MEAN_LOAD = 80.0
RATES = (10, 20, 50)
#: In m/s.
SPEED = 0.05
LOADS, SLIPS = np.linspace(45.0, 115.0, 15), np.linspace(0.03, 0.69, 23)
#: Snow does not carry the wheel.
NAMES = tuple(name for name in SOILS if name != "snow")
#: Each of them twice as stiff, and no stronger.
STIFFER = {
    f"stiff {name}": replace(
        SOILS[name],
        cohesive_modulus=2.0 * SOILS[name].cohesive_modulus,
        frictional_modulus=2.0 * SOILS[name].frictional_modulus,
    )
    for name in NAMES
}


@lru_cache
def ground(name, model):
    """Return log sinkage and log torque as functions of load and slip."""
    load, slip = np.meshgrid(LOADS, SLIPS, indexing="ij")
    sinkage, torque, _ = forces_under((SOILS | STIFFER)[name], WHEEL, load.ravel(), slip.ravel(), model)
    return [RectBivariateSpline(LOADS, SLIPS, np.log(v).reshape(load.shape)) for v in (sinkage, torque)]


def noise(rng, n, kind):
    """Return noise of deviation 1 of load, torque, sinkage and slip."""
    values = rng.standard_normal((4, n))
    if kind == "correlated":
        for t in range(1, n):
            values[:, t] = 0.8 * values[:, t - 1] + 0.6 * values[:, t]
    elif kind == "interpolated":
        # A sinkage sensor at an eighth of the rate, interpolated to the torque's clock.
        known = np.arange(n // 8 + 2)
        values[2] = np.interp(np.arange(n), 8.0 * known, rng.standard_normal(len(known)))
    return values


def steps(rng, n, low, high):
    values = np.empty(n)
    starts = np.sort(rng.integers(0, n, rng.integers(1, 5)))
    for a, b in zip([0, *starts], [*starts, n], strict=True):
        values[a:b] = rng.uniform(low, high)
    return values


def waves(rng, time, period):
    """Return three sines together, never beyond ±1."""
    rates = 2.0 * np.pi * np.array([1.0, 3.0**0.5, 8.0**0.5]) / period
    return np.sin(np.outer(time, rates) + rng.uniform(0.0, 2.0 * np.pi, 3)) @ np.array([0.5, 0.3, 0.2])


def load_over(rng, time, kind):
    if kind == "steps":
        return MEAN_LOAD * (1.0 + steps(rng, len(time), -0.3, 0.3))
    if kind == "waves":
        return MEAN_LOAD * (1.0 + rng.uniform(0.12, 0.25) * waves(rng, time, rng.uniform(4.0, 12.0)))
    if kind == "white":
        return MEAN_LOAD * (1.0 + rng.uniform(-0.15, 0.15, len(time)))
    return np.full(len(time), MEAN_LOAD)


def slip_over(rng, time, kind):
    if kind == "steps":
        return steps(rng, len(time), 0.15, 0.5)
    if kind == "waves":
        return 0.32 * (1.0 + rng.uniform(0.15, 0.4) * waves(rng, time, rng.uniform(5.0, 16.0)))
    if kind == "sweep":
        return np.linspace(0.1, 0.6, len(time))
    return np.full(len(time), rng.uniform(0.15, 0.5))


@dataclass(frozen=True)
class Kind:
    """What the drives of one kind have in common.

    `rolling` is the deviation of ω and of V as a share of each, from which slip then comes;
    otherwise slip is measured like the rest.
    """

    load: str = "waves"
    slip: str = "waves"
    model: str = "wong-reece"
    noise: str = "white"
    share: float = 0.03
    rolling: float = 0.0
    shear_modulus: float = SHEAR_MODULUS


@dataclass(frozen=True)
class Drive:
    x: np.ndarray
    y: np.ndarray
    distance: np.ndarray
    #: Samples where the soil changes, and samples in a second.
    changes: np.ndarray
    rate: int
    #: What the sensors show.
    load: np.ndarray
    sinkage: np.ndarray
    slip: np.ndarray

    def score(self, bounds):
        """Return changes found within 1 s, changes, bounds further than 1 s from any, and bounds."""
        found = bounds[1:-1]
        apart = np.abs(np.subtract.outer(self.changes, found))
        hits = (apart <= self.rate).any(axis=1).sum() if len(found) else 0
        false = (~(apart <= self.rate).any(axis=0)).sum() if len(self.changes) else len(found)
        return np.array([hits, len(self.changes), false, len(found)])


def drive(rng, kind, soils, lengths, rate):
    """Drive over soils (names), each for a number of samples."""
    ends = np.cumsum(lengths)
    n = int(ends[-1])
    time = np.arange(n) / rate
    load, slip = load_over(rng, time, kind.load), slip_over(rng, time, kind.slip)
    sinkage, torque = np.empty(n), np.empty(n)
    for name, a, b in zip(soils, [0, *ends[:-1]], ends, strict=True):
        logs = [log.ev(load[a:b], slip[a:b]) for log in ground(name, kind.model)]
        sinkage[a:b], torque[a:b] = np.exp(logs)
    shown = 1.0 + kind.share * noise(rng, n, kind.noise)
    if kind.rolling:
        ratio = (1.0 + kind.rolling * rng.standard_normal(n)) / (1.0 + kind.rolling * rng.standard_normal(n))
        measured_slip = 1.0 - (1.0 - slip) * ratio
    else:
        measured_slip = slip * shown[3]
    load, sinkage, slip = load * shown[0], sinkage * shown[2], np.clip(measured_slip, 0.001, 0.99)
    x, y = line_coordinates(
        load,
        torque * shown[1],
        sinkage,
        slip,
        radius=WHEEL.radius,
        width=WHEEL.width,
        shear_modulus=kind.shear_modulus,
    )
    return Drive(x, y, SPEED * time, ends[:-1], rate, load, sinkage, slip)


def clean(seed, kind, shortest=200, longest=5000):
    """Return a drive over one soil, of any length between the two on a logarithmic scale."""
    rng = np.random.default_rng([1, seed])
    n = int(np.exp(rng.uniform(np.log(shortest), np.log(longest))))
    return drive(rng, kind, [rng.choice(NAMES)], [n], int(rng.choice(RATES)))


@lru_cache
def line(name):
    """Return c and tan φ of the line on which the samples of a soil lie, and its middle."""
    load, slip = MEAN_LOAD * np.array([0.8, 1.0, 1.2]), np.full(3, 0.3)
    sinkage, torque = np.exp([log.ev(load, slip) for log in ground(name, "wong-reece")])
    x, y = line_coordinates(
        load, torque, sinkage, slip, radius=WHEEL.radius, width=WHEEL.width, shear_modulus=SHEAR_MODULUS
    )
    slope, intercept = np.polyfit(x, y, 1)
    return intercept, slope, x[1], y[1]


def differ(one, other, share=0.1):
    """Tell whether the lines of two soils are apart by a share of the strength under both."""
    c1, t1, x1, y1 = line(one)
    c2, t2, x2, y2 = line(other)
    return abs(c1 + t1 * x2 - y2) >= share * y2 and abs(c2 + t2 * x1 - y1) >= share * y1


def mixed(seed, kind):
    """Return a drive over 3 to 6 soils of 8 to 20 s each, whose lines differ by 10 % of the strength."""
    rng = np.random.default_rng([2, seed])
    rate = int(rng.choice(RATES))
    count = int(rng.integers(3, 7))
    soils = [rng.choice(NAMES)]
    while len(soils) < count:
        name = rng.choice(NAMES)
        if differ(name, soils[-1]):
            soils.append(name)
    lengths = (rng.uniform(8.0, 20.0, count) * rate).astype(int)
    return drive(rng, kind, soils, lengths, rate)


def stiffened(seed, kind):
    """Return a drive over 3 to 6 stretches of 15 to 40 s of one soil, each other one of which is stiffer."""
    rng = np.random.default_rng([4, seed])
    rate = int(rng.choice(RATES))
    count, name = int(rng.integers(3, 7)), rng.choice(NAMES)
    soils = [("stiff " if k % 2 else "") + name for k in range(count)]
    lengths = (rng.uniform(15.0, 40.0, count) * rate).astype(int)
    return drive(rng, kind, soils, lengths, rate)
