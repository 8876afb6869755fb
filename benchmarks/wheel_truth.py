"""The full wheel–soil model once more, for studies of many soils: other code than the one that is fitted.

Equations [1] to [9] of Iagnemma et al. 2004 with θm = (c1 + c2 i) θ1 and θ2 = −c3 θ1, by a composite
Gauss–Legendre rule whose panels shrink towards the free end of each arc, roots by false position,
derivatives by complex steps. Its integrals are compared with the adaptive ones of tests/simulator
wherever it is used (`error_of_sample`); it must not import terrain_cli.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from simulator import Soil, paper, sinkage_under
from simulator import forces as exact_forces

RADIUS, WIDTH = paper.WHEEL.radius, paper.WHEEL.width
#: A wheel deeper than this is stuck.
DEEPEST = math.radians(80.0)
PARAMETERS = ("cohesion", "tan_phi", "shear_modulus", "stiffness", "sinkage_exponent")
#: c1, c2 and c3 of the paper.
SHAPE = (0.5, 0.0, 0.0)
_BLOCK = 2048
_STEP = 1e-30


def _graded(panels=8, order=10, ratio=0.2):
    """Nodes and weights on (0, 1), panels shrinking towards 0 where the stress starts as a power."""
    ends = np.append(0.0, ratio ** np.arange(panels - 1, -1, -1.0))
    x, w = np.polynomial.legendre.leggauss(order)
    half = 0.5 * np.diff(ends)[:, None]
    return (ends[:-1, None] + half * (x + 1.0)).ravel(), (half * w).ravel()


_SHARE, _WEIGHT = _graded()


class Soils(NamedTuple):
    """Parameters of soils, arrays of one shape: c in Pa, tan φ, k in m, keq in Pa/m^n, n."""

    cohesion: np.ndarray
    tan_phi: np.ndarray
    shear_modulus: np.ndarray
    stiffness: np.ndarray
    sinkage_exponent: np.ndarray

    def take(self, rows):
        return Soils(*(column[rows] for column in self))


def table():
    """Return the soils of Table II of the paper."""
    levels = {name: np.linspace(*ends, paper.LEVELS) for name, ends in paper.TABLE_II.items()}
    soil = dict(zip(levels, np.meshgrid(*levels.values(), indexing="ij"), strict=True))
    columns = (
        soil["cohesion"],
        np.tan(soil["friction_angle"]),
        soil["shear_modulus"],
        soil["cohesive_modulus"] / WIDTH + soil["frictional_modulus"],
        soil["exponent"],
    )
    return Soils(*(column.ravel() for column in columns))


def _of_block(soils, sinkage, slip, wheel, shape):
    radius, width = wheel
    c1, c2, c3 = shape
    c, tan_phi, k, keq, n = (column[:, None] for column in soils)
    entry = np.arccos(1.0 - sinkage / radius)[:, None]
    grip = (1.0 - slip)[:, None]
    before = (1.0 - c1 - c2 * slip[:, None]) * entry
    behind = entry - before + c3 * entry
    front, rear = entry - before * _SHARE, behind * _SHARE - c3 * entry
    # cos θe − cos θ1 without cancelling where θe nears θ1; θe of the rear arc is θ of the front one.
    rise = 2.0 * np.sin(entry - 0.5 * before * _SHARE) * np.sin(0.5 * before * _SHARE)
    sigma = keq * np.exp(n * np.log(radius * rise))
    total = []
    for theta, arc in ((front, before), (rear, behind)):
        travel = radius * (entry - theta - grip * (np.sin(entry) - np.sin(theta)))
        tau = (c + sigma * tan_phi) * (1.0 - np.exp(-travel / k))
        cos, sin = np.cos(theta), np.sin(theta)
        parts = (sigma * cos + tau * sin, tau, tau * cos - sigma * sin)
        total.append([arc[:, 0] * (part * _WEIGHT).sum(axis=1) for part in parts])
    load, torque, pull = (radius * width * (a + b) for a, b in zip(*total, strict=True))
    return load, radius * torque, pull


def forces(soils, sinkage, slip, wheel=(RADIUS, WIDTH), shape=SHAPE):
    """Return W in N, T in N m and DP in N of samples, shape (3, n); complex where an argument is.

    `wheel` is its radius and width in m, `shape` c1, c2 and c3.
    """
    kind = np.result_type(*soils, sinkage, slip, float)
    found = np.empty((3, len(sinkage)), dtype=kind)
    for start in range(0, len(sinkage), _BLOCK):
        part = slice(start, start + _BLOCK)
        found[:, part] = _of_block(soils.take(part), sinkage[part], slip[part], wheel, shape)
    return found


def sinkage(soils, load, slip, wheel=(RADIUS, WIDTH), shape=SHAPE):
    """Return the sinkages in m under loads in N by false position on log W over log z (Illinois)."""
    low, high = (
        np.full(len(load), math.log(1e-8)),
        np.full(len(load), math.log(wheel[0] * (1.0 - math.cos(DEEPEST)))),
    )
    wanted = np.log(load)

    def excess(place):
        return np.log(forces(soils, np.exp(place), slip, wheel, shape)[0]) - wanted

    at_low, at_high = excess(low), excess(high)
    if np.any(at_high < 0.0):
        raise ValueError("a soil does not carry its load")
    side = np.zeros(len(load))
    for _ in range(100):
        place = (low * at_high - high * at_low) / (at_high - at_low)
        here = excess(place)
        if np.max(np.abs(here)) < 1e-13:
            return np.exp(place)
        above = here > 0.0
        # The end that stays a second time counts half: both ends then close in.
        at_low = np.where(above & (side > 0.0), 0.5 * at_low, at_low)
        at_high = np.where(~above & (side < 0.0), 0.5 * at_high, at_high)
        high, at_high = np.where(above, place, high), np.where(above, here, at_high)
        low, at_low = np.where(above, low, place), np.where(above, at_low, here)
        side = np.where(above, 1.0, -1.0)
        if np.max(high - low) < 1e-15:
            return np.exp(place)
    raise ArithmeticError("the sinkage under the load does not converge")


def carry(soils, load, slip):
    """Return which soils carry a load in N at a slip before the wheel is stuck."""
    n = len(soils.cohesion)
    deep = np.full(n, RADIUS * (1.0 - math.cos(DEEPEST)))
    return forces(soils, deep, np.full(n, slip))[0] >= load


def slopes(soils, depth, slip):
    """Return the derivatives of W and T by the parameters, then by z and i, shape (7, 2, n).

    k and keq by their logarithms.
    """
    found = []
    for name in (*PARAMETERS, "sinkage", "slip"):
        moved, z, i, scale = soils, depth, slip, 1.0
        if name == "sinkage":
            z = depth + 1j * _STEP
        elif name == "slip":
            i = slip + 1j * _STEP
        else:
            scale = getattr(soils, name) if name in {"shear_modulus", "stiffness"} else 1.0
            moved = soils._replace(**{name: getattr(soils, name) * (1.0 + 0j) + 1j * _STEP})
        found.append(scale * forces(moved, z, i)[:2].imag / _STEP)
    return np.array(found)


def error_of_sample(soils, depth, slip, rows):
    """Return the largest relative errors of W, T and DP (as a share of W) and of z by adaptive integration."""
    found = forces(soils.take(rows), depth[rows], slip[rows])
    worst = np.zeros(4)
    for column, row in enumerate(rows):
        c, tan_phi, k, keq, n = (float(value[row]) for value in soils)
        soil = Soil("drawn", c, math.atan(tan_phi), k, 0.0, keq, n, c1=0.5, c2=0.0)
        truth = exact_forces(soil, paper.WHEEL, float(depth[row]), float(slip[row]))
        z = sinkage_under(soil, paper.WHEEL, float(found[0, column]), float(slip[row]))
        errors = (
            found[0, column] / truth.load - 1.0,
            found[1, column] / truth.torque - 1.0,
            (found[2, column] - truth.pull) / truth.load,
            z / depth[row] - 1.0,
        )
        worst = np.maximum(worst, np.abs(errors))
    return worst
