"""What section III of the paper states: its soils, its wheel, its claims.

Iagnemma, Kang, Shibly, Dubowsky 2004, doi 10.1109/TRO.2004.829462.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from simulator.wheel import Wheel

#: Table II: lowest and highest value of each parameter of `Soil`, in SI units. The paper takes `LEVELS`
#: evenly spaced values of each, 15,625 soils.
TABLE_II = {
    "exponent": (0.5, 1.2),
    "cohesive_modulus": (10e3, 100e3),
    "frictional_modulus": (1000e3, 5000e3),
    "cohesion": (0.0, 10e3),
    "friction_angle": (math.radians(20.0), math.radians(40.0)),
    "shear_modulus": (0.01, 0.03),
}
LEVELS = 5
WHEEL = Wheel(0.1, 0.1)
#: The weight of 10 kg in N, and how far it and the slip vary at random, as shares.
LOAD, VARIATION = 98.1, 0.15
#: What the paper assumes of k, in terms of the true one.
ASSUMED_K = 1.5


class Claim(NamedTuple):
    """Errors that the paper states for windows of so many points.

    `noise` is the standard deviation as a share of each channel's maximum; `cohesion` is in kPa,
    `phi` in degrees.
    """

    points: int
    noise: float
    cohesion: float
    phi: float


CLAIMS = (Claim(5, 0.0, 0.21, 1.62), Claim(10, 0.10, 1.57, 4.12), Claim(30, 0.10, 0.63, 2.11))
