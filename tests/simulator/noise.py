"""What lies between the truth and a log: clocks that jitter and lose samples, sensors that err."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


def generator(seed: int, key: str) -> np.random.Generator:
    """Random numbers of one channel, which stay the same when other channels come and go."""
    return np.random.default_rng([seed, zlib.crc32(key.encode())])


@dataclass(frozen=True, slots=True)
class Clock:
    """When a topic is sampled.

    Parameters
    ----------
    rate : float
        Hz.
    phase : float
        Time of the first sample in s.
    jitter : float
        Standard deviation of the times in s; their order is kept.
    loss : float
        Share of the samples that are lost, at random.
    gaps : tuple of (float, float)
        Stretches, in s since the start, in which every sample is lost.
    """

    rate: float = 50.0
    phase: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    gaps: tuple[tuple[float, float], ...] = ()

    def times(self, duration: float, rng: np.random.Generator) -> Array:
        """Return the times of the samples in s since the start, in whole microseconds."""
        n = math.ceil((duration - self.phase) * self.rate - 1e-9)
        limit = 0.45 / self.rate
        times = self.phase + np.arange(n) / self.rate
        times += np.clip(self.jitter * rng.normal(size=n), -limit, limit)
        kept = (rng.random(n) >= self.loss) & (times >= 0.0) & (times < duration)
        for start, end in self.gaps:
            kept &= (times < start) | (times >= end)
        return np.round(times[kept], 6)


@dataclass(frozen=True, slots=True)
class Sensor:
    """How a channel errs; all that is given here adds up.

    Parameters
    ----------
    relative, absolute : float
        Standard deviation of the noise, as a share of the true value and in the channel's unit.
    correlation_time : float
        Of that noise, in s: first-order autoregressive; 0 is white.
    scale, offset : float
        What is shown is scale · value + offset, in the channel's unit.
    drift : float
        In the channel's unit per second.
    lag : float
        What is shown is the value of this many seconds before.
    outliers : float
        Share of the samples that are wild.
    outlier_size : float
        How far those are off, as a share of the true value, either way.
    quantum : float
        Step in which the channel is reported.
    """

    relative: float = 0.0
    absolute: float = 0.0
    correlation_time: float = 0.0
    scale: float = 1.0
    offset: float = 0.0
    drift: float = 0.0
    lag: float = 0.0
    outliers: float = 0.0
    outlier_size: float = 2.0
    quantum: float = 0.0

    def measure(self, time: Array, true: Array, rng: np.random.Generator) -> Array:
        """Return what the sensor shows of the true values."""
        n = len(true)
        noise = _autoregressive(time, rng.normal(size=n), self.correlation_time)
        shown = self.scale * true + self.offset + self.drift * time
        shown += np.hypot(self.relative * true, self.absolute) * noise
        wild = rng.random(n) < self.outliers
        shown += np.where(wild, self.outlier_size * rng.choice([-1.0, 1.0], n) * np.abs(true), 0.0)
        if self.quantum:
            # The second rounding takes off the dust of the product, 81.30000000000001.
            digits = max(0, 1 - math.floor(math.log10(self.quantum)))
            shown = np.round(np.round(shown / self.quantum) * self.quantum, digits)
        return shown


def _autoregressive(time: Array, white: Array, correlation_time: float) -> Array:
    """Give white noise of deviation 1 a memory, and keep its deviation."""
    if correlation_time == 0.0 or len(time) == 0:
        return white
    memory = np.exp(-np.diff(time, prepend=time[0]) / correlation_time)
    noise = white.copy()
    for j in range(1, len(noise)):
        noise[j] = memory[j] * noise[j - 1] + math.sqrt(1.0 - memory[j] ** 2) * white[j]
    return noise
