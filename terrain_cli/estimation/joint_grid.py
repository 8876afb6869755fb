"""The joint posterior of c and tan φ on a grid, and with all other parameters of a window.

Lines of the grid have one φ, columns one strength c + σ tan φ at the pivot σ = −cov(c, tan φ)/var tan φ:
that strength and tan φ are not correlated, so that a narrow valley lies along the grid, not across it.

From the estimate outwards −2 log density is q ρ. q is the square of the distance in terms of the table's
covariance, and ρ says how much faster or slower the model itself departs from its best than its own quadratic
at the estimate; 1 for a line. Scaling a log-likelihood so keeps its shape, and gives it the curvature of
errors that misfit and correlation have widened (the vertical adjustment of Chandler & Bate 2007, Biometrika
94, 167).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from terrain_cli.vocabulary.arrays import Array

#: Returns log ρ at distances from the estimate along tan φ and along the strength, in standard errors.
Shape = Callable[[Array, Array], Array]

#: Points along each side of a grid, and how far it goes from the estimate, in standard errors.
SIDE, REACH = 41, 4.0
#: A grid goes further where its edge has more than this share of the greatest density: how much, how often.
_EDGE, _FURTHER, _ROUNDS = 0.01, 1.5, 2
#: How far the greatest density is from the mean at the most, in standard errors: further is a cut at a bound.
_FARTHEST = 0.5


@dataclass(frozen=True, kw_only=True)
class JointGrid:
    """Posterior of c and tan φ."""

    tan_phi: Array  # Shape (a,): of the lines
    strength: Array  # Shape (b,): of the columns: c + `pivot` tan φ, Pa
    pivot: float  # In Pa
    log_density: Array  # Shape (a, b): of c and tan φ; 0 where it is greatest

    @property
    def cohesion(self) -> Array:
        """Cohesion of each point in Pa, shape (a, b)."""
        return np.asarray(self.strength[None, :] - self.pivot * self.tan_phi[:, None])

    @property
    def probability(self) -> Array:
        """Probability of the cell about each point, shape (a, b); all add up to 1."""
        density = np.exp(self.log_density)
        return np.asarray(density / density.sum())


@dataclass(frozen=True, kw_only=True)
class JointPosterior:
    """What is known of all parameters of a window together."""

    window: int
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Array  # Shape (p,)
    covariance: Array  # Shape (p, p)
    # Shape (p, 2): mean and standard deviation of what is known of each beforehand; NaN where nothing is
    prior: Array
    grid: JointGrid | None  # None where c or φ is not sought


@dataclass(frozen=True)
class Frame:
    """The axes of a grid about an estimate."""

    mean: Array  # Shape (2,): c in Pa and tan φ
    covariance: Array  # Shape (2, 2)

    @property
    def pivot(self) -> float:
        """σ*; below 0 where c and φ err the same way."""
        return -float(self.covariance[0, 1] / self.covariance[1, 1])

    @property
    def errors(self) -> tuple[float, float]:
        """Standard errors of tan φ, and of the strength at the pivot."""
        along = np.array([1.0, self.pivot])
        return float(np.sqrt(self.covariance[1, 1])), float(np.sqrt(along @ self.covariance @ along))

    def away(self, u: Array, v: Array) -> Array:
        """Return how far points are from the estimate, in c and tan φ, shape (…, 2).

        u and v are along tan φ and along the strength, in their standard errors.
        """
        of_phi, of_strength = self.errors
        tan_phi = u * of_phi
        return np.stack([v * of_strength - self.pivot * tan_phi, tan_phi], axis=-1)


def distance(away: Array, covariance: Array) -> Array:
    """Return the squared distance of points, shape (…, 2), in terms of a covariance."""
    return np.asarray(np.einsum("...i,ij,...j->...", away, np.linalg.inv(covariance), away))


def possible(covariance: Array) -> bool:
    """Tell whether c and φ have errors about which a grid can be laid."""
    known = bool(np.isfinite(covariance).all()) and bool((np.diagonal(covariance) > 0.0).all())
    return (
        known and float(np.linalg.det(covariance / np.outer(*[np.sqrt(np.diagonal(covariance))] * 2))) > 0.0
    )


def grid(
    frame: Frame,
    shape: Callable[[Array], Shape] | None = None,
    bounds: tuple[float, float] = (-np.inf, np.inf),
) -> JointGrid:
    """Lay a grid about an estimate, with tan φ within bounds.

    `shape` returns within some reach the least and greatest distance along tan φ and along the strength,
    shape (2, 2); a normal distribution if not given.
    """
    ends = (np.asarray(bounds) - frame.mean[1]) / frame.errors[0]
    reach = np.array([[-REACH, REACH], [-REACH, REACH]])
    for left in reversed(range(_ROUNDS + 1)):
        reach[0] = np.clip(reach[0], *ends)
        found = shape(reach) if shape else None
        u, v = (np.linspace(low, high, SIDE) for low, high in reach)
        log_density = _centred(frame, found, u, v)
        if not left:
            break
        edge = np.array([log_density.max(axis=1)[[0, -1]], log_density.max(axis=0)[[0, -1]]])
        heavy = edge > np.log(_EDGE)
        heavy[0] &= np.abs(reach[0] - ends) > 0.0
        if not heavy.any():
            break
        reach = np.where(heavy, _FURTHER * reach, reach)
    of_phi, of_strength = frame.errors
    middle = frame.mean[0] + frame.pivot * frame.mean[1]
    return JointGrid(
        tan_phi=frame.mean[1] + of_phi * u,
        strength=middle + of_strength * v,
        pivot=frame.pivot,
        log_density=log_density,
    )


def _centred(frame: Frame, shape: Shape | None, u: Array, v: Array) -> Array:
    """Return the log density, moved until its mean is the estimate: of a skew one the top is elsewhere."""
    here = np.meshgrid(u, v, indexing="ij")
    log_density = _log_density(frame, shape, *here)
    if shape is None:
        return log_density
    weight = np.exp(log_density)
    way = [np.clip(np.sum(weight * axis) / weight.sum(), -_FARTHEST, _FARTHEST) for axis in here]
    return _log_density(frame, shape, *(axis + to for axis, to in zip(here, way, strict=True)))


def _log_density(frame: Frame, shape: Shape | None, u: Array, v: Array) -> Array:
    ratio = np.exp(shape(u, v)) if shape else 1.0
    found = -0.5 * distance(frame.away(u, v), frame.covariance) * ratio
    return np.asarray(found - found.max())
