"""What values a driver usually has: its size, its range, and a plain number that is typical of it."""

import math

import numpy as np

from terrain_cli.vocabulary.arrays import Array


def limits(column: Array) -> tuple[float, float]:
    """Return the least and the most that is not rare."""
    low, high = np.nanquantile(column, [0.02, 0.98])
    return float(low), float(high)


def on_or_off(column: Array) -> bool:
    """Whether a driver has two values, of which neither is rare: there, all forms are one."""
    low, high = limits(column)
    return bool(high > low and np.isin(column[np.isfinite(column)], (low, high)).all())


def size(column: Array) -> float:
    """Return how large a driver usually gets; of one that is nearly always 0, how large it is then."""
    usual = max(map(abs, limits(column)))
    return usual if usual > 0.0 else max(float(np.nanmax(np.abs(column))), 1e-300)


def spread(column: Array) -> float:
    """Return by how much a driver usually differs from its middle."""
    low, high = limits(column)
    return 0.5 * (high - low) or size(column)


def ends(column: Array) -> tuple[float, float, float, float]:
    """Return between which values a driver usually is, their middle, and how far they are from it."""
    low, high = (float(f"{value:.6g}") for value in limits(column))
    return low, 0.5 * (low + high), high, rounded(spread(column))


def far_from_zero(column: Array) -> bool:
    """Whether a driver is never near 0, which is then no natural middle of a law."""
    low, _, high, spread = ends(column)
    return low * high > 0.0 and min(abs(low), abs(high)) > spread


def typical(column: Array) -> float:
    """Return a plain number near the middle of a driver; 0 where that lies within its range."""
    low, _, high, spread = ends(column)
    if low < 0.0 < high:
        return 0.0
    # No further from the middle than a quarter of the spread.
    return round(float(np.nanmedian(column)), -math.floor(math.log10(0.5 * spread)))


def rounded(value: float) -> float:
    return float(f"{value:.3g}")
