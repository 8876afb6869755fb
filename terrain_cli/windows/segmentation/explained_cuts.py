"""Cuts that something recorded explains: y follows slip, speed or attitude, and the soil is one.

A model without an effect that follows the drive needs a new soil at every turn. So y is given terms that all
windows share, γ1 d + γ2 d² + γ3 d x of a driver d, and windows are joined as long as a bound between them
gains less than the penalty. The terms of a driver cost as much as one change does: they must save two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.windows.segmentation.change_points import PENALTY
from terrain_cli.windows.segmentation.sensor_noise import correlation_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from terrain_cli.windows.segmentation.plain_windows import Bounds

    Array = NDArray[np.float64]

#: Fewest changes that a term can save.
_LEAST = 2
#: Share of its trace that is added to a matrix, lest a constant load make it singular.
_RIDGE = 1e-10


def needed(
    x: Array,
    y: Array,
    drivers: Sequence[Array],
    bounds: Bounds,
    fixed: NDArray[np.intp],
    penalty: float = PENALTY,
) -> Bounds:
    """Return the bounds that are needed whatever y follows of some drivers.

    x and y are in Pa; drivers that are not known everywhere are passed over. The `fixed` bounds, breaks of
    the series, stay. The penalty is what a change must gain, in units of the long-run variance of the
    residuals.
    """
    if len(np.setdiff1d(bounds[1:-1], fixed)) < _LEAST:
        return bounds
    scaled = [one for one in map(_standard, drivers) if one is not None]
    line, level = _standard(x), _standard(y)
    if line is None or level is None:
        return bounds
    terms: list[Array] = []
    while True:
        best, saved = None, 0.0
        for place, driver in enumerate(scaled):
            added = [driver, driver**2, driver * line]
            joined, lost = _joined(_Lines(line, [*terms, *added], level, bounds), fixed, penalty)
            gain = penalty * (len(bounds) - len(joined) - 1) - lost
            if gain > saved:
                best, saved = (place, added, joined), gain
        if best is None:
            return bounds
        place, added, bounds = best
        scaled.pop(place)
        terms += added


def _standard(values: Array) -> Array | None:
    """Return values of mean 0 and variance 1; None where they are not all known, or all the same."""
    spread = float(np.std(values))
    if not np.isfinite(spread) or spread <= np.finfo(float).eps * float(np.max(np.abs(values))):
        return None
    return np.asarray((values - values.mean()) / spread, float)


@dataclass(frozen=True)
class _Lines:
    """One line for each window, and terms that all share."""

    x: Array
    terms: Sequence[Array]
    y: Array
    bounds: Bounds

    def moments(self) -> Array:
        """Return the sums of products of 1, x, the terms and y in each window, shape (w, p, p)."""
        columns = [np.ones_like(self.x), self.x, *self.terms, self.y]
        size = len(columns)
        sums = np.empty((len(self.bounds) - 1, size, size))
        for i in range(size):
            for j in range(i + 1):
                sums[:, i, j] = sums[:, j, i] = np.add.reduceat(columns[i] * columns[j], self.bounds[:-1])
        return sums

    def scatter(self, moments: Array) -> float:
        """Return the long-run variance of the residuals."""
        shared = _solved(_without_lines(moments).sum(axis=0))
        own = np.linalg.solve(
            _regular(moments[:, :2, :2]), (moments[:, :2, -1] - moments[:, :2, 2:-1] @ shared)[..., None]
        )
        level, slope = np.repeat(own[..., 0], np.diff(self.bounds), axis=0).T
        explained = sum(value * term for value, term in zip(shared, self.terms, strict=True))
        residuals = self.y - level - slope * self.x - explained
        size = float(np.std(residuals))
        fitted = 2 * len(moments) + len(shared)
        return size**2 * correlation_factor(residuals / size, self.bounds[1:-1], fitted) if size else _RIDGE


def _joined(lines: _Lines, fixed: NDArray[np.intp], penalty: float) -> tuple[Bounds, float]:
    """Join windows; return the bounds that remain, and what the sum of squares rose by, in its unit."""
    bounds, moments = lines.bounds, lines.moments()
    unit = lines.scatter(moments)
    reduced = _without_lines(moments)
    total = reduced.sum(axis=0)
    begin = _left(total)
    while len(moments) > 1:
        pairs = _without_lines(moments[:-1] + moments[1:])
        gain = (_left(total - reduced[:-1] - reduced[1:] + pairs) - _left(total)) / unit
        gain[np.isin(bounds[1:-1], fixed)] = np.inf
        # Of neighbours the one that gains less goes first: without it the other may be needed.
        ends = np.concatenate([[np.inf], gain, [np.inf]])
        goes = (gain < penalty) & (gain <= ends[:-2]) & (gain < ends[2:])
        if not goes.any():
            break
        stays = np.concatenate([[True], ~goes])
        moments = np.add.reduceat(moments, np.flatnonzero(stays), axis=0)
        bounds = np.append(bounds[:-1][stays], bounds[-1])
        reduced = _without_lines(moments)
        total = reduced.sum(axis=0)
    return bounds, float(_left(total) - begin) / unit


def _without_lines(moments: Array) -> Array:
    """Return the moments of what the line of each window leaves (the Schur complement)."""
    lines = np.linalg.solve(_regular(moments[:, :2, :2]), moments[:, :2, 2:])
    return np.asarray(moments[:, 2:, 2:] - moments[:, 2:, :2] @ lines)


def _solved(moments: Array) -> Array:
    """Return the coefficients of the shared terms."""
    return np.asarray(
        np.linalg.solve(_regular(moments[..., :-1, :-1]), moments[..., :-1, -1:])[..., 0], float
    )


def _left(moments: Array) -> Array:
    """Return the sum of squares that lines and shared terms leave."""
    return np.asarray(moments[..., -1, -1] - np.sum(moments[..., :-1, -1] * _solved(moments), axis=-1))


def _regular(matrices: Array) -> Array:
    size = matrices.shape[-1]
    trace = np.asarray(np.trace(matrices, axis1=-2, axis2=-1), float)[..., None, None]
    return np.asarray(matrices + _RIDGE * (trace + np.finfo(float).tiny) * np.eye(size), float)
