"""The content of a model file."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from terrain_cli.mechanics.prior import Prior
from terrain_cli.mechanics.wheel_model import Model

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

__all__ = ["FORMAT", "SOIL_UNITS", "ModelFile", "Prior"]

FORMAT = "terrain-est/model/1"
#: Parameters of the soil with the unit of their values.
SOIL_UNITS = {
    "cohesion": "Pa",
    "tan_phi": "1",
    "shear_modulus": "m",
    "stiffness": "Pa/m^n",
    "sinkage_exponent": "1",
}
#: What they are, in words.
SOIL_MEANINGS = {
    "cohesion": "cohesion c of the soil",
    "tan_phi": "tangent of its friction angle φ",
    "shear_modulus": "shear deformation modulus k of the soil",
    "stiffness": "sinkage modulus keq = kc/b + kφ of the soil under this wheel",
    "sinkage_exponent": "exponent n of pressure against sinkage",
}


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """A model, and what is known of its parameters."""

    model: Model = field(default_factory=Model)
    effects: tuple[str, ...] = ()  # The effects as the file names them: ids, or paths beside the file
    # Parameters held, in SI units, such as ``shear_modulus`` and ``slip-sinkage.n1``
    fixed: Mapping[str, float] = field(default_factory=dict)
    # In SI units; those of k and keq are log-normal
    priors: Mapping[str, Prior] = field(default_factory=dict)
    shared: tuple[str, ...] = ()  # Parameters of the soil that are one for all windows of a wheel
    local: tuple[str, ...] = ()  # Parameters of effects that have a value of their own in every window
    history: tuple[Mapping[str, Any], ...] = ()  # What `model add` and `model remove` did; kept as it is
    path: Path | None = None  # None for a base without a file
    # The file as it was read, so that `save` keeps its comments
    text: str = field(default="", repr=False, compare=False)

    def factor(self, name: str) -> float:
        """Return the SI value of one unit of a parameter in the file; 1 but for effects of a user."""
        own = self.model.parameters.get(name)
        return own.factor if own else 1.0

    @property
    def units(self) -> dict[str, str]:
        """Unit of every parameter, of the soil and of the effects."""
        own = {name: parameter.unit for name, parameter in self.model.parameters.items()}
        return {name: SOIL_UNITS[name] for name in self.model.soil} | own

    @property
    def plain(self) -> bool:
        """Whether it is the linear model and nothing else, for which the estimators of the line do."""
        beyond = (self.effects, self.fixed, self.priors, self.shared)
        return self.model.base == "linear" and not any(beyond)
