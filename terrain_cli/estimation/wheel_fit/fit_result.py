"""The result of a fit of the wheel–soil model, the status of each window, and its row of the table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from terrain_cli.estimation.joint_grid import JointGrid
from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.line.window_estimates import (
    LARGEST_CONDITION,
    LARGEST_PHI_OPEN,
    STATUSES,
    WindowEstimates,
)
from terrain_cli.estimation.wheel_fit import normal_equations
from terrain_cli.estimation.wheel_fit.excess_scatter import lasting_squares
from terrain_cli.estimation.wheel_fit.fit_data import FitData, Noise
from terrain_cli.estimation.wheel_fit.posterior import Posterior
from terrain_cli.estimation.wheel_fit.unknowns import FAR, Unknown, Unknowns
from terrain_cli.mechanics.dual import value
from terrain_cli.mechanics.wheel_model import Model, Prediction
from terrain_cli.vocabulary.arrays import Array, Index, Mask, ratio
from terrain_cli.vocabulary.choices import LARGEST_PHI

#: A parameter that would be open by more than this many of its prior's standard deviations, had
#: all priors been ten times as wide, is known from the priors rather than from the data.
LARGEST_OPEN = 1.0
#: A standard error above this share of the prior's is the prior's own.
SURELY_TOLD = 0.95
_AT_BOUND = 1e-9
_PAIR = ("cohesion", "tan_phi")


@dataclass(frozen=True, kw_only=True)
class Parameters:
    """What a fit says of the parameters of windows."""

    # values, errors: shape (w,): every parameter of the soil and its standard error: 0 where it is fixed, the
    # same in all windows where it is shared, NaN in windows without samples. Of k and keq the median.
    values: dict[str, Array]
    errors: dict[str, Array]
    # shared, shared_errors: parameters with one value for all windows: those of the effects that are sought,
    # and those of the soil that were asked for
    shared: dict[str, float]
    shared_errors: dict[str, float]
    names: tuple[str, ...]  # Parameters sought: each window's own, then the shared ones
    # Shape (w, p, p): of these, in their own units; shared ones and their influence on the others included
    covariance: Array
    # Shape (w, p, p): the part of `covariance` that comes from priors which are off, or a model that misses:
    # the same in all windows of one soil
    assumed: Array
    shared_covariance: Array  # Shape (q, q)
    # sigma_star, strength, strength_se: shape (w,): stress at which the strength c + σ* tan φ is not
    # correlated with tan φ, or 0 where that is negative, that strength and its standard error, Pa. NaN where
    # c or φ is fixed.
    sigma_star: Array
    strength: Array
    strength_se: Array
    # Shape (w,): for each parameter sought, whether the data leave it open: had all priors been ten times as
    # wide, its standard error would exceed that of its prior as it is; or it ran to its bound. A shared one
    # is so in all windows or in none.
    undetermined: dict[str, Mask]
    # Mean and standard deviation of each parameter of a window's own, of k and keq those of the logarithm
    priors: dict[str, tuple[float, float]]
    # Shape (w,): for each parameter of a window's own, whether the data say anything of it: its standard
    # error is well below that of its prior
    told: dict[str, Mask]
    # Shape (w,): for each parameter of a window's own, whether the data would take it beyond what soils have:
    # φ beyond 0 to 60°. Value and error are then those of the soils that remain (a normal distribution cut
    # off at the bound).
    bounded: dict[str, Mask]
    # Shape (w,): standard error of φ had there been no prior on it, rad, from what noise cannot have feigned
    phi_open: Array


@dataclass(frozen=True, kw_only=True)
class Fit(Parameters):
    """Parameters of windows, with what must be known to trust them; SI units, tan φ as a number.

    Values ± 1.96 standard errors are 95 % intervals.
    """

    model: Model
    under: tuple[float, float]  # Load, N, and radius, m, with which parameters of effects grow
    n: Index  # Shape (w,): samples used
    noise: Noise
    # chi2, dof: shape (w,): sum of squares of the residuals in terms of the noise, and their degrees of
    # freedom
    chi2: Array
    dof: Array
    # Shape (w,): by how much the errors' variances were raised, as residuals are larger than the noise or
    # correlated in time. What may be chance is not counted.
    inflation: Array
    # Shape (w,): by how much larger the variances of the noise were taken to be than the sensors' own, as the
    # model misses a window by so much that otherwise its errors were larger than those of the priors; 1
    # elsewhere
    excess: Array
    torque_rmse: Array  # Shape (w,): of the torque predicted from the measured channels, N m
    # Shape (w,): whether what is left goes on for longer than noise does (`excess_scatter`)
    goes_on: Mask
    # Shape (w,): whether an effect of those suspected shows that would move c, φ or strength by more than
    # its error
    moved: Mask
    # Shape (w,): whether what is left follows the load, sinkage, slip or time (`missing_effects.following`)
    follows: Mask
    second: float  # Samples in a second; 0 where they do not follow each other in time
    converged: Mask  # Shape (w,)
    min_samples: int
    # Joint posterior of c and φ, of the windows of which it was asked for
    grids: dict[int, JointGrid] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.n)

    def of_windows(self, fixed: Mapping[str, ArrayLike]) -> dict[str, Array]:
        """Return every parameter of every window, the usual ones where there are no samples."""
        found, nulls = dict[str, Array](), self.model.nulls()
        for name in (*self.model.soil, *self.model.parameters):
            known = next(some[name] for some in (self.values, self.shared, fixed, nulls) if name in some)
            column = np.broadcast_to(np.asarray(known, dtype=float), self.n.shape)
            usual = np.median(column[np.isfinite(column)]) if np.isfinite(column).any() else 1.0
            found[name] = np.where(np.isfinite(column), column, usual)
        return found

    @property
    def phi(self) -> Array:
        """Friction angle, rad."""
        return np.asarray(np.arctan(self.values["tan_phi"]))

    @property
    def phi_se(self) -> Array:
        return np.asarray(self.errors["tan_phi"] / (1.0 + self.values["tan_phi"] ** 2))

    def correlation(self, a: str, b: str) -> Array:
        """Correlation of the errors of two parameters, NaN where one of them is fixed."""
        var_a, cov, var_b = _of_pair(self.names, self.covariance, a, b)
        return np.asarray(np.clip(ratio(cov, np.sqrt(var_a * var_b), np.nan), -1.0, 1.0))

    @property
    def condition_number(self) -> Array:
        """Condition number of the errors of c and tan φ, both scaled: 100 is a correlation of −0.9998."""
        r = np.abs(self.correlation("cohesion", "tan_phi"))
        with np.errstate(divide="ignore"):
            return np.asarray(np.sqrt((1.0 + r) / (1.0 - r)))

    def impossible(self, held: Mapping[str, ArrayLike]) -> Iterator[str]:
        """Say which parameters of effects are held where no wheel of this load and radius has them."""
        for name, parameter in self.model.parameters.items():
            own, value = parameter.under(*self.under), np.asarray(held.get(name, parameter.null))
            if not np.all((value >= own.lower) & (value <= own.upper)):
                found, low, high = (number / own.factor for number in (value.mean(), own.lower, own.upper))
                yield (
                    f"{name} is held at {found:.4g} {own.unit}; under such a wheel it is "
                    f"from {low:.4g} to {high:.4g} {own.unit}"
                )

    @property
    def separable(self) -> Mask:
        """Whether the data, without a prior on φ, tell c from φ: φ is then open by no more than ± 6°."""
        widest = np.fmax(self.phi_open, self.phi_se)
        return np.asarray((widest <= LARGEST_PHI_OPEN) & self.converged & self._told)

    @property
    def missed(self) -> Mask:
        """Whether what the model leaves is no noise: goes on for longer, or follows the inputs."""
        return np.asarray((self.excess > 1.0) | self.goes_on | self.follows | self._imitates)

    @cached_property
    def _imitates(self) -> Mask:
        """Whether an effect of a window's own is as nature has none: it imitates what is missing."""
        found = np.zeros(len(self), dtype=bool)
        for effect in self.model.effects:
            places = [place for place, name in enumerate(self.names) if name.startswith(f"{effect.id}.")]
            names = [self.names[place] for place in places if self.names[place] in self.priors]
            for window in np.flatnonzero(self.n > 0) if names else ():
                values = {
                    self.names[place]: float(self.values[self.names[place]][window]) for place in places
                }
                covariance = self.covariance[window][np.ix_(places, places)]
                found[window] |= any(effect.imitations([(values, covariance, {}, self.under)]))
        return found

    @property
    def _told(self) -> Mask:
        told = [self.told[name] for name in ("cohesion", "tan_phi") if name in self.told]
        return np.asarray(np.all([np.ones(len(self), dtype=bool), *told], axis=0))

    @property
    def status(self) -> NDArray[np.str_]:
        """Status of each window, by the names and the limits of `estimation.WindowEstimates`."""
        phi = self.phi
        at_bound = np.any([np.zeros(len(self), dtype=bool), *self.bounded.values()], axis=0)
        return np.select(
            [
                self.n < self.min_samples,
                ~((self.values["cohesion"] >= 0.0) & (phi >= 0.0) & (phi <= LARGEST_PHI)),
                at_bound,
                ~self._told,
                self.missed | self.moved,
                ~self.separable,
                self.condition_number > LARGEST_CONDITION,
            ],
            STATUSES[:-1],
            STATUSES[-1],
        )


