"""Second moments of windows, all that least squares and its errors need; and the line, equation [26].

Window j is the samples bounds[j] to bounds[j + 1] − 1. A window's means are taken off before
anything is multiplied: stresses of 10⁴ Pa that vary by 100 Pa would lose half their digits.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Bounds, Mask

Key = tuple[int, int, int]

#: Rows of a block of columns: the two stresses and the four channels they are made of.
X, Y, LOAD, TORQUE, SINKAGE, SLIP = range(6)
CHANNELS = (LOAD, TORQUE, SINKAGE, SLIP)

#: (lag, row, row) of the products that a line needs, ...
LINE: tuple[Key, ...] = ((0, X, X), (0, X, Y), (0, Y, Y))
#: ... and those that its uncertainty needs.
KEYS: tuple[Key, ...] = (
    *LINE,
    *((lag, a, b) for lag in (1, 2) for a, b in ((X, X), (X, Y), (Y, Y))),
    *((0, channel, other) for channel in CHANNELS for other in (channel, X, Y)),
    *((1, channel, other) for channel in CHANNELS for other in (channel, X)),
)

#: Samples of long windows, which are worked on one by one, so many at a time: few enough to stay in
#: the processor's cache, and for BLAS not to take threads.
_LONG = 4096
_SHORT = 20  # Samples of a window from which on BLAS is quicker, window by window, than all windows at once
ROUNDING = 1e-9  # A spread below this share of the mean is rounding


@dataclass(frozen=True)
class WindowMoments:
    """Means of windows and sums of products about the means."""

    count: Array  # Shape (w,)
    mean: Array  # Shape (6, w): of x, y, load, torque, sinkage and slip
    # Shape (w,): Σ ½ (a(t) b(t − lag) + b(t) a(t − lag)) over the deviations a, b of two rows
    products: dict[Key, Array]

    def __getitem__(self, key: Key) -> Array:
        return self.products[key]

    def varies(self, row: int) -> Mask:
        """Whether a row varies by more than rounding."""
        return np.asarray(self[0, row, row] > self.count * (ROUNDING * self.mean[row]) ** 2)


def segment_sum(values: Array, bounds: Bounds) -> Array:
    """Sum the last axis within each window; an empty window sums to zero."""
    filled = bounds[1:] > bounds[:-1]
    if filled.all() and len(filled):
        # Nearly always, and half the time.
        return np.asarray(np.add.reduceat(values, bounds[:-1], axis=-1))
    total = np.zeros((*values.shape[:-1], len(filled)))
    if filled.any():
        total[..., filled] = np.add.reduceat(values, bounds[:-1][filled], axis=-1)
    return total


def window_products(weighted: Array, rows: Array, bounds: Bounds) -> Array:
    """Sum `weighted` times rows, (…, outputs, p, n), over outputs and each window: (w, …, p, p)."""
    *_, size, n = rows.shape
    total = np.empty((len(bounds) - 1, *rows.shape[:-3], size, size))
    if n < _SHORT * len(total):
        for a in range(size):
            product = (weighted[..., a, None, :] * rows[..., : a + 1, :]).sum(axis=-3)
            sums = np.moveaxis(segment_sum(product, bounds), -1, 0)
            total[..., a, : a + 1] = total[..., : a + 1, a] = sums
        return total
    turned = np.swapaxes(rows, -1, -2)
    for j, (first, last) in enumerate(pairwise(bounds)):
        total[j] = (weighted[..., first:last] @ turned[..., first:last, :]).sum(axis=-3)
    return total


def of_windows(columns: Sequence[Array] | Array, bounds: Bounds, keys: Sequence[Key] = KEYS) -> WindowMoments:
    """Moments of every window, of x, y, load, torque, sinkage and slip; for `LINE` x and y will do."""
    count = np.diff(bounds)
    if len(count) and len(columns[0]) >= _LONG * len(count):
        return join([_of_long_window([row[a:b] for row in columns], keys) for a, b in pairwise(bounds)])
    columns = np.asarray(columns)
    if len(count) and count[0] and (count == count[0]).all():
        return _of_equal_windows(columns.reshape(len(columns), -1, count[0]), bounds, keys)
    mean = segment_sum(columns, bounds) / np.maximum(count, 1)
    deviation = columns - np.repeat(mean, count, axis=-1)
    products = {key: segment_sum(product, bounds) for key, product in _products(deviation, bounds, keys)}
    return WindowMoments(count.astype(float), mean, products)


def _of_long_window(columns: Sequence[Array], keys: Sequence[Key]) -> WindowMoments:
    """Moments of one window, all products of a lag at once."""
    rows, length = len(columns), len(columns[0])
    mean = np.array([np.einsum("n->", row) for row in columns]) / max(length, 1)
    lags = max(lag for lag, _, _ in keys)
    total = np.zeros((lags + 1, rows, rows))
    # Nothing comes before the first sample.
    deviation = np.zeros((rows, lags + _LONG))
    for first in range(0, length, _LONG):
        last = min(first + _LONG, length)
        begin = max(first - lags, 0)
        some = deviation[:, : lags + last - first]
        for row, level, own in zip(columns, mean, some, strict=True):
            np.subtract(row[begin:last], level, out=own[lags - (first - begin) :])
        # A copy, as BLAS takes a routine for an array with itself that is slow for few rows.
        late = some[:, lags:].copy()
        for lag in range(lags + 1):
            total[lag] += late @ some[:, lags - lag : some.shape[1] - lag].T
    products = {(lag, a, b): np.array([0.5 * (total[lag, a, b] + total[lag, b, a])]) for lag, a, b in keys}
    return WindowMoments(np.array([float(length)]), mean[:, None], products)


def _of_equal_windows(columns: Array, bounds: Bounds, keys: Sequence[Key]) -> WindowMoments:
    """Moments of windows of one length, columns of shape (6, w, length): in half the time."""
    rows, windows, length = columns.shape
    mean = np.einsum("rwn->rw", columns) / length
    deviation = columns - mean[:, :, None]
    products = {
        key: np.einsum("wn,wn->w", deviation[key[1]], deviation[key[2]]) for key in keys if not key[0]
    }
    lagged = [key for key in keys if key[0]]
    for key, product in _products(deviation.reshape(rows, -1), bounds, lagged):
        products[key] = np.einsum("wn->w", product.reshape(windows, length))
    return WindowMoments(np.full(windows, float(length)), mean, products)


def join(parts: Sequence[WindowMoments]) -> WindowMoments:
    """Put the windows of several blocks, all with the same products, behind one another."""
    return WindowMoments(
        np.concatenate([part.count for part in parts]),
        np.concatenate([part.mean for part in parts], axis=1),
        {key: np.concatenate([part.products[key] for part in parts]) for key in parts[0].products},
    )


def running(columns: Array) -> WindowMoments:
    """Moments of the first 1, 2, …, n samples of one window, of the same columns, shape (6, n)."""
    size = columns.shape[1]
    count = np.arange(1.0, size + 1.0)
    origin = columns.mean(axis=1, keepdims=True)
    deviation = columns - origin
    total = np.cumsum(deviation, axis=1)
    mean = total / count
    products = {}
    for (lag, a, b), product in _products(deviation, np.array([0, size]), KEYS):
        # The sums are about the final mean; move them to the mean so far.
        early, late = np.zeros_like(total), np.zeros_like(total)
        early[:, lag:] = total[:, : size - lag]
        late[:, lag:] = total[:, lag:] - (total[:, lag - 1 : lag] if lag else 0.0)
        both = early + late
        products[lag, a, b] = (
            np.cumsum(product)
            - 0.5 * (mean[a] * both[b] + mean[b] * both[a])
            + np.maximum(count - lag, 0.0) * mean[a] * mean[b]
        )
    return WindowMoments(count, origin + mean, products)


def _products(deviation: Array, bounds: Bounds, keys: Sequence[Key]) -> Iterator[tuple[Key, Array]]:
    """Yield the products, each at its later sample and zero where the earlier one is of another window."""
    for lag, a, b in keys:
        if lag == 0:
            yield (lag, a, b), deviation[a] * deviation[b]
            continue
        product = np.zeros(deviation.shape[1])
        product[lag:] = deviation[a, lag:] * deviation[b, :-lag]
        if a != b:
            product[lag:] = 0.5 * (product[lag:] + deviation[b, lag:] * deviation[a, :-lag])
        for step in range(lag):
            first = bounds[:-1] + step
            product[first[first < bounds[-1]]] = 0.0
        yield (lag, a, b), product


@dataclass(frozen=True)
class Line:
    """Lines through the mean points of windows."""

    tan_phi: Array  # Shape (w,): NaN where x does not vary
    cohesion: Array  # Shape (w,): c in Pa
    residual: Array  # Shape (w,): sum of the squared residuals, Pa²; about the mean where x does not vary
    # Shape (w,): of the design [1, x] with both columns scaled to unit length (Belsley, Kuh & Welsch 1980):
    # √((1 + m)/(1 − m)) with m = mean(x)/rms(x), about 2/(coefficient of variation of x)
    condition_number: Array


def fit_line(moments: WindowMoments) -> Line:
    spread, mean_x = moments[0, X, X], moments.mean[X]
    with np.errstate(divide="ignore", invalid="ignore"):
        tan_phi = np.where(moments.varies(X), moments[0, X, Y] / spread, np.nan)
        variance = spread / moments.count
        rms = np.sqrt(mean_x**2 + variance)
        # (1 + m)²/(1 − m²): 1 − m itself would cancel where x hardly varies.
        condition = np.where(
            moments.varies(X), (1.0 + np.abs(mean_x) / rms) * rms / np.sqrt(variance), np.inf
        )
    return Line(
        tan_phi,
        moments.mean[Y] - tan_phi * mean_x,
        np.maximum(moments[0, Y, Y] - np.nan_to_num(tan_phi) * moments[0, X, Y], 0.0),
        condition,
    )
