"""Types of arrays, as annotations name them, ratios of two, and the median of one."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]
Bounds = NDArray[np.intp]  # Of windows: where each begins, and where the last one ends


def ratio(top: Array, bottom: Array, otherwise: float = 0.0) -> Array:
    """Return a ratio where the divisor is above 0, and elsewhere another number."""
    found: Array = np.full(np.broadcast(top, bottom).shape, otherwise)
    return np.divide(top, bottom, out=found, where=bottom > 0.0)


def median(values: Array) -> float:
    """Return `np.median` of one or more numbers in a row.

    NumPy looks for both in the middle and for NaN by one partition, which takes 15 times as long as for one.
    """
    half = len(values) // 2
    if np.isnan(values).any():
        return np.nan
    parted = np.partition(values, half)
    low = parted[half] if len(values) % 2 else parted[:half].max()
    return float((low + parted[half]) / 2.0)
