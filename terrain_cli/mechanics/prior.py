"""What is known of a parameter of soil, wheel or effect before any data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known of a parameter before any data: normal, or log-normal for k and keq."""

    # mean, sd: mean and standard deviation in the parameter's own unit, of the log-normal distribution itself
    # where it is one
    mean: float
    sd: float

    @classmethod
    def factor(cls, median: float, factor: float) -> Prior:
        """Return the log-normal prior "`median`, within a factor of `factor`" (one standard deviation)."""
        spread = float(np.log(factor))
        mean = median * float(np.exp(0.5 * spread**2))
        return cls(mean, mean * float(np.sqrt(np.expm1(spread**2))))

    @classmethod
    def of(cls, values: ArrayLike, *, positive: bool = False) -> Prior:
        """Return the prior with the mean and the variance of values, or of their logarithms if positive."""
        values = np.asarray(values, dtype=float)
        if positive:
            logs = np.log(values)
            return cls.factor(float(np.exp(logs.mean())), float(np.exp(logs.std())))
        return cls(float(values.mean()), float(values.std()))

    def of_logarithm(self) -> tuple[float, float]:
        """Return mean and standard deviation of the logarithm of a log-normal parameter."""
        spread = float(np.sqrt(np.log1p((self.sd / self.mean) ** 2)))
        return float(np.log(self.mean)) - 0.5 * spread**2, spread
