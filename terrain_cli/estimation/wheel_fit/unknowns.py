"""The parameters that are sought, and what is known of them before any data.

Positive parameters are sought by their logarithm. Every unknown is counted from its prior mean in
prior standard deviations, so that all are numbers of order one and the prior's information is 1.
"""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.mechanics.effect import Parameter, Prior
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.choices import SOIL_BOUNDS

POSITIVE = frozenset({"shear_modulus", "stiffness"})  # Sought by their logarithm
EFFECT_SCALES = 5.0  # A prior of an effect's parameter is this many of its scales wide: next to nothing


#: Weak priors from published soils (the table of terrain values of Wong, Theory of Ground Vehicles,
#: and lunar soil). k: 10 to 25 mm of sand, 6 mm of firm and 50 mm of fresh snow.
DEFAULT: dict[str, Prior] = {
    "cohesion": Prior(2.5e3, 5e3),
    "tan_phi": Prior(0.55, 0.3),
    "shear_modulus": Prior.factor(0.018, 2.0),
    "stiffness": Prior.factor(1.4e6, 3.0),
    "sinkage_exponent": Prior(0.9, 0.3),
}
#: Prior standard deviations from the prior mean beyond which no soil is known: c above 22 kPa, k sixteen
#: times that of rover.toml. Judged.
FAR = 4.0
#: Largest step of one iteration, in the unit sought (a logarithm of k, keq).
_STEPS = {"cohesion": 1e4, "tan_phi": 0.5, "shear_modulus": 1.0, "stiffness": 2.0, "sinkage_exponent": 0.3}


@dataclass(frozen=True, slots=True, kw_only=True)
class Unknown:
    """One parameter that is sought."""

    name: str
    logarithm: bool  # Whether it is sought by its logarithm
    mean: float  # mean, sd: of the prior, in the unit sought
    sd: float
    # lower, upper, step: range and largest step of one iteration, in prior standard deviations from `mean`
    lower: float
    upper: float
    step: float
    own: Parameter | None = None  # Of an effect: the parameter as it is under this wheel

    def value(self, t: Array) -> Array:
        """Return the parameter in its own unit, from prior standard deviations off the prior mean."""
        sought = self.mean + self.sd * t
        return np.exp(sought) if self.logarithm else sought

    def sought(self, value: ArrayLike) -> Array:
        """Return how many prior standard deviations a value of the parameter is off the prior mean."""
        number = np.log(np.maximum(value, 1e-300)) if self.logarithm else np.asarray(value, dtype=float)
        return np.asarray((number - self.mean) / self.sd)

    def slope(self, t: Array) -> Array:
        """Return the derivative of the parameter, in its own unit, by `t`."""
        return self.sd * self.value(t) if self.logarithm else np.full_like(t, self.sd)


@dataclass(frozen=True)
class Unknowns:
    """All parameters of a fit."""

    local: tuple[Unknown, ...]  # local, shared: one value for each window, one value for all windows
    shared: tuple[Unknown, ...]
    fixed: dict[str, Array]  # Held: one value, or one for each window

    def values(self, t: Array, common: Array, count: Index | int, windows: Index) -> dict[str, Array]:
        """Return every parameter as the model takes it: one value, or one for each sample.

        `common` may be (q, n); of each of the `windows` there are `count` samples.
        """
        values = {
            name: value if value.ndim == 0 else np.repeat(value[windows], count)
            for name, value in self.fixed.items()
        }
        for column, unknown in enumerate(self.local):
            values[unknown.name] = np.repeat(unknown.value(t[:, column]), count)
        for unknown, number in zip(self.shared, common, strict=True):
            values[unknown.name] = unknown.value(np.asarray(number))
        return values

    def slopes(self, t: Array, common: Array) -> Array:
        """Return the derivatives of all parameters sought by t, shape (w, p), and common, shape (q,)."""
        both = zip((*self.local, *self.shared), (*t.T, *common), strict=True)
        columns = [np.broadcast_to(unknown.slope(np.asarray(number)), len(t)) for unknown, number in both]
        return np.stack(columns, axis=1) if columns else np.zeros((len(t), 0))


def unknowns(
    model: Model,
    *,
    fixed: Mapping[str, ArrayLike] | None,
    priors: Mapping[str, Prior] | None,
    shared: Collection[str],
    local: Collection[str] = (),
    under: tuple[float, float] = (0.0, 0.0),
) -> Unknowns:
    """Sort the parameters of a model into those sought and those held (`fixed`).

    Parameters of the soil that are `shared`, and those of effects but for `local` ones, have one value for
    all windows. Their sizes are those `under` a load, N, on a wheel of a radius, m.
    """
    fixed, priors = fixed or {}, priors or {}
    known = (*model.soil, *model.parameters)
    held = {name: np.asarray(value, dtype=float) for name, value in fixed.items()}
    sought = [unknown(model, name, priors.get(name), under) for name in known if name not in held]
    common = {*shared, *model.parameters} - {*local}
    return Unknowns(
        tuple(u for u in sought if u.name not in common), tuple(u for u in sought if u.name in common), held
    )


def unknown(
    model: Model, name: str, prior: Prior | None = None, under: tuple[float, float] = (0.0, 0.0)
) -> Unknown:
    """Return a parameter to be sought, by default with the weak prior of the soil or of its effect."""
    logarithm = name in POSITIVE
    own = model.parameters[name].under(*under) if name in model.parameters else None
    if own is not None:
        prior = prior or Prior(own.null, EFFECT_SCALES * own.scale)
        lower, upper, step = own.lower, own.upper, 2.0 * own.scale
    else:
        prior = prior or DEFAULT[name]
        ends = SOIL_BOUNDS[name]
        lower, upper = (float(np.log(end)) for end in ends) if logarithm else ends
        step = _STEPS[name]
    mean, sd = prior.of_logarithm() if logarithm else (prior.mean, prior.sd)
    return Unknown(
        name=name,
        logarithm=logarithm,
        mean=mean,
        sd=sd,
        lower=(lower - mean) / sd,
        upper=(upper - mean) / sd,
        step=step / sd,
        own=own,
    )


def present(
    sought: Unknowns,
    common: Array,
    channels: Mapping[str, Array],
    size: float,
    among: Collection[str] | None = None,
) -> Iterator[Array]:
    """Yield beginnings at which effects are there, shape (q,), in every shape of them that is tried.

    They are `size` typical sizes from their null values, as far as nature has them on that side; by default
    all that windows share, else those `among` which their parameters are.
    """
    every = [
        (j, unknown, unknown.own)
        for j, unknown in enumerate(sought.shared)
        if unknown.own and (among is None or unknown.name in among)
    ]
    begun = common.copy()
    for j, unknown, own in every:
        value = own.null + size * own.scale
        if not own.shape and size * own.side >= 0.0 and own.lower <= value <= own.upper:
            begun[j] = (value - unknown.mean) / unknown.sd
    if not np.any(begun != common):
        return
    shapes = [(j, unknown, own.tried([channels])) for j, unknown, own in every if own.shape]
    for values in product(*(tried for _, _, tried in shapes)):
        shaped = begun.copy()
        for (j, unknown, _), number in zip(shapes, values, strict=True):
            shaped[j] = (number - unknown.mean) / unknown.sd
        yield shaped
