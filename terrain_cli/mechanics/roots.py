"""The sinkage at which a soil carries a load, found as a root, and its derivatives."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.mechanics.dual import Dual, seed, slopes, value

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Stands for the unknown among the names of derivatives.
UNKNOWN = "(unknown)"
#: Most steps: Newton takes a handful, bisection alone would take 50; and steps after which a soil is asked
#: whether it carries the load at all.
_STEPS, _PATIENCE = 100, 7
_CLOSE = 1e-12
#: Step of Newton, on logarithms, that leaves an error of its square.
_LAST = 1e-6


def carrying(
    carried: Callable[[Dual], Any], load: Array, start: Array, deepest: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Find the sinkage at which a soil carries a load.

    Newton's steps on the logarithms, of which load and sinkage nearly are a line, kept within a
    bracket that bisection narrows where a step would leave it.

    Parameters
    ----------
    carried : callable
        Load in N of a sinkage in m, with its derivative.
    load : ndarray, shape (n,)
        W in N.
    start : ndarray, shape (n,)
        First guess, in m; NaN will do.
    deepest : float
        Most that is sought, in m.

    Returns
    -------
    sinkage : ndarray, shape (n,)
        In m.
    found : ndarray of bool, shape (n,)
        False where the soil does not carry the load at the deepest, or the load is not positive.
    """
    high = np.full(load.shape, np.log(deepest))
    low = high + np.log(1e-9)
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.log(start)
        place = np.where((place > low) & (place < high), place, high - 1.0)
        hopeless = ~(load > 0.0)
        done = hopeless.copy()
        for number in range(_STEPS):
            if number == _PATIENCE:
                hopeless |= ~done & ~(value(carried(seed(np.full(load.shape, deepest), UNKNOWN))) >= load)
                done |= hopeless
            if np.all(done):
                break
            z = np.exp(place)
            here = carried(seed(z, UNKNOWN))
            short = value(here) < load
            low, high = np.where(short, place, low), np.where(short, high, place)
            step = np.log(load / value(here)) * value(here) / (slopes(here)[UNKNOWN] * z)
            target = place + step
            safe = (target > low) & (target < high)
            # A step as small as this may leave the bracket by rounding.
            last = np.abs(step) <= _LAST
            target = np.where(safe | last, target, 0.5 * (low + high))
            place = np.where(done, place, target)
            done = done | last
    return np.exp(place), done & ~hopeless


def inverse(shown: Callable[[Dual], Any], measured: Array) -> Array:
    """Find what a sensor's law shows as the value measured, by Newton's method.

    Parameters
    ----------
    shown : callable
        What is shown of a true value, with its derivative.
    measured : ndarray, shape (n,)

    Returns
    -------
    ndarray, shape (n,)
    """
    true = measured
    for _ in range(_STEPS):
        here = shown(seed(true, UNKNOWN))
        step = (value(here) - measured) / slopes(here)[UNKNOWN]
        true = true - step
        if not np.any(np.abs(step) > _CLOSE * np.abs(true)):
            break
    return true


def implicit(root: Array, residual: Any) -> Any:
    """Give a root its derivatives by all that its residual depends on.

    Parameters
    ----------
    root : ndarray, shape (n,)
    residual : Dual
        What is zero at the root, with its derivatives by the root (`UNKNOWN`) and by all else.
    """
    steep = slopes(residual)[UNKNOWN]
    others = {name: -slope / steep for name, slope in slopes(residual).items() if name != UNKNOWN}
    return Dual(root, others) if others else root
