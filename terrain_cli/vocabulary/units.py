"""The units that files and rover.toml may use, and what they are in the program.

Inside the program everything is SI, except that temperatures are in °C and longitude and
latitude in degrees, as people keep them. The table is closed: what is not in it is no unit.
"""

from __future__ import annotations

import math
import re
import unicodedata
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Values = TypeVar("Values", float, "NDArray[np.float64]")
DEGREE = math.pi / 180.0
STANDARD_GRAVITY = 9.80665
_FOOT = 0.3048
_POUND_FORCE = 4.4482216152605


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit and how its values become the program's."""

    symbol: str
    dimension: str  # What it measures: "length", "torque", …
    #: value in the program = value · factor + offset.
    factor: float = 1.0
    offset: float = 0.0

    def to_si(self, values: Values) -> Values:
        """Return values given in this unit in the program's unit of the same dimension."""
        if self.factor == 1.0 and self.offset == 0.0:
            return values
        return values * self.factor + self.offset


#: dimension → symbol → (factor, further spellings). The first unit is the program's own.
_TABLE: dict[str, dict[str, tuple[float, str]]] = {
    "length": {
        "m": (1.0, "metre metres meter meters"),
        "km": (1e3, ""),
        "dm": (1e-1, ""),
        "cm": (1e-2, ""),
        "mm": (1e-3, "millimetre millimetres millimeter millimeters"),
        "µm": (1e-6, "um micron microns"),
        "in": (_FOOT / 12.0, "inch inches"),
        "ft": (_FOOT, "foot feet"),
    },
    # "grad" is left out: a gon to some and a degree to others.
    "angle": {"rad": (1.0, "radian radians"), "mrad": (1e-3, ""), "deg": (DEGREE, "° degree degrees")},
    "coordinate": {"deg": (1.0, "° degree degrees"), "rad": (1.0 / DEGREE, "radian radians")},
    "force": {
        "N": (1.0, "newton newtons"),
        "kN": (1e3, ""),
        "mN": (1e-3, ""),
        "lbf": (_POUND_FORCE, ""),
        "kgf": (STANDARD_GRAVITY, ""),
    },
    "torque": {
        "N m": (1.0, ""),
        "kN m": (1e3, ""),
        "mN m": (1e-3, ""),
        "N cm": (1e-2, ""),
        "N mm": (1e-3, ""),
        "lbf ft": (_POUND_FORCE * _FOOT, "ft_lbf"),
    },
    # "1/s", "Hz", "r/s" and "rps" are left out: radians to some and revolutions to others.
    "angular speed": {
        "rad/s": (1.0, "radps rads"),
        "deg/s": (DEGREE, "°/s dps degps"),
        "rpm": (math.tau / 60.0, "rev/min r/min 1/min"),
        "rev/s": (math.tau, ""),
    },
    "speed": {
        "m/s": (1.0, "mps"),
        "cm/s": (1e-2, ""),
        "mm/s": (1e-3, "mmps"),
        "km/h": (1.0 / 3.6, "kmh kph kmph"),
    },
    "acceleration": {"m/s²": (1.0, "m/s/s mps2"), "mm/s²": (1e-3, ""), "g": (STANDARD_GRAVITY, "g0")},
    "current": {"A": (1.0, "amp amps ampere amperes"), "mA": (1e-3, "")},
    "temperature": {"°C": (1.0, "degC deg_C C celsius"), "K": (1.0, "kelvin")},
    "time": {
        "s": (1.0, "sec secs second seconds"),
        "ms": (1e-3, "msec msecs millis millisecond milliseconds"),
        "µs": (1e-6, "us usec usecs micros microsecond microseconds"),
        "ns": (1e-9, "nsec nsecs nanosec nanosecs nanos nanosecond nanoseconds"),
        "min": (60.0, "minute minutes"),
        "h": (3600.0, "hr hour hours"),
    },
    "pressure": {"Pa": (1.0, "pascal"), "kPa": (1e3, "")},
    "mass": {"kg": (1.0, ""), "g": (1e-3, "gram grams")},
    "ratio": {"1": (1.0, "- ratio fraction"), "%": (1e-2, "percent pct")},
}
#: dimension → the powers of m, kg, s, A and K that its unit is, beside radians and plain numbers.
POWERS: dict[str, dict[str, int]] = {
    "length": {"m": 1},
    "angle": {},
    "coordinate": {},
    "force": {"kg": 1, "m": 1, "s": -2},
    "torque": {"kg": 1, "m": 2, "s": -2},
    "angular speed": {"s": -1},
    "speed": {"m": 1, "s": -1},
    "acceleration": {"m": 1, "s": -2},
    "current": {"A": 1},
    "temperature": {"K": 1},
    "time": {"s": 1},
    "pressure": {"kg": 1, "m": -1, "s": -2},
    "mass": {"kg": 1},
    "ratio": {},
}
_OFFSETS = {"K": -273.15}
#: A capital M would make these a million million times as large: "MN m" is never "mN m".
_MILLI = frozenset({"mm", "mrad", "mN", "mN m", "mm/s", "mm/s²", "mA", "ms"})


def _key(text: str) -> str:
    """Spell a unit in one way: N·m for N*m, N m, N-m and N_m; m/s2 for m s⁻², m_s^2 and m/s²."""
    text = unicodedata.normalize("NFKC", text.strip().replace("º", "°")).replace("−", "-")
    text = re.sub(r"\s*/\s*|[\s_]+per[\s_]+|_(?=(?:s|h|min)[_^]*2?$)", "/", text)
    text = re.sub(r"\^|\*\*|(?<=s)_(?=2$)", "", text)
    text = re.sub(r"[\s_.*×·⋅∙]+|(?<=[A-Za-z])-(?=[A-Za-z])", "·", text)
    return re.sub(r"·?(s|h|min)-(?:1|(2))$", r"/\1\2", text)


def _units() -> dict[str, dict[str, Unit]]:
    units: dict[str, dict[str, Unit]] = {}
    for dimension, rows in _TABLE.items():
        for symbol, (factor, others) in rows.items():
            unit = Unit(symbol, dimension, factor, _OFFSETS.get(symbol, 0.0))
            for text in (symbol, *others.split()):
                key = _key(text)
                units.setdefault(dimension, {}).update({key: unit, key.replace("·", ""): unit})
    return units


_UNITS = _units()
DIMENSIONS = tuple(_TABLE)


def si(dimension: str) -> Unit:
    """Return the unit in which the program keeps a dimension."""
    return next(iter(_UNITS[dimension].values()))


def symbols(dimension: str) -> tuple[str, ...]:
    """Return the symbols of the units of a dimension, the program's own first."""
    return tuple(_TABLE[dimension])


def parse(text: str, dimension: str | None = None) -> Unit | None:
    """Find the unit that a text names; without a dimension a text with two meanings (``g``) is no unit.

    Case counts where it separates two units. Where the dimension leaves one reading it does not: the ``nm``
    of a torque is the newton metre. A capital M is never taken for milli.
    """
    key = _key(text)
    if dimension is None:
        # Longitudes are angles too; they are asked for by name.
        found = [units[key] for name, units in _UNITS.items() if key in units and name != "coordinate"]
        return found[0] if len(found) == 1 else None
    units = _UNITS[dimension]
    if key in units:
        return units[key]
    folded = key.casefold()
    readings = {unit for spelling, unit in units.items() if spelling.casefold() == folded}
    if key.startswith("M"):
        readings = {unit for unit in readings if unit.symbol not in _MILLI}
    return readings.pop() if len(readings) == 1 else None
