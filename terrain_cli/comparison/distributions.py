"""Tails of distributions. scipy.special has them all, but to import it takes a tenth of a comparison."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.vocabulary.arrays import Array

#: Terms of the continued fraction, and what is no change of it any more.
_MOST_TERMS, _EQUAL = 400, 1e-15


def student_tail(t: ArrayLike, freedom: float) -> Array:
    """Return how often Student's t with `freedom` degrees is larger than each t.

    Half the regularised incomplete beta function of freedom/2, 1/2 at freedom/(freedom + t²), by its
    continued fraction (DLMF 8.17.22; https://dlmf.nist.gov/8.17).
    """
    square = np.asarray(t, dtype=float) ** 2
    x = freedom / (freedom + square)
    a, b = np.full(x.shape, 0.5 * freedom), np.full(x.shape, 0.5)
    # It converges fast on one side of its mean alone; the other is what that lacks of 1.
    turned = x > (a + 1.0) / (a + b + 2.0)
    a, b, x = np.where(turned, b, a), np.where(turned, a, b), np.where(turned, square / (freedom + square), x)
    scale = math.lgamma(0.5 * freedom + 0.5) - math.lgamma(0.5 * freedom) - math.lgamma(0.5)
    with np.errstate(divide="ignore"):
        front = np.exp(scale + a * np.log(x) + b * np.log1p(-x)) / a
    share = front * _fraction(a, b, x)
    share = 0.5 * np.where(turned, 1.0 - share, share)
    return np.asarray(np.where(np.asarray(t) < 0.0, 1.0 - share, share))


@lru_cache(maxsize=128)
def student_quantile(share: float, freedom: float) -> float:
    """Return the t that Student's t exceeds with `share`, less than half (Newton's method)."""
    scale = math.lgamma(0.5 * freedom + 0.5) - math.lgamma(0.5 * freedom) - 0.5 * math.log(freedom * math.pi)
    t = 0.0
    while True:
        excess = float(student_tail(t, freedom)) - share
        # From 0 on, where the density falls, no step goes too far.
        step = excess / math.exp(scale - 0.5 * (freedom + 1.0) * math.log1p(t * t / freedom))
        t += step
        if step <= 1e-12 * t:
            return t


def normal_tail(z: ArrayLike) -> Array:
    """Return how often a standard normal variable is larger than each z."""
    return np.asarray(0.5 * np.vectorize(math.erfc, otypes=[float])(np.asarray(z) / math.sqrt(2.0)))


def chi_squared_tail(value: float, freedom: int) -> float:
    """Return how often χ² is larger: a finite sum (Abramowitz & Stegun 1964, 26.4.4 and 26.4.5)."""
    half = 0.5 * value
    first = 0.5 * (freedom % 2)
    powers = (first + j for j in range(freedom // 2))
    terms = (math.exp(-half - math.lgamma(p + 1.0)) * half**p for p in powers)
    return sum(terms, math.erfc(math.sqrt(half)) if freedom % 2 else 0.0)


def _fraction(a: Array, b: Array, x: Array) -> Array:
    """Evaluate the continued fraction from its front (Lentz's method, Thompson & Barnett 1986)."""
    d = 1.0 / (1.0 - (a + b) * x / (a + 1.0))
    c, value = np.ones_like(x), d
    for m in range(1, _MOST_TERMS):
        even = m * (b - m) * x / ((a + 2 * m - 1.0) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1.0))
        before = value
        for term in (even, odd):
            d, c = 1.0 / (1.0 + term * d), 1.0 + term / c
            value = value * d * c
        if np.all(np.abs(value - before) <= _EQUAL * np.abs(value)):
            break
    return value
