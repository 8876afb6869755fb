"""Nodes for the integrals over the two arcs of the contact.

Where the rim meets the surface the stress starts like a power n of the distance u, and n is no
whole number: Gauss–Legendre would converge slowly in u. With u = s³ the integrand is smooth enough
in s.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Nodes on each arc: the forces are right to 5e-9 of themselves up to θ1 = 80°, for 0.5 ≤ n ≤ 1.2
#: and k ≥ 10 mm under a wheel of 0.1 m. Below `SHALLOW` rad fewer do as well.
ORDER = 14
SHALLOW, SHALLOW_ORDER = 0.9, 12
_POWER = 3


@cache
def nodes(order: int = ORDER) -> tuple[Array, Array]:
    """Nodes and weights on (0, 1) for functions that start like a fractional power of u at 0.

    Parameters
    ----------
    order : int

    Returns
    -------
    u, w : ndarray, shape (order, 1)
        ∫ f(u) du ≈ Σ w f(u).
    """
    x, weights = np.polynomial.legendre.leggauss(order)
    s = 0.5 * (x + 1.0)
    u = s**_POWER
    w = 0.5 * weights * _POWER * s ** (_POWER - 1)
    return u[:, None], w[:, None]
