"""How the full model departs from its best as c and φ leave the estimate, all other unknowns sought again.

The window is asked with what the model itself says at the estimate in the place of what was measured, at
the true loads, sinkages and slips that go with it: the expected deviance (the Asimov data set of Cowan et al.
2011, Eur. Phys. J. C 71, 1554). Its lowest point is the estimate, whichever samples are taken, and noise
bends nothing.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebvander2d

from terrain_cli.estimation import joint_grid
from terrain_cli.estimation.joint_grid import Frame, JointGrid, Shape
from terrain_cli.estimation.wheel_fit.damped_search import descend
from terrain_cli.estimation.wheel_fit.fit_data import FitData
from terrain_cli.estimation.wheel_fit.fit_result import Parameters
from terrain_cli.estimation.wheel_fit.gauss_newton import accumulate, initial, inside
from terrain_cli.estimation.wheel_fit.linearised import Problem
from terrain_cli.estimation.wheel_fit.posterior import Posterior
from terrain_cli.estimation.wheel_fit.unknowns import Unknowns
from terrain_cli.mechanics.dual import value
from terrain_cli.vocabulary.arrays import Array

#: Samples of a window that are asked, points along each side at which, and steps of each search. Twice of
#: each, or two degrees more, change the deviations over the grids of sample_data by less than 0.5 %; by 2 %
#: in the window that does not separate c and φ.
_SAMPLES, _POINTS, _STEPS = 100, 7, 20
_DEGREE = 4  # Degree of the polynomial that goes between the points
_SETTLE = 3  # Iterations that bring the true values of the inputs along
#: Nearer to the estimate than this, in squared standard errors, rounding decides. A deviance of
#: less than this times the quadratic is as good as none, of more than that as good as infinite.
_NEAR, _LEAST, _FAR = 0.01, 1e-3, 1e5
#: Weight of the estimate itself among the points.
_SURE = 10.0
_PAIR = ("cohesion", "tan_phi")


def grids(
    problem: Problem,
    data: FitData,
    found: Posterior,
    about: Parameters,
    windows: Iterable[int],
    order: int | None,
) -> dict[int, JointGrid]:
    """Lay a grid about c and φ of some windows; none where one of them is fixed.

    The estimate is `found` in the units sought, `about` in its own.
    """
    if not {*_PAIR} <= {*about.names}:
        return {}
    local = {u.name: u for u in problem.unknowns.local}
    columns = [about.names.index(name) for name in _PAIR]
    data = replace(data, excess=found.excess)
    laid = {}
    for j in windows:
        covariance = about.covariance[j][np.ix_(columns, columns)]
        if data.count[j] == 0 or not joint_grid.possible(covariance):
            continue
        frame = joint_grid.Frame(np.array([about.values[name][j] for name in _PAIR]), covariance)
        if {*_PAIR} <= {*local}:
            ask = _Valley(problem, data, found, j, frame, order)
            # What a model that misses may be off is no curvature of the data: it is as normal as it is wide.
            shape = None if found.by_model[j].any() else ask.shape
            laid[j] = joint_grid.grid(frame, shape, ask.bounds)
        else:
            laid[j] = joint_grid.grid(frame)
    return laid


class _Valley:
    """One window, asked what it says of c and φ."""

    def __init__(
        self, problem: Problem, data: FitData, found: Posterior, j: int, frame: Frame, order: int | None
    ) -> None:
        self._frame, self._order = frame, order
        some = data.only(np.array([j]))
        few = some.thinned(_SAMPLES)
        # Some samples stand for all: each knows so much more.
        few = replace(few, excess=few.excess * few.count / some.count)
        # Counted from the estimate: priors pull to there, as the data do.
        self._local = tuple(
            replace(u, mean=u.mean + u.sd * t, lower=u.lower - t, upper=u.upper - t)
            for u, t in zip(problem.unknowns.local, found.t[j], strict=True)
        )
        held = {name: of if of.ndim == 0 else of[j] for name, of in problem.unknowns.fixed.items()}
        held |= {
            u.name: np.asarray(u.value(t)) for u, t in zip(problem.unknowns.shared, found.common, strict=True)
        }
        self._held = held
        self._problem = replace(problem, unknowns=Unknowns(self._local, (), held), robust=False)
        self._nothing = np.zeros(0)
        self._data = self._as_predicted(replace(few, windows=np.array([0])))
        self._pair = [[u.name for u in self._local].index(name) for name in _PAIR]
        self._others = [k for k in range(len(self._local)) if k not in self._pair]
        c, tan_phi = (self._local[k] for k in self._pair)
        self._units = np.array([c.sd, tan_phi.sd])
        low, high = (tan_phi.mean + tan_phi.sd * end for end in (tan_phi.lower, tan_phi.upper))
        self.bounds = (low, high)
        self._quadratic()

    def _as_predicted(self, data: FitData) -> FitData:
        """Return the samples with what the model says at the estimate in the place of what was measured."""
        t = np.zeros((1, len(self._local)))
        latent = initial(data, t, self._nothing).latent
        for _ in range(_SETTLE):
            accumulate(self._problem, data, t, self._nothing, latent, order=self._order)
        said = self._problem.predict(data, t, self._nothing, by=False, order=self._order, latent=latent)
        return replace(
            data,
            channels={**data.channels, **dict(zip(data.inputs, latent, strict=True))},
            measured=np.array([value(getattr(said, name)) for name in data.outputs]),
        )

    def _quadratic(self) -> None:
        """Find the covariance of c and φ that the samples alone stand for, and how the others move along."""
        t = np.zeros((1, len(self._local)))
        latent = initial(self._data, t, self._nothing).latent
        normal = accumulate(self._problem, self._data, t, self._nothing, latent, order=self._order)
        whole = normal.information[0] + np.eye(len(self._local))
        others = whole[np.ix_(self._others, self._others)]
        self._along = -np.linalg.solve(others, whole[np.ix_(self._others, self._pair)])
        inner = whole[np.ix_(self._pair, self._pair)] + whole[np.ix_(self._pair, self._others)] @ self._along
        self._own = np.linalg.inv(inner) * np.outer(self._units, self._units)

    def shape(self, reach: Array) -> Shape:
        """Return how much faster than its quadratic the deviance rises, within some reach, shape (2, 2)."""
        middle, half = reach.mean(axis=1), np.diff(reach, axis=1)[:, 0] / 2.0
        u, v = (
            axis.ravel()
            for axis in np.meshgrid(*(middle + half * chebpts1(_POINTS)[:, None]).T, indexing="ij")
        )
        away = self._frame.away(u, v)
        far = joint_grid.distance(away, self._frame.covariance) > _NEAR
        u, v, away = u[far], v[far], away[far]
        quadratic = joint_grid.distance(away, self._own)
        deviance = np.clip(self._deviance(away), _LEAST * quadratic, _FAR * quadratic)
        weight = 1.0 / (
            1.0 + deviance * joint_grid.distance(away, self._frame.covariance) / (4.0 * quadratic)
        )
        # At the estimate itself the quadratic is right.
        u, v = np.append(u, 0.0), np.append(v, 0.0)
        ratio, weight = np.append(np.log(deviance / quadratic), 0.0), np.append(weight, _SURE)
        terms = _terms(u, v, reach)
        coefficients, *_ = np.linalg.lstsq(terms * weight[:, None], ratio * weight, rcond=None)
        within = reach.copy()

        def smooth(u: Array, v: Array) -> Array:
            # Misfit that widens errors widens none beyond those of the prior.
            away = self._frame.away(u, v)
            prior = np.sum((away / self._units) ** 2, axis=-1)
            q = joint_grid.distance(away, self._frame.covariance)
            least = np.log(np.divide(prior, q, out=np.ones_like(q), where=q > _NEAR))
            # A polynomial through steep and flat places swings beyond both.
            between = np.clip(_terms(u, v, within) @ coefficients, np.log(_LEAST), np.log(_FAR))
            return np.asarray(np.maximum(between, least))

        return smooth

    def _deviance(self, away: Array) -> Array:
        """Return twice what the log posterior has lost at its highest point for c and φ."""
        number, count = len(away), int(self._data.count[0])
        at = self._frame.mean + away
        moved = away / self._units
        others = tuple(self._local[k] for k in self._others)
        held = {**self._held, **dict(zip(_PAIR, at.T, strict=True))}
        problem = replace(self._problem, unknowns=Unknowns(others, (), held))
        data = self._data.take(
            np.tile(np.arange(count), number), np.full(number, count), np.zeros(number, dtype=np.intp)
        )
        begun = inside(others, moved @ self._along.T)
        ends = descend(
            problem,
            replace(data, windows=np.arange(number)),
            begun,
            self._nothing,
            order=self._order,
            iterations=_STEPS,
        )
        return np.asarray(ends.merit + np.sum(moved**2, axis=1))


def _terms(u: Array, v: Array, reach: Array) -> Array:
    """Return the terms of a polynomial up to its degree."""
    middle, half = reach.mean(axis=1), np.diff(reach, axis=1)[:, 0] / 2.0
    a, b = (np.clip((axis - m) / h, -1.0, 1.0) for axis, m, h in zip((u, v), middle, half, strict=True))
    every = chebvander2d(a, b, [_DEGREE, _DEGREE])
    p, q = np.indices((_DEGREE + 1, _DEGREE + 1)).reshape(2, -1)
    return np.asarray(every[..., p + q <= _DEGREE])
