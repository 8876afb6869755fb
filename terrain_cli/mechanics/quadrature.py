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

ORDER = 14
#: Nodes on each arc that give the forces to 1e-8 of themselves, by the longest way along an arc in
#: terms of k: that is what the shear stress changes over.
_ORDERS = ((4.0, 12), (8.0, ORDER), (20.0, 18))
_MOST = 24
_POWER = 3


def order_for(reach: float) -> int:
    """Return how many nodes on each arc give the forces to 1e-8 of themselves.

    Parameters
    ----------
    reach : float
        Length of the longer arc in terms of the shear modulus: angle · R / k.
    """
    return next((order for most, order in _ORDERS if reach <= most), _MOST)


@cache
def nodes(order: int = ORDER) -> tuple[Array, Array]:
    """Nodes and weights on (0, 1) for functions that start like a fractional power of u at 0.

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
