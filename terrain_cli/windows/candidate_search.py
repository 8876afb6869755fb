"""Where a stretch of samples may change its line: exact search on blocks of samples."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index, Mask
from terrain_cli.windows import line_costs
from terrain_cli.windows.running_moments import FINE, LONG, RunningMoments, correlation_factor

EXACT = 64  # Bounds are chosen exactly among up to so many places, ..
#: ... and where there are more, among so many at a time: what is chosen anywhere, and the seams
#: between, are the places of the next round.
CHUNK = 6
#: Of the blocks of long drives only the seams between so many are places for bounds, and where
#: something happens between two seams, places `FINE` samples apart.
_CALM = 4
#: Something happens where residuals about one line wander by this share of what a bound must gain:
#: of the gain of a step in the middle they show a quarter, by chance 0.2 in one group of ten at most.
_RESTLESS = 0.2
_THINNING = 0.7  # Rounds go on while they leave fewer than this share of the places
_TOGETHER = 512  # Chunks whose costs are computed together: few enough to stay in the processor's cache
#: Searches from which the correlation of the noise is learnt, and their samples at least.
_SURVEYED, _SURVEYED_SAMPLES = 32, 512
_SURVEY_SAMPLES = 40  # Least length of their windows: shorter ones would take the correlation for soil


@dataclass(frozen=True)
class Limits:
    """Least size of a window."""

    samples: int
    metres: float = 0.0
    driven: Array | None = None  # Metres up to each bound a window may have; shape (n + 1,)

    def met(self, first: Index, last: Index) -> Mask:
        """Return which of the windows [first, last) are long enough."""
        enough = np.asarray(last - first >= self.samples)
        if self.driven is not None:
            # 0.1 m is reached by samples that lie 0.1 m apart, whatever the rounding.
            enough &= self.driven[last] - self.driven[first] >= self.metres * (1.0 - 1e-9)
        return enough


class _Places(NamedTuple):
    """Where bounds may be, rising: samples, shape (k,), and the sums before them, shape (10, k)."""

    samples: Index
    sums: Array


class _Chunks:
    """Costs of all windows within chunks of places, from `_chunked`, and those least in sum."""

    def __init__(self, places: _Places, limits: Limits, index: Index) -> None:
        self._places, self._index = places, index
        # First and last place of all windows of a chunk, those with the same last one together.
        b, a = np.tril_indices(len(index), k=-1)
        self._cost = np.full((len(a), index.shape[1]), np.inf)
        for begin in range(0, index.shape[1], _TOGETHER):
            some = slice(begin, begin + _TOGETHER)
            allowed = _allowed(limits, places.samples[index[:, some]], places.samples[-1], a, b)
            kept = np.flatnonzero(allowed.any(axis=1))
            sums = places.sums.take(index[:, some], axis=1)
            windows = sums.take(b[kept], axis=1)
            windows -= sums.take(a[kept], axis=1)
            cost = line_costs.best_line(windows.reshape(line_costs.ROWS, -1))[1].reshape(len(kept), -1)
            self._cost[kept, some] = np.where(allowed[kept], cost, np.inf)

    def optimum(self, penalty: float) -> Mask:
        """Tell which places have the least sum of costs and penalties (optimal partitioning)."""
        size, chunks = len(self._index) - 1, self._index.shape[1]
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

    def chosen(self, penalty: float) -> _Places:
        found = np.zeros(len(self._places.samples), dtype=bool)
        found[self._index[self.optimum(penalty)]] = True
        return _Places(self._places.samples[found], self._places.sums[:, found])


def _allowed(limits: Limits, samples: Index, n: int, a: Index, b: Index) -> Mask:
    """Return which windows [a, b) of chunks are long enough, shape (windows, chunks)."""
    allowed = limits.met(samples[a], samples[b])
    # Windows go on beyond a seam, and a stretch too short for any window is one.
    start, end = samples[0] == 0, samples[-1] == n
    allowed |= (a == 0)[:, None] & (~start | (samples[b] == samples[-1]))
    allowed |= (samples[b] == samples[-1]) & ~end
    return np.asarray(allowed & (samples[b] > samples[a]))


def _chunked(places: int, size: int) -> Index:
    """Part places into chunks, shape (size + 1, chunks): the last of one begins the next, or is repeated."""
    chunks = -(-(places - 1) // size)
    index = np.arange(size + 1)[:, None] + size * np.arange(chunks)
    return np.asarray(np.minimum(index, places - 1))


def candidates(moments: RunningMoments, limits: Limits, penalty: float) -> tuple[Index, float]:
    """Search for bounds among which all changes of the line are; return how far noise raises `penalty`."""
    factor = _survey(moments, limits, penalty)
    places = _promising(moments, penalty * factor)
    while True:
        count = len(places.samples)
        exact = count - 1 <= EXACT
        chunks = _Chunks(places, limits, _chunked(count, count - 1 if exact else CHUNK))
        found = chunks.chosen(penalty * factor)
        if exact or len(found.samples) > _THINNING * count:
            return found.samples, factor
        places = found


def _promising(moments: RunningMoments, penalty: float) -> _Places:
    """Return places among which the bounds are: in long drives few where all is calm.

    What a change of soil leaves about one line through a few blocks is a residual whose sum first
    rises and then falls, or that of its products with x does.
    """
    if moments.step < LONG:
        return _Places(moments.edges, moments.total)
    groups = len(moments.samples) // (moments.step * _CALM)
    total = moments.total[:, : groups * _CALM + 1]
    ends = total[:, ::_CALM]
    parts = np.stack([total[: line_costs.YY, k:-1:_CALM] for k in range(1, _CALM)], axis=1)
    parts -= ends[: line_costs.YY, None, :-1]
    restless = _wanders(np.diff(ends, axis=1), parts, _RESTLESS * penalty)
    # The seams, what is left at the end, and all places of groups that are not calm.
    kept = np.ones(len(moments.edges), dtype=bool)
    group = kept[: groups * _CALM].reshape(groups, _CALM)
    group[:, 1:], group[restless, 0] = False, False
    block = (np.flatnonzero(restless)[:, None] * _CALM + np.arange(_CALM)).ravel()
    return _finer(moments, np.flatnonzero(kept), block)


def _finer(moments: RunningMoments, edges: Index, block: Index) -> _Places:
    """Return some edges of blocks, and places within other, whole blocks from their beginning on."""
    samples, sums = moments.finer(block)
    samples = np.concatenate([moments.edges[edges], samples.ravel()])
    order = np.argsort(samples, kind="stable")
    sums = np.concatenate([moments.total[:, edges], sums.reshape(line_costs.ROWS, -1)], axis=1)
    return _Places(samples[order], sums.take(order, axis=1))


def _wanders(windows: Array, parts: Array, limit: float) -> Mask:
    """Tell in which windows the residuals about one line do not stay about it.

    `windows`, shape (10, k), are moments, and `parts`, shape (5, m, k), those W to XY of more and more of
    their first samples. The limit is of the squared range of sums of residuals, over the variance of one.
    """
    slope, _ = line_costs.best_line(windows)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        variance = line_costs.noise_across(windows, slope)
        x = windows[line_costs.X] / windows[line_costs.W]
        # Residuals y − t x − c, and their products with x − mean(x): all with both off their mean.
        level = (windows[line_costs.Y] - slope * windows[line_costs.X]) / windows[line_costs.W]
        share = parts[line_costs.W] / windows[line_costs.W]
        away = parts[line_costs.Y] - slope * parts[line_costs.X] - level * parts[line_costs.W]
        tilt = parts[line_costs.XY] - slope * parts[line_costs.XX] - level * parts[line_costs.X]
        tilt -= x * away
        whole = windows[line_costs.XY] - slope * windows[line_costs.XX] - level * windows[line_costs.X]
        tilt -= share * whole
        calm = np.ones(len(slope), dtype=bool)
        for sums, weight in ((away, windows[line_costs.W]), (tilt, line_costs.scatter(windows)[0])):
            spread = np.maximum(sums.max(axis=0), 0.0) - np.minimum(sums.min(axis=0), 0.0)
            calm &= spread**2 <= limit * weight * variance
    return ~calm


def _survey(moments: RunningMoments, limits: Limits, penalty: float) -> float:
    """Find the correlation that remains about the lines that it allows, in chunks all along the stretch.

    With the factor too low, correlated noise is cut into many windows that take some of it away,
    so the factor is raised until it explains itself.
    """
    patient = replace(limits, samples=max(limits.samples, _SURVEY_SAMPLES))
    places, index = _surveyed(moments)
    chunks = _Chunks(places, patient, index)
    factor = 1.0
    for _ in range(8):
        chosen = chunks.optimum(penalty * factor).T
        bounds, chunk = places.samples[index.T[chosen]], np.nonzero(chosen)[0]
        inside = (chunk[1:] == chunk[:-1]) & (bounds[1:] > bounds[:-1])
        first, last = bounds[:-1][inside], bounds[1:][inside]
        residuals = residuals_about(moments, first, last)
        found = correlation_factor(residuals, np.cumsum(last - first)[:-1], 2 * len(first))
        if found <= 1.25 * factor:
            return max(found, factor)
        factor = found
    return factor


def _surveyed(moments: RunningMoments) -> tuple[_Places, Index]:
    """Return places, and those of each chunk of the survey."""
    blocks = len(moments.edges) - 1
    if moments.step < LONG:
        size = min(max(_SURVEYED_SAMPLES // moments.step, 16), EXACT, blocks)
        index = _chunked(blocks + 1, size)
        return _Places(moments.edges, moments.total), index[:, :: -(-index.shape[1] // _SURVEYED)]
    size = _SURVEYED_SAMPLES // LONG
    first = np.arange(0, len(moments.samples) // LONG - size + 1, size)
    first = first[:: -(-len(first) // _SURVEYED)]
    block = (first[:, None] + np.arange(size)).ravel()
    places = _finer(moments, np.setdiff1d(np.append(first + size, blocks), block), block)
    index = np.arange(_SURVEYED_SAMPLES // FINE + 1)[:, None]
    return places, index + np.searchsorted(places.samples, first * LONG)


def residuals_about(moments: RunningMoments, first: Index, last: Index) -> Array:
    """Distances from the lines of the windows [first, last), in standard deviations of the noise."""
    windows = moments.between(first, last)
    slope, _ = line_costs.best_line(windows)
    intercept = (windows[line_costs.Y] - slope * windows[line_costs.X]) / windows[line_costs.W]
    variance = line_costs.noise_across(windows, slope) * windows[line_costs.N] / windows[line_costs.W]
    sizes = last - first
    row = np.arange(sizes.sum()) + np.repeat(last - np.cumsum(sizes), sizes)
    x, y = moments.samples.at(row)
    away = y - np.repeat(slope, sizes) * x - np.repeat(intercept, sizes)
    return np.asarray(away / np.sqrt(np.repeat(variance, sizes)))
