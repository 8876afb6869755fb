"""Where a stretch of samples may change its line: exact search on blocks of samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation import lines
from terrain_cli.segmentation.noise import correlation_factor

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.segmentation.moments import Moments

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: Bounds are chosen exactly among up to so many places, ...
EXACT = 64
#: ... and where there are more, among so many at a time: what is chosen anywhere, and the seams
#: between, are the places of the next round.
CHUNK = 6
#: Rounds go on while they leave fewer than this share of the places.
_THINNING = 0.7
#: Windows whose costs are computed together: few enough to stay in the processor's cache.
_TOGETHER = 4096
#: Searches from which the correlation of the noise is learnt, and their samples at least.
_SURVEYED, _SURVEYED_SAMPLES = 32, 512
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


class _Chunks:
    """Costs of all windows within chunks of places, from which those least in sum are chosen.

    Parameters
    ----------
    moments : Moments
    limits : Limits
        Windows that begin or end at a seam may be shorter: they go on beyond it.
    places : ndarray of int, shape (size + 1, chunks)
        Blocks; the last of a chunk is the first of the next, or repeated where there are no more.
    """

    def __init__(self, moments: Moments, limits: Limits, places: Index) -> None:
        self._places = places
        a, b = _windows(len(places) - 1)
        self._cost = np.full((len(a), places.shape[1]), np.inf)
        together = max(1, _TOGETHER // len(a))
        for begin in range(0, places.shape[1], together):
            some = slice(begin, begin + together)
            allowed = _allowed(moments, limits, places[:, some], a, b)
            kept = np.flatnonzero(allowed.any(axis=1))
            total = moments.total[:, places[:, some]]
            windows = (total[:, b[kept]] - total[:, a[kept]]).reshape(lines.ROWS, -1)
            cost = lines.best_line(windows)[1].reshape(len(kept), -1)
            self._cost[kept, some] = np.where(allowed[kept], cost, np.inf)

    def optimum(self, penalty: float) -> NDArray[np.bool_]:
        """Tell which places have the least sum of costs and penalties (optimal partitioning)."""
        size, chunks = len(self._places) - 1, self._places.shape[1]
        least = np.zeros((size + 1, chunks))
        best = np.zeros((size + 1, chunks), dtype=np.intp)
        chunk = np.arange(chunks)
        for b in range(1, size + 1):
            total = least[:b] + self._cost[b * (b - 1) // 2 : b * (b + 1) // 2]
            total.argmin(axis=0, out=best[b])
            least[b] = total[best[b], chunk] + penalty
        chosen = np.zeros((size + 1, chunks), dtype=bool)
        chosen[[0, size]] = True
        at = np.full(chunks, size)
        while len(chunk):
            at = best[at, chunk]
            chosen[at, chunk] = True
            chunk, at = chunk[at > 0], at[at > 0]
        return chosen

    def bounds(self, penalty: float) -> Index:
        """Return the places chosen, rising."""
        return np.unique(self._places[self.optimum(penalty)])


@lru_cache(maxsize=8)
def _windows(size: int) -> tuple[Index, Index]:
    """Return first and last place of all windows of a chunk, those with the same last one together."""
    b, a = np.tril_indices(size + 1, k=-1)
    return a, b


def _allowed(moments: Moments, limits: Limits, places: Index, a: Index, b: Index) -> NDArray[np.bool_]:
    """Return which windows [a, b) of chunks are long enough, shape (windows, chunks)."""
    samples = moments.edges[places]
    allowed = limits.met(samples[a], samples[b])
    # Windows go on beyond a seam, and a stretch too short for any window is one.
    start, end = samples[0] == 0, samples[-1] == moments.edges[-1]
    allowed |= (a == 0)[:, None] & (~start | (samples[b] == samples[-1]))
    allowed |= (samples[b] == samples[-1]) & ~end
    return np.asarray(allowed & (samples[b] > samples[a]))


def _chunked(places: Index, size: int) -> Index:
    """Part places into chunks, as `_Chunks` takes them."""
    chunks = -(-(len(places) - 1) // size)
    index = np.arange(size + 1)[:, None] + size * np.arange(chunks)
    return np.asarray(places[np.minimum(index, len(places) - 1)])


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
    factor = _survey(moments, limits, penalty)
    places = np.arange(len(moments.edges), dtype=np.intp)
    while True:
        exact = len(places) - 1 <= EXACT
        chunks = _Chunks(moments, limits, _chunked(places, len(places) - 1 if exact else CHUNK))
        found = chunks.bounds(penalty * factor)
        if exact or len(found) > _THINNING * len(places):
            return moments.edges[found], factor
        places = found


def _survey(moments: Moments, limits: Limits, penalty: float) -> float:
    """Find the correlation that remains about the lines that it allows, in chunks all along the stretch.

    With the factor too low, correlated noise is cut into many windows that take some of it away,
    so the factor is raised until it explains itself.
    """
    patient = replace(limits, samples=max(limits.samples, _SURVEY_SAMPLES))
    blocks = len(moments.edges) - 1
    size = min(max(_SURVEYED_SAMPLES // moments.step, 16), EXACT, blocks)
    places = _chunked(np.arange(blocks + 1), size)
    places = places[:, :: -(-places.shape[1] // _SURVEYED)]
    chunks = _Chunks(moments, patient, places)
    factor = 1.0
    for _ in range(8):
        chosen = chunks.optimum(penalty * factor).T
        bounds, chunk = moments.edges[places.T[chosen]], np.nonzero(chosen)[0]
        inside = (chunk[1:] == chunk[:-1]) & (bounds[1:] > bounds[:-1])
        first, last = bounds[:-1][inside], bounds[1:][inside]
        residuals = _residuals(moments, first, last)
        found = correlation_factor(residuals, np.cumsum(last - first)[:-1], 2 * len(first))
        if found <= 1.25 * factor:
            return max(found, factor)
        factor = found
    return factor


def _residuals(moments: Moments, first: Index, last: Index) -> Array:
    """Distances from the lines of the windows [first, last), in standard deviations of the noise."""
    windows = moments.between(first, last)
    slope, _ = lines.best_line(windows)
    intercept = (windows[lines.Y] - slope * windows[lines.X]) / windows[lines.W]
    variance = lines.noise_across(windows, slope) * windows[lines.N] / windows[lines.W]
    sizes = last - first
    row = np.arange(sizes.sum()) + np.repeat(last - np.cumsum(sizes), sizes)
    away = moments.y[row] - np.repeat(slope, sizes) * moments.x[row] - np.repeat(intercept, sizes)
    return np.asarray(away / np.sqrt(np.repeat(variance, sizes)))
