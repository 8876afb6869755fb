"""The line y = c + x tan φ by least squares, equation [26]."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.line.moments import X, Y

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.estimation.line.moments import WindowMoments

    Array = NDArray[np.float64]


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
    """Fit each window by least squares."""
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
