"""Slip of a wheel that rolls on another radius than the one it was computed with."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.contact import rolling

_LEAST = 1e-9


def slip_of_radius(slip: Any, share: Any) -> Any:
    """Slip with another rolling radius, for driving and for skidding.

    Driving i = 1 − V/(r ω), skidding i = r ω/V − 1, so V/(r ω) is changed.

    Parameters
    ----------
    slip : ndarray or Dual
        i, computed with the radius r.
    share : ndarray or Dual
        The true rolling radius, over r.

    Returns
    -------
    ndarray or Dual
        i with the true rolling radius.
    """
    ratio = rolling(slip) / share
    return np.where(ratio > 1.0, 1.0 / np.maximum(ratio, _LEAST) - 1.0, 1.0 - ratio)
