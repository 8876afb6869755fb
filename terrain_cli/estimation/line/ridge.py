"""Ridge regression of the line, equation [27], with δ chosen by cross-validation.

The paper penalises c² + tan²φ, a sum of unlike units: δ would change with the unit of stress.
Here the columns 1 and x of the design are first scaled to unit root mean square, so that both
parameters, c and rms(x) tan φ, are stresses, and

    Σ (y − c − x tan φ)² + n δ (c² + (rms(x) tan φ)²)

is minimised. δ has no unit and does not depend on n. The scaled design has the eigenvalues
1 ± m, m = mean(x)/rms(x), so a δ well below 1 leaves the strength at the mean stress as it is
and acts on the split of it between c and φ alone, which is what a window of almost constant
stress leaves open: δ draws both parts towards equal shares, c = x tan φ.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from terrain_cli.estimation.line.moments import WindowMoments, X, Y, segment_sum
from terrain_cli.vocabulary.arrays import Array, Bounds

DELTAS = np.logspace(-8.0, 0.0, 17)  # Values of δ tried: two per decade

_LONG = 512  # Samples of a window from which on windows are worked on one by one, for all δ, ..
_TOGETHER = 1024  # ... so many samples at a time: few enough to stay in the processor's cache.


@dataclass(frozen=True)
class Ridge:
    cohesion: Array  # cohesion, tan_phi: shape (w,): c in Pa
    tan_phi: Array
    # Shape (w,): the δ of `DELTAS` with the smallest error of prediction; the least of them if equal
    delta: Array
    # Shape (2, 2, w): derivatives of (stress at the mean x, tan φ) by those of the least-squares line
    gain: Array


def losses(x: Array, y: Array, bounds: Bounds, moments: WindowMoments, *, folds: int | None) -> Array:
    """Sum the squared errors of what is left out, by δ, (17, w): of `folds` blocks, or of single samples."""
    design = _scaled(moments)
    if folds is None:
        return _leave_one_out(design, x, y, bounds)
    return _leave_block_out(design, x, y, bounds, folds)


def choose(moments: WindowMoments, loss: Array) -> Ridge:
    """Fit each window with the δ of which the error of prediction (`losses`) is least."""
    design = _scaled(moments)
    delta = DELTAS[np.argmin(loss, axis=0)]
    cohesion, slope, (cohesion_mean, cohesion_shared, slope_mean, slope_shared) = _solve(design, delta)
    gain = np.array(
        [
            [
                cohesion_mean + design.mean_x * slope_mean,
                (cohesion_shared + design.mean_x * slope_shared) * design.variance * design.scale,
            ],
            [slope_mean / design.scale, slope_shared * design.variance],
        ]
    )
    return Ridge(cohesion, slope / design.scale, delta, gain)


@dataclass(frozen=True, kw_only=True)
class _Design:
    """Windows with the columns 1 and x / scale; sums are divided by n."""

    count: Array
    scale: Array
    mean_x: Array
    mean_y: Array
    variance: Array
    covariance: Array
    plus: Array
    minus: Array


def _scaled(moments: WindowMoments) -> _Design:
    count, varies = np.maximum(moments.count, 1.0), moments.varies(X)
    variance = np.where(varies, moments[0, X, X], 0.0) / count
    scale = np.sqrt(moments.mean[X] ** 2 + variance)
    scale = np.where(scale > 0.0, scale, 1.0)
    mean_x, variance = moments.mean[X] / scale, variance / scale**2
    # The eigenvalues 1 ± m; their product is the variance, and the smaller one would cancel.
    larger = 1.0 + np.abs(mean_x)
    smaller = variance / larger
    return _Design(
        count=count,
        scale=scale,
        mean_x=mean_x,
        mean_y=moments.mean[Y],
        variance=variance,
        covariance=np.where(varies, moments[0, X, Y], 0.0) / (count * scale),
        plus=np.where(mean_x < 0.0, smaller, larger),
        minus=np.where(mean_x < 0.0, larger, smaller),
    )


def _solve(design: _Design, delta: Array | float) -> tuple[Array, Array, tuple[Array, Array, Array, Array]]:
    """Return c, rms(x) tan φ and the derivatives of both by the mean of y and the covariance of x and y."""
    plus, minus = 0.5 / (design.plus + delta), 0.5 / (design.minus + delta)
    even, odd = plus * design.plus, minus * design.minus
    gains = (even + odd, plus - minus, even - odd, plus + minus)
    cohesion = gains[0] * design.mean_y + gains[1] * design.covariance
    slope = gains[2] * design.mean_y + gains[3] * design.covariance
    return cohesion, slope, gains


def _leave_one_out(design: _Design, x: Array, y: Array, bounds: Bounds) -> Array:
    """Sum the squared residuals of samples left out, shape (deltas, w)."""
    cohesion, slope, _ = _solve(design, DELTAS[:, None])
    # Shares of the leverage of a sample.
    plus, minus = (
        0.5 / (design.count * (eigenvalue + DELTAS[:, None])) for eigenvalue in (design.plus, design.minus)
    )
    loss = np.empty(cohesion.shape)
    if len(x) < _LONG * len(design.count):
        scaled = x / np.repeat(design.scale, np.diff(bounds))
        even, odd = (1.0 + scaled) ** 2, (1.0 - scaled) ** 2
        window = np.repeat(np.arange(len(design.count)), np.diff(bounds))
        for row, (c, t, p, m) in enumerate(zip(cohesion, slope, plus, minus, strict=True)):
            kept = 1.0 - p[window] * even
            kept -= m[window] * odd
            residual = (y - c[window] - t[window] * scaled) / np.maximum(kept, 1e-12)
            loss[row] = segment_sum(residual * residual, bounds)
        return loss
    for j, (begin, end) in enumerate(pairwise(bounds)):
        fit = cohesion[:, j], slope[:, j], plus[:, j], minus[:, j]
        loss[:, j] = _of_one(design.scale[j], x[begin:end], y[begin:end], *fit)
    return loss


def _of_one(
    scale: float, x: Array, y: Array, cohesion: Array, slope: Array, plus: Array, minus: Array
) -> Array:
    """Sum the squared residuals of samples left out of one window, shape (deltas,)."""
    total = np.zeros(len(DELTAS))
    # Both are sums of three rows, for all δ a product of matrices, too small for BLAS to take threads.
    ones = np.ones_like(slope)
    factors = np.array([[ones, -cohesion, -slope], [ones, -plus, -minus]]).transpose(0, 2, 1)
    factors = np.ascontiguousarray(factors)
    for first in range(0, len(x), _TOGETHER):
        scaled, part = x[first : first + _TOGETHER] / scale, y[first : first + _TOGETHER]
        ones = np.ones_like(scaled)
        residual, kept = factors @ np.array(
            [[part, ones, scaled], [ones, (1.0 + scaled) ** 2, (1.0 - scaled) ** 2]]
        )
        residual /= np.maximum(kept, 1e-12, out=kept)
        total += np.einsum("ij,ij->i", residual, residual)
    return total


def _leave_block_out(design: _Design, x: Array, y: Array, bounds: Bounds, folds: int) -> Array:
    """Sum the squared residuals of blocks left out, shape (deltas, w)."""
    count = np.diff(bounds)
    starts = bounds[:-1, None] + count[:, None] * np.arange(folds) // folds
    edges = np.append(starts.ravel(), bounds[-1])
    block = np.repeat(np.arange(len(edges) - 1), np.diff(edges))
    scaled = x / design.scale[block // folds]
    held = segment_sum(np.array([np.ones_like(x), scaled, scaled * scaled, y, scaled * y]), edges)
    held = held.reshape(5, len(count), folds)
    ones, x1, x2, y1, xy = held.sum(axis=2, keepdims=True) - held
    loss = np.empty((len(DELTAS), len(count)))
    for row, delta in enumerate(DELTAS):
        # The penalty n δ is that of the whole window, whose fit is being judged.
        penalty = design.count[:, None] * delta
        determinant = (ones + penalty) * (x2 + penalty) - x1 * x1
        cohesion = ((x2 + penalty) * y1 - x1 * xy) / determinant
        slope = ((ones + penalty) * xy - x1 * y1) / determinant
        residual = y - cohesion.ravel()[block] - slope.ravel()[block] * scaled
        loss[row] = segment_sum(residual * residual, bounds)
    return loss
