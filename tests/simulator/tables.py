"""Sinkage, torque and drawbar pull of many samples at once, interpolated between exact wheels.

On the grid of a table stand the integrals of `wheel` themselves, as functions of sinkage and
slip; the sinkage under a load then comes from the inverse of the interpolated load.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import RectBivariateSpline

from simulator import wheel as exact

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from simulator.effects import OnGround
    from simulator.soils import Soil

    Array = NDArray[np.float64]

#: Spacing of the grid in log sinkage and in log(slip + SLIP_SHIFT), found so that the error stays
#: below 1e-6. Torque rises like the logarithm from the little it is at slip 0, then flattens.
SINKAGE_STEP = 0.12
SLIP_STEP = 0.06
SLIP_SHIFT = 0.03
#: Loads are rounded outwards to powers of this, so that drives share their tables.
LOAD_STEP = 1.25
DEGREE = 5


@dataclass(frozen=True)
class _Table:
    low: float
    high: float
    log_load: RectBivariateSpline
    log_torque: RectBivariateSpline
    pull_ratio: RectBivariateSpline

    def depth_under(self, load: Array, shifted: Array) -> Array:
        """Find the log sinkage by Newton's method: log load is nearly straight in log sinkage."""
        wanted = np.log(load)
        depth = np.full(len(load), 0.5 * (self.low + self.high))
        for _ in range(30):
            step = (self.log_load.ev(depth, shifted) - wanted) / self.log_load.ev(depth, shifted, dx=1)
            depth = np.clip(depth - step, self.low, self.high)
            if np.max(np.abs(step)) < 1e-12:
                return depth
        raise ArithmeticError("the sinkage under the load does not converge")


def _nodes(low: float, high: float, step: float) -> Array:
    return np.linspace(low, high, max(DEGREE + 1, math.ceil((high - low) / step) + 1))


@lru_cache(maxsize=256)
def _table(
    soil: Soil,
    wheel: exact.Wheel,
    model: exact.Model,
    loads: tuple[float, float],
    slips: tuple[float, float],
    laws: OnGround | None = None,
) -> _Table:
    shifted = _nodes(math.log(slips[0] + SLIP_SHIFT), math.log(slips[1] + SLIP_SHIFT), SLIP_STEP)
    slip = np.clip(np.exp(shifted) - SLIP_SHIFT, *slips)
    ends = [
        math.log(exact.sinkage_under(soil, wheel, load, i, model, laws))
        for load in loads
        for i in (*slip[::4], slip[-1])
    ]
    # The sinkage under one load varies smoothly with slip; the margin covers the slips between.
    low, high = min(ends) - 0.02, max(ends) + 0.02
    depth = _nodes(low, high, SINKAGE_STEP)
    grid = [[exact.forces(soil, wheel, math.exp(d), i, model, laws) for i in slip] for d in depth]

    def spline(values: list[list[float]]) -> RectBivariateSpline:
        return RectBivariateSpline(depth, shifted, np.array(values), kx=DEGREE, ky=DEGREE)

    return _Table(
        low,
        high,
        spline([[math.log(f.load) for f in row] for row in grid]),
        spline([[math.log(f.torque) for f in row] for row in grid]),
        spline([[f.pull / f.load for f in row] for row in grid]),
    )


def forces_under(
    soil: Soil,
    wheel: exact.Wheel,
    load: Array,
    slip: Array,
    model: exact.Model = "wong-reece",
    laws: OnGround | None = None,
) -> tuple[Array, Array, Array]:
    """Return sinkage in m, torque in N m and drawbar pull in N under loads in N at slips from 0 to 1.

    Relative error below 1e-6 of the exact wheel (of the load, for the drawbar pull).
    """
    if len(load) == 0:
        return np.empty(0), np.empty(0), np.empty(0)
    if slip.min() < 0.0 or slip.max() > 1.0:
        raise ValueError(f"slips from {slip.min():.3g} to {slip.max():.3g} are not between 0 and 1")
    step = math.log(LOAD_STEP)
    loads = (
        math.exp(step * math.floor(math.log(load.min()) / step)),
        math.exp(step * math.ceil(math.log(load.max()) / step)),
    )
    slips = (math.floor(slip.min() * 10.0) / 10.0, min(1.0, math.floor(slip.max() * 10.0 + 1.0) / 10.0))
    table = _table(soil, wheel, model, loads, slips, laws)
    shifted = np.log(slip + SLIP_SHIFT)
    depth = table.depth_under(load, shifted)
    torque = np.exp(table.log_torque.ev(depth, shifted))
    return np.exp(depth), torque, load * table.pull_ratio.ev(depth, shifted)
