"""What a stretch of samples is in blocks of equal length, of which the last may be shorter.

Everything that is asked of all samples is summed here, in one pass over them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.segmentation.windows import distinct

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: Rows of `measure`: sums of x, y, x², xy and y²;
POWERS, POWER_X, POWER_Y = slice(0, 5), 2, 4
#: of the steps |Δx| and |Δy| to the samples, and the largest step to or from a sample;
STEPS, LARGEST_STEPS = slice(5, 7), slice(7, 9)
#: of squares and products of the second differences of x and y, of their size |Δ²x| + s |Δ²y|, and
#: the largest size.
SECONDS, SIZE, LARGEST_SIZE = slice(9, 12), 12, 13
ROWS = 14

#: Samples worked on at a time: few enough to stay in the processor's cache.
_SLAB = 32_768
#: Runs of samples that lie closer are worked on as one.
_GAP = 2048


def sizes(n: int, step: int) -> Index:
    """Return the number of samples of each block.

    Parameters
    ----------
    n : int
        Samples, at least 1.
    step : int
        Samples in a block.

    Returns
    -------
    ndarray of int, shape (blocks,)
    """
    return np.diff(np.append(np.arange(0, n, step, dtype=np.intp), n))


def slabs(n: int, step: int) -> Iterator[tuple[int, int]]:
    """Part samples into runs of whole blocks.

    Parameters
    ----------
    n, step : int
        As for `sizes`.

    Yields
    ------
    first, last : int
        Samples first to last − 1.
    """
    length = max(1, _SLAB // step) * step
    for first in range(0, n, length):
        yield first, min(first + length, n)


def about(place: Index, n: int, step: int) -> Iterator[tuple[int, int]]:
    """Part the blocks that depend on some samples into runs, none longer than those of `slabs`.

    Parameters
    ----------
    place : ndarray of int, shape (k,)
    n, step : int
        As for `sizes`.

    Yields
    ------
    first, last : int
        As from `slabs`.
    """
    block = distinct(np.clip(place[:, None] + np.arange(-1, 2), 0, n - 1).ravel() // step)
    slab = block // max(1, _SLAB // step)
    runs = np.flatnonzero((np.diff(block) * step > _GAP) | (np.diff(slab) > 0)) + 1
    for run in np.split(block, runs):
        yield int(run[0]) * step, min(int(run[-1] + 1) * step, n)


def measure(
    x: Array, y: Array, step: int, scale: float, parts: Iterable[tuple[int, int]], out: Array
) -> None:
    """Sum what is to be known of the samples over blocks.

    Parameters
    ----------
    x, y : ndarray, shape (n,)
    step : int
        Samples in a block.
    scale : float
        s, which brings y to the scale of x.
    parts : iterable of (int, int)
        Those of `slabs` or `about` to measure.
    out : ndarray, shape (14, blocks)
        Filled for the blocks of these parts. The first sample of all has no step to it, and neither
        the first nor the last a second difference.
    """
    n, length = len(x), min(max(1, _SLAB // step) * step, -(-len(x) // step) * step)
    values, rises, seconds = np.empty(length), np.empty((2, length + 1)), np.empty((2, length))
    starts = np.arange(0, length, step)
    for first, last in parts:
        count = -(-(last - first) // step)
        blocks, samples = out[:, first // step : first // step + count], count * step
        u, v = (
            series[first:last].reshape(-1, step)
            if last - first == samples
            else np.append(series[first:last], np.zeros(samples - (last - first))).reshape(-1, step)
            for series in (x, y)
        )
        for row, factors in enumerate(((u,), (v,), (u, u), (u, v), (v, v))):
            np.einsum("ij->i" if len(factors) == 1 else "ij,ij->i", *factors, out=blocks[row])
        begin, end = max(first, 1), min(last + 1, n)
        for k, series in enumerate((x, y)):
            rise, second = rises[k, : samples + 1], seconds[k, :samples]
            rise[0] = rise[end - first :] = second[0] = second[n - 1 - first :] = 0.0
            np.subtract(series[begin:end], series[begin - 1 : end - 1], out=rise[begin - first : end - first])
            inner = slice(begin - first, min(last, n - 1) - first)
            np.subtract(rise[inner.start + 1 : inner.stop + 1], rise[inner], out=second[inner])
            np.abs(rise, out=rise)
            np.einsum("ij->i", rise[:-1].reshape(-1, step), out=blocks[STEPS][k])
            np.maximum.reduceat(rise[:-1], starts[:count], out=blocks[LARGEST_STEPS][k])
            np.maximum(blocks[LARGEST_STEPS][k], rise[step::step], out=blocks[LARGEST_STEPS][k])
        d, e = (second[:samples].reshape(-1, step) for second in seconds)
        for row, factors in enumerate(((d, d), (d, e), (e, e)), SECONDS.start):
            np.einsum("ij,ij->i", *factors, out=blocks[row])
        size = values[:samples]
        np.multiply(seconds[1, :samples], scale, out=size)
        np.abs(size, out=size)
        size += np.abs(seconds[0, :samples], out=seconds[0, :samples])
        np.einsum("ij->i", size.reshape(-1, step), out=blocks[SIZE])
        np.maximum.reduceat(size, starts[:count], out=blocks[LARGEST_SIZE])


def together(block: Index, step: int) -> Iterator[Index]:
    """Part blocks into as many at a time as stay in the processor's cache.

    Parameters
    ----------
    block : ndarray of int, shape (k,)
    step : int

    Yields
    ------
    ndarray of int
        At least once.
    """
    number = max(1, _SLAB // (2 * step))
    for first in range(0, max(len(block), 1), number):
        yield block[first : first + number]


def differences(values: Array, block: Index, step: int) -> tuple[Array, Array]:
    """Return steps and second differences of the samples of some blocks.

    Beyond either end of the stretch the last sample is repeated.

    Parameters
    ----------
    values : ndarray, shape (n,)
    block : ndarray of int, shape (k,)
        Rising.
    step : int

    Returns
    -------
    rises : ndarray, shape (k, step + 1)
        To each sample, and behind the last.
    seconds : ndarray, shape (k, step)
    """
    n, whole = len(values), len(values) // step
    rows = np.empty((len(block), step + 2))
    if whole:
        rows[:, 1:-1] = values[: whole * step].reshape(-1, step).take(block, axis=0, mode="clip")
    if len(block) and block[-1] == whole:
        rows[-1, 1:-1] = values[np.minimum(whole * step + np.arange(step), n - 1)]
    rows[:, 0] = values[np.maximum(block * step - 1, 0)]
    rows[:, -1] = values[np.minimum((block + 1) * step, n - 1)]
    # All in one row: differences across the seams between rows are cut off.
    rises, seconds = np.empty((2, *rows.shape))
    flat, second = rises.ravel(), seconds.ravel()
    np.subtract(rows.ravel()[1:], rows.ravel()[:-1], out=flat[:-1])
    np.subtract(flat[1:], flat[:-1], out=second[:-1])
    return rises[:, :-1], seconds[:, :-2]
