"""Where the search begins."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.mechanics.dual import value

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.estimation.wheel_fit.linearised import Problem

    Array = NDArray[np.float64]

#: Samples of a window, and nodes on each arc, that are enough to begin with.
_SAMPLES, _ORDER = 3, 5
#: Unknowns in which the model bends most, and how far from the prior mean another search begins.
_BENT = ("shear_modulus", "sinkage_exponent")
_APART = 1.2
#: Times that a soil is taken e times as stiff because the wheel sinks to its axle.
_STIFFER = 5


def centre(problem: Problem, data: FitData) -> tuple[Array, Array]:
    """Begin at the prior means, with the stiffness that carries the load there."""
    sought = problem.unknowns
    t, common = np.zeros((len(data.windows), len(sought.local))), np.zeros(len(sought.shared))
    return carried(problem, data, np.clip(t, *_range(problem)), common), common


def others(problem: Problem, data: FitData, common: Array) -> Iterator[Array]:
    """Yield further beginnings, far apart in what the model is most curved in, shape (w, p)."""
    names = [u.name for u in problem.unknowns.local]
    columns = [names.index(name) for name in _BENT if name in names]
    low, high = _range(problem)
    for signs in product((-_APART, _APART), repeat=len(columns)):
        t = np.zeros((len(data.windows), len(names)))
        t[:, columns] = signs
        yield carried(problem, data, np.clip(t, low, high), common)


def of_shapes(problem: Problem, common: Array) -> Iterator[Array]:
    """Yield beginnings for effects whose shape has no influence while the effect is absent, shape (q,).

    There the data say nothing of where the shape's parameters are to go, and the search may end in another
    valley. The effects are present by one scale, to either side of their null value.
    """
    column = {u.name: j for j, u in enumerate(problem.unknowns.shared)}
    sizes = {
        column[effect.qualified(p)]: p
        for effect in problem.model.effects
        if any(p.shape for p in effect.parameters)
        for p in effect.parameters
        if not p.shape and effect.qualified(p) in column
    }
    if not sizes:
        return
    for side in (1.0, -1.0):
        begun = common.copy()
        for j, parameter in sizes.items():
            unknown = problem.unknowns.shared[j]
            present = parameter.null + side * parameter.scale
            inside = parameter.lower <= present <= parameter.upper
            begun[j] = (present - unknown.mean) / unknown.sd if inside else common[j]
        if np.any(begun != common):
            yield begun


def carried(problem: Problem, data: FitData, t: Array, common: Array) -> Array:
    """Choose each window's stiffness so that the soil carries the load."""
    names = [u.name for u in problem.unknowns.local]
    if problem.model.base == "linear" or "load" not in data.channels or "stiffness" not in names:
        return t
    column = names.index("stiffness")
    stiffness = problem.unknowns.local[column]
    rows, count = data.thin(_SAMPLES)
    few = data.take(rows, count, np.arange(len(count)))
    moved = t.copy()
    if "sinkage" in few.channels:
        at_sinkage = replace(problem, given="sinkage")
        carried = value(at_sinkage.predict(few, t, common, by=False, order=_ORDER).load)
        load = few.channels["load"]
        seen = (load > 0.0) & (carried > 0.0)
        sums = [segment_sum(np.where(seen, part, 0.0), few.bounds) for part in (load, carried)]
        ratio = np.divide(sums[0], sums[1], out=np.ones(len(t)), where=sums[1] > 0.0)
        moved[:, column] += np.clip(np.log(np.maximum(ratio, 1e-3)), -3.0, 3.0) / stiffness.sd
    else:
        for _ in range(_STIFFER):
            sunk = ~np.isfinite(value(problem.predict(few, moved, common, by=False, order=_ORDER).torque))
            moved[:, column] += (segment_sum(sunk.astype(float), few.bounds) > 0.0) / stiffness.sd
    moved[:, column] = np.clip(moved[:, column], stiffness.lower, stiffness.upper)
    return moved


def _range(problem: Problem) -> tuple[Array, Array]:
    table = np.array([[u.lower, u.upper] for u in problem.unknowns.local]).reshape(-1, 2)
    return table[:, 0], table[:, 1]
