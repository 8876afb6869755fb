"""Residuals of several channels, whitened: their noise is correlated, since it comes from the same inputs.

The noise of sinkage, slip and load is in the residuals of torque, drawbar pull and sinkage at once, so
that what one of them misses by foretells the others. A sample's residuals are multiplied by the inverse
of a root of their covariance: what is left has variance 1 in every channel and nothing in common.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.estimation.wheel_fit.fit_data import level
from terrain_cli.vocabulary.arrays import Array, Index

_MOST = 0.98  # Correlations beyond this are not believed: the covariance must keep an inverse
_ZERO = 1e-30  # No channel is so small in its SI unit


@dataclass(frozen=True)
class Whitening:
    """Covariance of the noise of the residuals of a wheel."""

    channels: tuple[str, ...]
    covariance: Array  # shape (c, c)

    def __call__(self, tables: Mapping[str, Array], known: NDArray[np.bool_]) -> Array:
        """Whiten what stands in the place of residuals, (n, ...) by channel, to (n, c, ...).

        Residuals that are not `known`, (n, c), have no part, and their places are 0.
        """
        return self._by_root(np.stack([tables[name] for name in self.channels], axis=1), known, inverse=True)

    def undone(self, white: Array, known: NDArray[np.bool_]) -> dict[str, Array]:
        """Return residuals by channel, (n,), from what was whitened, (n, c); 0 where not known."""
        found = self._by_root(white, known, inverse=False)
        return {name: found[:, column] for column, name in enumerate(self.channels)}

    def _by_root(self, stacked: Array, known: NDArray[np.bool_], *, inverse: bool) -> Array:
        """Multiply each sample by the root of the covariance of what is known of it, or by its inverse."""
        # Nearly all samples have every channel, and to pick them out costs more than the product.
        result = _each(self._whole[inverse], stacked)
        if known.all():
            return result
        pattern = known @ (1 << np.arange(len(self.channels)))
        whole = (1 << len(self.channels)) - 1
        result[pattern < whole] = 0.0
        for code in np.unique(pattern[(pattern > 0) & (pattern < whole)]):
            rows = np.flatnonzero(pattern == code)
            there = np.flatnonzero(known[rows[0]])
            matrix = self._root(there, inverse=inverse)
            result[np.ix_(rows, there)] = _each(matrix, stacked[np.ix_(rows, there)])
        return result

    @cached_property
    def _whole(self) -> tuple[Array, Array]:
        """The root of the covariance of all channels, and its inverse."""
        there = np.arange(len(self.channels))
        return self._root(there, inverse=False), self._root(there, inverse=True)

    def _root(self, there: Index, *, inverse: bool) -> Array:
        """Return the root of the covariance of the channels that are there, or its inverse."""
        root = np.linalg.cholesky(self.covariance[np.ix_(there, there)])
        return np.asarray(np.linalg.inv(root) if inverse else root)


def _each(matrix: NDArray[Any], stacked: Array) -> Array:
    """Multiply a matrix of the channels by each sample of (n, c, …), in one product of matrices."""
    if stacked.ndim == 2:
        return np.asarray(stacked @ matrix.T)
    n, c, width = stacked.shape
    found = matrix @ stacked.transpose(1, 0, 2).reshape(c, n * width)
    return np.ascontiguousarray(found.reshape(c, n, width).transpose(1, 0, 2))


def of_residuals(
    errors: Mapping[str, Array], levels: Mapping[str, float], group: Index | None, memory: int
) -> Whitening:
    """Estimate the covariance of residuals from what changes within a few samples.

    `levels` has the standard deviation of each channel's noise, NaN where the data do not tell; `memory` is
    the number of samples after which the noise is another one. Samples of different groups are no neighbours,
    and test points, whose `group` is None, have none.
    """
    names = tuple(errors)
    residuals = np.stack([errors[name] for name in names], axis=1)
    known = np.isfinite(residuals)
    total = np.where(known, residuals, 0.0) ** 2
    rms = np.sqrt(total.sum(axis=0) / np.maximum(known.sum(axis=0), 1))
    told = np.array([levels[name] for name in names])
    deviation = _sized(np.where(np.isfinite(told), np.maximum(told, criteria.LEAST_NOISE * rms), rms))
    correlation = np.eye(len(names))
    change = _changes(residuals, group, max(1, memory))
    for a in range(len(names)):
        for b in range(a):
            both = np.isfinite(change[:, a]) & np.isfinite(change[:, b])
            if both.sum() >= criteria.NOISE_SAMPLES:
                # By ranks of size: a few jumps would say nothing of the noise.
                one, other = (_clipped(change[both, c]) for c in (a, b))
                size = float(np.sqrt((one @ one) * (other @ other)))
                found = float(one @ other) / size if size > 0.0 else 0.0
                correlation[a, b] = correlation[b, a] = np.clip(found, -_MOST, _MOST)
    return Whitening(names, _definite(correlation) * np.outer(deviation, deviation))


def of_channels(measured: Mapping[str, Array], group: Index) -> Whitening:
    """Take for noise what changes from sample to sample in the channels themselves, without correlations.

    Samples are in their order in time; those of different groups are no neighbours.
    """
    deviation = []
    for column in measured.values():
        second = column[:-2] - 2.0 * column[1:-1] + column[2:]
        second = np.abs(second[(group[2:] == group[:-2]) & np.isfinite(second)]) / np.sqrt(6.0)
        size = level(column)
        noise = (
            float(np.median(second)) / 0.6745
            if len(second) >= criteria.NOISE_SAMPLES
            else criteria.NOISE_OF_POINTS * size
        )
        deviation.append(max(noise, criteria.LEAST_NOISE * size))
    return Whitening(tuple(measured), np.diag(np.square(_sized(np.array(deviation)))))


def _sized(deviation: Array) -> Array:
    # What is zero in every sample has no size to be judged by, and any will do whose square has an inverse.
    return np.where(deviation > _ZERO, deviation, 1.0)


def _changes(residuals: Array, group: Index | None, lag: int) -> Array:
    if group is None or len(residuals) <= lag:
        return np.zeros((0, residuals.shape[1]))
    same = group[lag:] == group[:-lag]
    return np.asarray((residuals[lag:] - residuals[:-lag])[same])


def _clipped(values: Array) -> Array:
    limit = 4.0 * float(np.median(np.abs(values)))
    return np.clip(values, -limit, limit)


def _definite(correlation: Array) -> Array:
    """Return the nearest matrix that can be a correlation."""
    size, axes = np.linalg.eigh(correlation)
    mended = (axes * np.maximum(size, 1.0 - _MOST)) @ axes.T
    root = np.sqrt(np.diag(mended))
    return np.asarray(mended / np.outer(root, root))
