"""Windows that need no search: everything, by a label, by length."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from terrain_cli.vocabulary.arrays import Array, Bounds

    Breaks = Sequence[int] | NDArray[np.integer]


def whole_windows(n: int, *, breaks: Breaks = ()) -> Bounds:
    """Return one window for each stretch between breaks: samples before which a new run begins, or a gap is.

    Window j is ``[bounds[j], bounds[j + 1])``. The first bound is 0, the last is n.
    """
    at = np.asarray(breaks, dtype=np.intp)
    if at.size and (at.min() < 0 or at.max() > n):
        raise ValueError(f"breaks lie between 0 and {n}, not from {at.min()} to {at.max()}")
    return distinct(np.concatenate([np.array([0, n], dtype=np.intp), at]))


def label_windows(codes: ArrayLike, *, breaks: Breaks = ()) -> Bounds:
    """Return a window for each run of samples with the same label, or all without one."""
    labels = np.asarray(codes)
    changes = np.flatnonzero(labels[1:] != labels[:-1]) + 1
    return whole_windows(len(labels), breaks=np.concatenate([changes, np.asarray(breaks, dtype=np.intp)]))


def fixed_windows(
    n: int,
    *,
    samples: int | None = None,
    metres: float | None = None,
    distance: ArrayLike | None = None,
    breaks: Breaks = (),
) -> Bounds:
    """Return windows of one length; what is left at the end of a stretch is a window of its own.

    `distance`, metres driven up to each sample, never falls; `metres` needs it. Lengths are counted anew from
    each break.
    """
    bounds = whole_windows(n, breaks=breaks)
    if (samples is None) == (metres is None):
        raise ValueError("give either samples or metres")
    if samples is not None:
        if samples < 1:
            raise ValueError(f"a window of {samples} samples holds nothing")
        starts = [np.arange(a, b, samples) for a, b in pairwise(bounds)]
        return np.unique(np.concatenate([bounds, *starts]))
    if distance is None:
        raise ValueError("windows in metres need the distance")
    if not float(metres or 0.0) > 0.0:
        raise ValueError(f"a window of {metres} m holds nothing")
    driven = checked_distance(distance, n)
    inner = []
    for a, b in pairwise(bounds):
        # A hair before the mark: 0.3 m are three windows of 0.1 m whatever the rounding.
        window = np.floor((driven[a:b] - driven[a]) / metres + 1e-9)
        inner.append(a + 1 + np.flatnonzero(window[1:] != window[:-1]))
    return np.unique(np.concatenate([bounds, *inner])).astype(np.intp)


def distinct(values: Bounds) -> Bounds:
    """Return the different values, rising, as ``np.unique`` does.

    That imports masked arrays: as long as it takes to search a short log.
    """
    rising = np.sort(values)
    return rising[np.diff(rising, prepend=rising[:1] - 1) > 0]


def checked_distance(distance: ArrayLike, n: int) -> Array:
    """Return the distance as floats; ValueError where it has not n values, or is not finite, or falls."""
    driven = np.asarray(distance, dtype=float)
    if driven.shape != (n,):
        raise ValueError(f"distance has shape {driven.shape}, there are {n} samples")
    # What never falls is finite where both ends are.
    if not (driven[1:] >= driven[:-1]).all() or not np.isfinite(driven[[0, -1]] if n else driven).all():
        raise ValueError("distance must be finite and never fall")
    return driven
