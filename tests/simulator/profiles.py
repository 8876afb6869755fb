"""How load, slip or speed vary with time: functions from times in s to values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Profile: TypeAlias = Callable[[Array], Array]


def constant(value: float) -> Profile:
    """Return the same at all times."""
    return lambda t: np.full(len(t), value)


def steps(parts: Sequence[tuple[float, float]]) -> Profile:
    """One value after another, each (value, seconds); the last one stays."""
    values = np.array([value for value, _ in parts])
    ends = np.cumsum([seconds for _, seconds in parts])[:-1]
    return lambda t: values[np.searchsorted(ends, t, side="right")]


def sweep(first: float, last: float, seconds: float) -> Profile:
    """Return a straight ramp; before and after it the value stays."""
    return lambda t: first + (last - first) * np.clip(t / seconds, 0.0, 1.0)


def wave(mean: float, share: float, period: float, phase: float = 0.0) -> Profile:
    """Return a sine about the mean, of amplitude share · mean; phase in parts of the period."""
    return lambda t: mean * (1.0 + share * np.sin(2.0 * np.pi * (t / period + phase)))


def undulation(mean: float, share: float, period: float, seed: int = 0) -> Profile:
    """Return three sines together, smooth and never repeating, never more than share · mean from the mean."""
    rng = np.random.default_rng(seed)
    lengths = period / np.array([1.0, np.sqrt(3.0), np.sqrt(8.0)])
    weights = np.array([0.5, 0.3, 0.2])
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    return lambda t: (
        mean * (1.0 + share * np.sin(2.0 * np.pi * np.divide.outer(t, lengths) + phases) @ weights)
    )


def scatter(mean: float, share: float, interval: float = 0.02, seed: int = 0) -> Profile:
    """Return a new normal value in every interval, of deviation share · mean, cut at three of those."""

    def profile(t: Array) -> Array:
        index = np.floor(t / interval + 1e-6).astype(int)
        draws = np.random.default_rng(seed).normal(size=int(index.max(initial=0)) + 1)
        return np.asarray(mean * (1.0 + share * np.clip(draws, -3.0, 3.0)[np.maximum(index, 0)]))

    return profile
