"""Where a stretch of samples may change its line: exact search on blocks of samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation import lines
from terrain_cli.segmentation.noise import correlation_factor

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from terrain_cli.segmentation.moments import Moments

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: Blocks searched together. The costs of all their windows make one array, so that the time grows
#: with the number of samples; the seams between searches are candidates like all others.
CHUNK = 128
#: Searches from which the correlation of the noise is learnt.
_SURVEYED = 16
#: Least length of their windows: shorter ones would take the correlation for soil.
_SURVEY_SAMPLES = 40


@dataclass(frozen=True)
class Limits:
    """Least size of a window.

    Parameters
    ----------
    samples : int
    metres : float
    driven : ndarray, shape (n + 1,), optional
        Metres up to each bound a window may have.
    """

    samples: int
    metres: float = 0.0
    driven: Array | None = None

    def met(self, first: Index, last: Index) -> NDArray[np.bool_]:
        """Return which of the windows [first, last) are long enough."""
        enough = np.asarray(last - first >= self.samples)
        if self.driven is not None:
            # 0.1 m is reached by samples that lie 0.1 m apart, whatever the rounding.
            enough &= self.driven[last] - self.driven[first] >= self.metres * (1.0 - 1e-9)
        return enough


@dataclass(frozen=True)
class _Chunk:
    """Blocks from `first`, and cost[b, a] of a window of blocks a up to b; inf where too short."""

    first: int
    cost: Array

    def without(self, moments: Moments, limits: Limits) -> _Chunk:
        """Return the same without the windows that other limits do not allow."""
        blocks = len(self.cost) - 1
        a, b = _windows(blocks)
        cost = np.full_like(self.cost, np.inf)
        kept = _allowed(moments, limits, self.first, self.first + blocks)
        cost[b[kept], a[kept]] = self.cost[b[kept], a[kept]]
        return _Chunk(self.first, cost)

    def optimum(self, penalty: float) -> Index:
        """Cut the chunk at the least sum of costs and penalties (optimal partitioning)."""
        blocks = len(self.cost) - 1
        least = np.full(blocks + 1, np.inf)
        least[0] = 0.0
        best = np.zeros(blocks + 1, dtype=np.intp)
        for last in range(1, blocks + 1):
            total = least[:last] + self.cost[last, :last]
            best[last] = total.argmin()
            least[last] = total[best[last]] + penalty
        bounds = [blocks]
        while bounds[-1] > 0:
            bounds.append(int(best[bounds[-1]]))
        return np.array(bounds[::-1]) + self.first


def candidates(moments: Moments, limits: Limits, penalty: float) -> tuple[Index, float]:
    """Search for bounds among which all changes of the line are.

    Parameters
    ----------
    moments : Moments
    limits : Limits
    penalty : float
        Least gain of a bound, for white noise.

    Returns
    -------
    bounds : ndarray of int
        Samples, from 0 to n.
    factor : float
        By which the noise's correlation raises what a bound gains by chance.
    """
    blocks = len(moments.edges) - 1
    firsts = np.linspace(0, blocks, -(-blocks // CHUNK) + 1).astype(int)
    pieces = list(pairwise(firsts.tolist()))
    surveyed = pieces[:: -(-len(pieces) // _SURVEYED)]
    patient = replace(limits, samples=max(limits.samples, _SURVEY_SAMPLES))
    known = {piece: _chunk(moments, limits, *piece) for piece in surveyed}
    factor = _survey(moments, [chunk.without(moments, patient) for chunk in known.values()], penalty)
    found = []
    for piece in pieces:
        chunk = known[piece] if piece in known else _chunk(moments, limits, *piece)
        found.append(chunk.optimum(penalty * factor))
    return moments.edges[np.unique(np.concatenate(found))], factor


def _chunk(moments: Moments, limits: Limits, first: int, last: int) -> _Chunk:
    a, b = _windows(last - first)
    allowed = _allowed(moments, limits, first, last)
    if not allowed.all():
        a, b = a[allowed], b[allowed]
    cost = np.full((last - first + 1, last - first + 1), np.inf)
    cost[b, a] = lines.best_line(moments.between_blocks(a + first, b + first))[1]
    return _Chunk(first, cost)


def _allowed(moments: Moments, limits: Limits, first: int, last: int) -> NDArray[np.bool_]:
    """Return which windows of a chunk are long enough."""
    a, b = _windows(last - first)
    allowed = limits.met(moments.edges[a + first], moments.edges[b + first])
    # Windows go on beyond a seam, and a stretch too short for any window is one.
    allowed |= (a == 0) & ((first > 0) | (b == last - first))
    allowed |= (b == last - first) & (last < len(moments.edges) - 1)
    return allowed


@lru_cache(maxsize=4)
def _windows(blocks: int) -> tuple[Index, Index]:
    a, b = np.triu_indices(blocks + 1, k=1)
    return a, b


def _survey(moments: Moments, chunks: Sequence[_Chunk], penalty: float) -> float:
    """Find the correlation that remains about the lines that it allows.

    With the factor too low, correlated noise is cut into many windows that take some of it away,
    so the factor is raised until it explains itself.
    """
    factor = 1.0
    for _ in range(8):
        residuals, starts, fitted, n = [], [], 0, 0
        for chunk in chunks:
            bounds = moments.edges[chunk.optimum(penalty * factor)]
            residuals.append(_residuals(moments, bounds))
            starts.append(bounds[:-1] - bounds[0] + n)
            fitted += 2 * (len(bounds) - 1)
            n += bounds[-1] - bounds[0]
        found = correlation_factor(np.concatenate(residuals), np.concatenate(starts)[1:], fitted)
        if found <= 1.25 * factor:
            return max(found, factor)
        factor = found
    return factor


def _residuals(moments: Moments, bounds: Index) -> Array:
    """Distances from the lines of the windows, in standard deviations of the noise."""
    windows = moments.between(bounds[:-1], bounds[1:])
    slope, _ = lines.best_line(windows)
    intercept = (windows[lines.Y] - slope * windows[lines.X]) / windows[lines.W]
    variance = lines.noise_across(windows, slope) * windows[lines.N] / windows[lines.W]
    sizes = np.diff(bounds)
    rows = slice(bounds[0], bounds[-1])
    away = moments.y[rows] - np.repeat(slope, sizes) * moments.x[rows] - np.repeat(intercept, sizes)
    return np.asarray(away / np.sqrt(np.repeat(variance, sizes)))