def residuals_of(data: FitData, prediction: Prediction) -> tuple[Array, Array]:
    """Return what is measured less what is predicted, shape (outputs, n), 0 where there is none.

    Also the root mean square of the torque's, shape (w,), NaN where there is none.
    """
    predicted = np.array([value(getattr(prediction, output)) for output in data.outputs])
    left = np.nan_to_num(np.where(data.seen, data.measured - predicted, np.nan))
    if "torque" not in data.outputs:
        return left, np.full(len(data.windows), np.nan)
    row = data.outputs.index("torque")
    count = segment_sum(data.seen[row].astype(float), data.bounds)
    power = segment_sum(left[row] ** 2, data.bounds)
    return left, np.sqrt(ratio(power, count, np.nan))


def missed_share(data: FitData, residuals: Array) -> Array:
    """Return by which share of its size the torque is missed by more than white noise, shape (w,).

    Residuals are of shape (outputs, n), 0 where there is none; without a torque the share is 0.
    """
    if "torque" not in data.outputs:
        return np.zeros(len(data.windows))
    row = data.outputs.index("torque")
    lasting = lasting_squares(residuals[row : row + 1], data.bounds)[0]
    size = segment_sum(np.where(data.seen[row], data.measured[row] ** 2, 0.0), data.bounds)
    share = ratio(np.maximum(lasting, 0.0), size)
    return np.asarray(np.sqrt(share))


