"""The units that files and rover.toml may use, and what they are in the program.

Inside the program everything is SI, except that temperatures are in °C and longitude and
latitude in degrees, as people keep them. The table is closed: what is not in it is no unit.
"""

import re
import tomllib
import unicodedata
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Values = TypeVar("Values", float, "NDArray[np.float64]")
STANDARD_GRAVITY = 9.80665


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


_TABLE = tomllib.loads(Path(__file__).with_name("units.toml").read_text("utf-8"))
#: dimension → the powers of m, kg, s, A and K that its unit is.
POWERS: dict[str, dict[str, int]] = {dimension: entry["powers"] for dimension, entry in _TABLE.items()}
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
    for dimension, entry in _TABLE.items():
        for symbol, factor, others in entry["units"]:
            unit = Unit(symbol, dimension, factor, _OFFSETS.get(symbol, 0.0))
            for text in (symbol, *others.split()):
                key = _key(text)
                units.setdefault(dimension, {}).update({key: unit, key.replace("·", ""): unit})
    return units


_UNITS = _units()


def si(dimension: str) -> Unit:
    """Return the unit in which the program keeps a dimension."""
    return next(iter(_UNITS[dimension].values()))


def symbols(dimension: str) -> tuple[str, ...]:
    """Return the symbols of the units of a dimension, the program's own first."""
    return tuple(symbol for symbol, _, _ in _TABLE[dimension]["units"])


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
