"""The model at the current guess, as whitened linear equations for the unknowns.

Every channel is noisy, the ones that the model is evaluated at included. Their true values û are
therefore sought along with the parameters, sample by sample. About the current û the model is
F(û) + J (u − û) + A δ, so that the residual g = m − F(û) − J (u − û) of the measured u has the
covariance S = R + J R_u Jᵀ, and the true values that go best with it are u + R_u Jᵀ S⁻¹ g.

Taking J and A at û, and S as a constant of the step, keeps the estimating equations Σ Aᵀ S⁻¹ g = 0
free of bias: û and g are uncorrelated, whereas A at the measured u is not, which is what flattens
a line fitted to noisy abscissae. It is orthogonal distance regression (Boggs & Rogers 1990)
in the structure of Fuller, Measurement Error Models, 1987, section 3.2.
"""

from dataclasses import dataclass

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum, window_products
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE, FitData, Noise
from terrain_cli.estimation.wheel_fit.unknowns import Unknowns
from terrain_cli.mechanics.dual import slopes, value
from terrain_cli.mechanics.wheel_model import Given, Model, Prediction, WheelGeometry, predict
from terrain_cli.vocabulary.arrays import Array, Index

#: Part of an output's size that its error has at least: keeps S positive where noise is said to be none.
_LEAST = 1e-8
_NOTHING = 1e-3  # Share of the load below which a force, or a torque over the radius, is next to none
#: Huber's estimator by the number of channels together: the radius, in standard deviations, within
#: which the weight is 1, so that 5 % of the efficiency is lost on clean data, and the mean square of
#: a weighted residual then.
_RADIUS = np.array([np.inf, 1.345, 1.50, 1.63])
_SQUARE = np.array([1.0, 0.7102, 0.6753, 0.6437])
_FARTHEST = 8.0  # How far a true value may be from the measured one, in standard deviations of the sensor
#: Of a channel that is off by orders of magnitude the true values run away: what is not finite tells nothing.
_UNDEFINED_ALLOWED = np.errstate(over="ignore", invalid="ignore")


@dataclass(frozen=True, kw_only=True)
class Problem:
    """What is fitted, save the samples."""

    model: Model
    wheel: WheelGeometry
    given: Given
    unknowns: Unknowns
    noise: Noise
    robust: bool = False

    @_UNDEFINED_ALLOWED
    def predict(
        self,
        data: FitData,
        t: Array,
        common: Array,
        *,
        by: bool,
        order: int | None,
        latent: Array | None = None,
    ) -> Prediction:
        """Predict all samples of some windows, at t, shape (w, p), and common, shape (q,).

        `by`: differentiate by the unknowns, and by the inputs that are not exact; `latent`: true values of
        the inputs, by default those `given`, shape (inputs, n).
        """
        latent = data.given if latent is None else latent
        channels = {**data.channels, **dict(zip(data.inputs, latent, strict=True))}
        sought = (*self.unknowns.local, *self.unknowns.shared)
        noisy = [
            name for name in data.inputs if self.noise.relative.get(name) or self.noise.absolute.get(name)
        ]
        return predict(
            self.model,
            self.wheel,
            channels,
            self.unknowns.values(t, common, data.count, data.windows),
            given=self.given,
            by=(*(u.name for u in sought), *noisy) if by else (),
            order=order,
        )


@dataclass(frozen=True, kw_only=True)
class Equations:
    """Whitened equations of some samples."""

    residual: Array  # Shape (outputs, n): each of variance 1 in truth; 0 where an output is not seen
    design: Array  # Shape (outputs, p + q, n): its derivatives by the unknowns, with the sign turned
    # Shape (outputs, inputs, n): its derivatives by the inputs, per standard deviation of the input's noise,
    # with the sign turned
    inward: Array
    spread: Array  # Shape (inputs, n): those standard deviations
    weight: Array  # Shape (n,): of a sample; 1 unless the fit is robust
    factor: Array  # Shape (outputs, outputs, n): lower Cholesky factor of S
    own: Array  # Shape (outputs, n): variances of the outputs' own noise: the diagonal of R
    size: Array  # Shape (n,): root mean square of a residual by its weight on clean data

    @property
    def bounded(self) -> Array:
        """Residuals by their weights, of variance 1 on clean data."""
        return self.residual * (self.weight / self.size)

    def unwhitened(self) -> Array:
        """Return the design in the units of the outputs, shape (outputs, p + q, n)."""
        return np.asarray(np.einsum("abn,bpn->apn", self.factor, self.design))

    @_UNDEFINED_ALLOWED
    def latent(self, data: FitData) -> Array:
        """Return the true values of the inputs that go best with the residuals, shape (inputs, n)."""
        most = _FARTHEST / np.sqrt(np.repeat(data.excess, data.count))
        offset = np.clip(np.einsum("akn,an->kn", self.inward, self.residual), -most, most)
        return data.possible(data.given + self.spread * offset)

    @_UNDEFINED_ALLOWED
    def ways(self) -> Array:
        """Return how these true values move with the unknowns, shape (inputs, p + q, n)."""
        return np.asarray(-self.spread[:, None] * np.einsum("akn,apn->kpn", self.inward, self.design))

    def normal(self, bounds: Index) -> tuple[Array, Array, Array]:
        """Return information, score and misfit of each window.

        The misfit is the sum of squares of the residuals; of the weighted ones, in terms of what clean data
        would give, where the fit is robust.
        """
        weighted = self.design * self.weight
        information = window_products(weighted, self.design, bounds)
        score = segment_sum(np.einsum("mpn,mn->pn", weighted, self.residual), bounds).T
        misfit = segment_sum(np.einsum("mn,mn->n", self.bounded, self.bounded), bounds)
        return information, score, misfit