def parameters(
    soil: Sequence[str], sought: Unknowns, found: Posterior, known: Mask, spread: float
) -> Parameters:
    """Turn unknowns into parameters in their own units, as `Fit` has them.

    `known` are the windows with samples; `spread` is a factor on all standard errors, for noise that is
    itself estimated.
    """
    windows = len(found.t)
    unknowns, q = (*sought.local, *sought.shared), len(sought.shared)
    names = tuple(u.name for u in unknowns)
    inside = normal_equations.covariance(found.own, found.gain, found.shared) * spread**2
    t = np.concatenate([found.t, np.broadcast_to(found.common, (windows, q))], axis=1)
    if q and np.isfinite(inside).all():
        # What windows share is one for all: only their own unknowns go back to the prior.
        inside, moved = normal_equations.no_wider(inside, t)
        t[:, :-q] = moved[:, :-q]
    width = np.sqrt(np.maximum(np.einsum("waa->wa", inside), 0.0))
    wrong = np.zeros_like(inside)
    wrong[:, : len(sought.local), : len(sought.local)] = found.by_model
    blank = np.where(known, 1.0, np.nan)
    units = np.array([u.slope(t[:, column]) for column, u in enumerate(unknowns)])
    units = units.reshape(len(unknowns), windows)
    scale = units.T[:, :, None] * units.T[:, None, :] * blank[:, None, None]
    covariance = inside * scale
    values, errors, undetermined, told, bounded = {}, {}, {}, {}, {}
    for column, unknown in enumerate(unknowns):
        name, there = unknown.name, t[:, column]
        at_bound = at_end(unknown, there)
        if column < found.at_bound.shape[1]:
            at_bound = at_bound | found.at_bound[:, column]
            told[name] = (width[:, column] < SURELY_TOLD) & known
            # At a bound is also what the data do not tell; so far out only they can take it.
            bounded[name] = (at_bound & told[name]) | ((np.abs(there) > FAR) & known)
        undetermined[name] = (found.wide[:, column] > LARGEST_OPEN) | at_bound | ~known
        if name in soil:
            values[name] = unknown.value(there) * blank
            errors[name] = width[:, column] * units[column] * blank
    for name in soil:
        if name in sought.fixed:
            values[name] = np.broadcast_to(sought.fixed[name], (windows,)) * blank
            errors[name] = np.zeros(windows) * blank
    common = list(zip(sought.shared, np.asarray(found.common), strict=True))
    shared_units = np.array([float(u.slope(number)) for u, number in common])
    shared_covariance = found.shared * spread**2 * np.outer(shared_units, shared_units)
    shared_errors = np.sqrt(np.diagonal(shared_covariance)).tolist()
    return Parameters(
        values={name: values[name] for name in soil},
        errors={name: errors[name] for name in soil},
        shared={u.name: float(u.value(number)) for u, number in common},
        shared_errors={u.name: error for u, error in zip(sought.shared, shared_errors, strict=True)},
        names=names,
        covariance=covariance,
        # The estimate leans towards the prior means by the share that is not known from the data.
        assumed=((inside - wrong) @ (inside - wrong) + wrong) * scale,
        shared_covariance=shared_covariance,
        **strengths(names, covariance, values),
        undetermined=undetermined,
        priors={u.name: (u.mean, u.sd) for u in sought.local},
        told=told,
        bounded=bounded,
        phi_open=_open(names, found.sure, values["tan_phi"], unknowns) * blank,
    )


def strengths(names: tuple[str, ...], covariance: Array, values: Mapping[str, Array]) -> dict[str, Array]:
    """Return the stress at which the strength does not go with tan φ, and that strength, as `Fit` has it."""
    var_c, cov, var_t = _of_pair(names, covariance, *_PAIR)
    with np.errstate(invalid="ignore", divide="ignore"):
        # Where c and φ err the same way no stress makes their errors cancel, and none below 0 is one.
        pivot = np.maximum(-cov / var_t, 0.0) if {*_PAIR} <= {*names} else np.full(len(cov), np.nan)
        error = np.sqrt(np.maximum(var_c + 2.0 * pivot * cov + pivot**2 * var_t, 0.0))
    strength = values["cohesion"] + pivot * values["tan_phi"]
    return {"sigma_star": pivot, "strength": strength, "strength_se": error}


def at_end(unknown: Unknown, t: Array) -> Mask:
    """Tell which values are at a bound, in prior standard deviations from the prior mean."""
    return np.asarray((t <= unknown.lower + _AT_BOUND) | (t >= unknown.upper - _AT_BOUND))


def at_ends(unknowns: Unknowns, t: Array, common: Array) -> Mask:
    """Tell the same of all unknowns in each window, own and shared ones, shape (w, q + m)."""
    columns = [*t.T, *np.broadcast_to(common[:, None], (len(common), len(t)))]
    every = zip((*unknowns.local, *unknowns.shared), columns, strict=True)
    return np.array([at_end(*one) for one in every], dtype=bool).reshape(len(columns), len(t)).T


def _open(names: tuple[str, ...], sure: Array, tan_phi: Array, unknowns: Sequence[Unknown]) -> Array:
    """Return the standard error of φ without the information of its own prior.

    Removing one unit of information from an unknown of variance v leaves v/(1 − v).
    """
    if "tan_phi" not in names:
        return np.zeros(len(sure))
    column = names.index("tan_phi")
    variance = sure[:, column] ** 2
    rest = np.maximum(1.0 - variance, 0.0)
    alone = np.sqrt(ratio(variance, rest, np.inf))
    return np.asarray(alone * unknowns[column].sd / (1.0 + tan_phi**2))


def _of_pair(names: tuple[str, ...], covariance: Array, *pair: str) -> tuple[Array, Array, Array]:
    """Return var a, cov(a, b) and var b in each window; 0 where one of them is not sought."""
    known = np.pad(covariance, ((0, 0), (0, 1), (0, 1)))
    a, b = (names.index(name) if name in names else -1 for name in pair)
    return known[:, a, a], known[:, a, b], known[:, b, b]


def _parted(fit: Fit) -> dict[str, Any]:
    """Return c and tan φ with the errors from noise, and those from what is assumed."""
    found: dict[str, Any] = {"data_c": fit.values["cohesion"], "data_tan_phi": fit.values["tan_phi"]}
    for part, covariance in (("data", fit.covariance - fit.assumed), ("assumed", fit.assumed)):
        var_c, cov, var_t = _of_pair(fit.names, covariance, *_PAIR)
        c, t = (np.sqrt(np.maximum(variance, 0.0)) for variance in (var_c, var_t))
        both = c * t
        corr = np.clip(ratio(cov, both), -1.0, 1.0)
        found |= {f"{part}_c_se": c, f"{part}_tan_phi_se": t, f"{part}_corr": corr}
    return found


def as_window_estimates(fit: Fit, linear: WindowEstimates) -> WindowEstimates:
    """Put a fit in the place of linear estimates, which keep least squares and ridge."""
    soil: dict[str, Any] = {
        name: column
        for parameter in ("shear_modulus", "stiffness", "sinkage_exponent")
        if parameter in fit.values
        for name, column in ((parameter, fit.values[parameter]), (f"{parameter}_se", fit.errors[parameter]))
    }
    return replace(
        linear,
        n=fit.n,
        **soil,
        method=np.full(len(fit), fit.model.base),
        status=fit.status,
        separable=fit.separable,
        **_parted(fit),
        c=fit.values["cohesion"],
        c_se=fit.errors["cohesion"],
        phi=fit.phi,
        phi_se=fit.phi_se,
        corr=fit.correlation("cohesion", "tan_phi"),
        sigma_star=fit.sigma_star,
        strength=fit.strength,
        strength_se=fit.strength_se,
        torque_rmse=fit.torque_rmse,
        # Errors of the channels are in `phi_se`, and average out over windows.
        phi_bias=np.zeros(len(fit)),
    )