@_UNDEFINED_ALLOWED
def equations(
    problem: Problem, data: FitData, t: Array, common: Array, latent: Array, *, order: int | None = None
) -> Equations:
    """Linearise the model about a guess of the unknowns and of the true values of the inputs."""
    sought = problem.unknowns
    prediction = problem.predict(data, t, common, by=True, order=order, latent=latent)
    size, n = len(sought.local) + len(sought.shared), latent.shape[1]
    count = data.count
    chain = np.repeat(sought.slopes(t, common).T, count, axis=1)
    names = [u.name for u in (*sought.local, *sought.shared)]
    excess = np.repeat(data.excess, count)
    spread = np.sqrt(
        [problem.noise.variance(name, row) * excess for name, row in zip(data.inputs, latent, strict=True)]
    )
    spread[np.repeat(data.steady, count, axis=1)] = 0.0
    measured = data.given

    # Columns: the residual, the unknowns, the inputs.
    table = np.zeros((len(data.outputs), 1 + size + len(data.inputs), n))
    own = np.empty((len(data.outputs), n))
    for row, name in enumerate(data.outputs):
        number = getattr(prediction, name)
        predicted, by = value(number), slopes(number)
        table[row, 0] = data.measured[row] - predicted
        for column, (unknown, outer) in enumerate(zip(names, chain, strict=True)):
            if unknown in by:
                table[row, 1 + column] = by[unknown] * outer
        for column, source in enumerate(data.inputs):
            if source in by:
                table[row, 0] -= by[source] * (measured[column] - latent[column])
                table[row, 1 + size + column] = by[source] * spread[column]
        if name == BALANCE:
            own[row] = (_LEAST * value(prediction.load)) ** 2
        else:
            large = _large(problem, name, prediction, predicted, data)
            own[row] = (
                problem.noise.variance(name, large) * excess + (_LEAST * large) ** 2 + np.finfo(float).tiny
            )
    # Where the model gives no number, at this guess, the sample has no say.
    told = data.seen & np.isfinite(own) & np.isfinite(table).all(axis=1)
    table = np.where(told[:, None], table, 0.0)
    own = np.where(told, own, 1.0)
    factor = _cholesky(table[:, 1 + size :], own)
    solve_lower(factor, table)
    residual = table[:, 0]
    weight, size_of = np.ones(n), np.ones(n)
    if problem.robust:
        size_of = np.sqrt(_SQUARE)[data.seen.sum(axis=0)]
        radius = np.sqrt(np.einsum("mn,mn->n", residual, residual))
        limit = _RADIUS[data.seen.sum(axis=0)]
        weight = np.divide(limit, radius, out=weight, where=radius > limit)
    return Equations(
        residual=residual,
        design=table[:, 1 : 1 + size],
        inward=table[:, 1 + size :],
        spread=spread,
        weight=weight,
        factor=factor,
        own=own,
        size=size_of,
    )


def _large(problem: Problem, name: str, prediction: Prediction, predicted: Array, data: FitData) -> Array:
    """Keep forces and torques from nothing, where noise that is a share of them would weigh without end."""
    load = data.channels.get("load") if prediction.load is None else value(prediction.load)
    if name not in {"torque", "drawbar_pull"} or load is None:
        return predicted
    lever = problem.wheel.radius if name == "torque" else 1.0
    least = _NOTHING * lever * np.abs(load)
    return np.asarray(np.maximum(np.abs(predicted), least))


def _cholesky(inward: Array, own: Array) -> Array:
    """Return the lower factor of S = R + J R_u Jᵀ, with J per standard deviation of the inputs."""
    covariance = np.einsum("akn,bkn->abn", inward, inward)
    factor = np.zeros_like(covariance)
    for a in range(len(own)):
        for b in range(a):
            rest = covariance[a, b] - sum(factor[a, c] * factor[b, c] for c in range(b))
            factor[a, b] = rest / factor[b, b]
        rest = covariance[a, a] - sum(factor[a, c] ** 2 for c in range(a))
        factor[a, a] = np.sqrt(np.maximum(rest, 0.0) + own[a])
    return np.asarray(factor)


def solve_lower(factor: Array, table: Array) -> Array:
    """Multiply a table (outputs, columns, n) by the inverse of a lower triangle of each sample, in place."""
    for a in range(len(table)):
        for b in range(a):
            table[a] -= factor[a, b] * table[b]
        table[a] /= factor[a, a]
    return table
