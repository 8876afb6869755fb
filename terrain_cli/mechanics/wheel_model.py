"""The wheel–soil model with its effects: load, torque, drawbar pull and sinkage predicted for a soil."""

from collections import ChainMap
from collections.abc import Collection, Mapping
from copy import copy
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.mechanics import contact, dual, rim_forces
from terrain_cli.mechanics.contact import ORDER, order_for
from terrain_cli.mechanics.dual import Dual, rows, seed, slopes, value
from terrain_cli.mechanics.effect import KINDS, Effect, Parameter
from terrain_cli.mechanics.past import Past
from terrain_cli.processes import keep_freed
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.choices import BASES, Base
from terrain_cli.vocabulary.units import STANDARD_GRAVITY

Given = Literal["sinkage", "load"]

#: Parameters of the soil by base, in SI units.
SOIL: dict[Base, tuple[str, ...]] = {
    "wong-reece": ("cohesion", "tan_phi", "shear_modulus", "stiffness", "sinkage_exponent"),
    "linear": ("cohesion", "tan_phi", "shear_modulus"),
}
#: Laws on these are applied node by node along the rim, which is slow where many are differentiated together.
STRESSES = frozenset({"normal_stress", "shear_stress"})
#: What the triangular stresses know nothing of: their load is given, not carried by a pressure.
_NOT_LINEAR = STRESSES | {"stiffness", "sinkage_exponent"}
_MEASURED = frozenset({"slip", "load"})  # Their laws turn what is measured into what the soil feels
DEEPEST = 1.5  # Deepest θ1 for which a sinkage is sought, in rad: a wheel sunk to its axle is stuck
#: Least values of what a law may have driven through zero.
_LEAST = {"shear_modulus": 1e-6, "stiffness": 1.0, "sinkage_exponent": 0.05}
#: Share of a sinkage by which it may be off where a caller settles for fewer nodes: less than these leave.
_NEAR = 1e-8
#: Nodes of an arc at a time: so many that Python's own time is nothing beside that of NumPy, and so few
#: that their arrays stay in the processor's cache.
_BLOCK = 32_000


class WheelGeometry(NamedTuple):
    # radius, width: r and b in m
    radius: float
    width: float
    grouser_height: float = 0.0  # In m
    grouser_count: int = 0
    gravity: float = STANDARD_GRAVITY  # In m/s²


@dataclass(frozen=True)
class Model:
    """A base and the effects added to it, in their order.

    ConfigurationError: no such base, an effect twice, or one that changes what the base does not have.
    """

    base: Base = "wong-reece"
    effects: tuple[Effect, ...] = ()

    def __post_init__(self) -> None:
        if self.base not in BASES:
            raise ConfigurationError(f"no base {self.base!r}", hint=f"one of {', '.join(BASES)}")
        names = [effect.id for effect in self.effects]
        for effect in self.effects:
            if names.count(effect.id) > 1:
                raise ConfigurationError(f"effect {effect.id} is in the model twice")
            unknown = _NOT_LINEAR.intersection(effect.laws) if self.base == "linear" else ()
            if unknown:
                raise ConfigurationError(
                    f"effect {effect.id} changes the {min(unknown).replace('_', ' ')}, "
                    "which the base linear does not have",
                    hint='use base = "wong-reece"',
                )

    @property
    def soil(self) -> tuple[str, ...]:
        return SOIL[self.base]

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of all effects by their qualified names, such as ``slip-sinkage.n1``."""
        return {effect.qualified(p): p for effect in self.effects for p in effect.parameters}

    @property
    def needs(self) -> tuple[str, ...]:
        """Channels that the effects need, each once."""
        return tuple(dict.fromkeys(name for effect in self.effects for name in effect.needs))

    @property
    def remembers(self) -> bool:
        """Whether a law reads what is predicted before a sample."""
        return any(effect.remembers for effect in self.effects)

    def nulls(self) -> dict[str, float]:
        """Return the values of the effects' parameters at which they are all absent."""
        return {name: parameter.null for name, parameter in self.parameters.items()}

    @cached_property
    def changing(self) -> dict[str, list[Effect]]:
        """The effects that change a quantity, in the order in which they act on it.

        From the ground to the sensor, whatever the order in which they were added; a measured slip
        or load is followed back from the sensor to the ground.
        """
        quantities = dict.fromkeys(quantity for effect in self.effects for quantity in effect.laws)
        return {
            name: sorted(
                (effect for effect in self.effects if name in effect.laws),
                key=lambda e: KINDS.index(e.kind),
                reverse=name in _MEASURED,
            )
            for name in quantities
        }

    @cached_property
    def bends(self) -> list[tuple[str, str]]:
        """Effects and their parameters that are depths at which the normal stress bends."""
        changing = self.changing.get("normal_stress", ())
        return [(one.id, p.name) for one in changing for p in one.parameters if p.along == "sinkage"]

    def changes(self, quantity: str) -> bool:
        return quantity in self.changing


@dataclass(frozen=True)
class Prediction:
    """What a model predicts: numbers with derivatives where those were asked for."""

    # shape (n,): load that the soil carries at the sinkage measured, less the load that is on it, in N
    balance: Any
    load: Any  # shape (n,): the first of these, in N
    # torque, drawbar_pull: shape (n,): as the sensors show them, in N m and N; None where not asked for
    torque: Any
    drawbar_pull: Any
    sinkage: Any  # shape (n,): as the sensor shows it, in m; NaN where the soil does not carry the load


def predict(
    model: Model,
    wheel: WheelGeometry,
    channels: Mapping[str, ArrayLike],
    values: Mapping[str, ArrayLike],
    *,
    given: Given = "sinkage",
    by: Collection[str] = (),
    order: int | None = None,
    start: ArrayLike | None = None,
    forces: bool = True,
) -> Prediction:
    """Predict the forces on a wheel, and its sinkage where that is not given.

    `channels`, shape (n,), are as measured, in SI units: slip, and sinkage or load or both, and what the
    effects need; the linear base needs load and sinkage. `values` has every parameter of the soil and of the
    effects, one number or one for each sample. `given`: take the sinkage as measured, which needs no root, or
    solve for the one at which the soil carries the load, from a first guess `start` in m, of which NaN will
    do; of no influence on the linear base. Without `forces` torque and pull at that sinkage are left out.
    `by` are parameters, and "load", "sinkage" and "slip" as measured, by which to differentiate; `order` is
    nodes on each arc, instead of as many as give 1e-8. InputError: a channel is missing.
    """
    keep_freed()
    columns: dict[str, Any] = {
        name: column if isinstance(column, Past) else np.asarray(column, dtype=float)
        for name, column in channels.items()
    }
    given_values = {name: np.asarray(number, dtype=float) for name, number in values.items()}
    n = max((column.size for column in columns.values()), default=0)
    guess = None if start is None else np.asarray(start, dtype=float)
    size = max(_BLOCK // (order or ORDER), 1)
    parts = []
    for first in range(0, max(n, 1), size):
        part = slice(first, first + size)
        parts.append(
            _Block(
                model,
                wheel,
                {name: column[part] for name, column in columns.items()},
                {name: number[part] if number.ndim else number for name, number in given_values.items()},
                frozenset(by),
                order,
                None if guess is None else guess[part],
            ).run(given, forces=forces)
        )
    return Prediction(**{f.name: _join([getattr(p, f.name) for p in parts]) for f in fields(Prediction)})


def _join(parts: list[Any]) -> Any:
    if len(parts) == 1 or parts[0] is None:
        return parts[0]
    values = np.concatenate([value(part) for part in parts])
    names = dict.fromkeys(name for part in parts for name in slopes(part))
    columns = {
        name: np.concatenate([np.broadcast_to(slopes(p).get(name, 0.0), value(p).shape) for p in parts])
        for name in names
    }
    return Dual(values, columns) if columns else values


class _Missing(dict[str, Any]):
    """Channels and quantities; says which of them is not there."""

    def __missing__(self, name: str) -> Any:
        raise InputError(
            f"the model needs {name.removeprefix('measured_')}, which is not measured",
            hint="terrain-est inspect shows what each channel is read from",
        )


class _Block:
    """Some samples on their way through the model."""

    def __init__(
        self,
        model: Model,
        wheel: WheelGeometry,
        channels: dict[str, Array],
        values: dict[str, Array],
        by: frozenset[str],
        order: int | None,
        guess: Array | None,
    ) -> None:
        self.model, self.wheel, self.order, self.by, self.guess = model, wheel, order, by, guess
        numbers = {name: seed(number, name) if name in by else number for name, number in values.items()}
        self.soil = {name: numbers[name] for name in model.soil}
        self.own = {
            effect.id: {p.name: numbers[effect.qualified(p)] for p in effect.parameters}
            for effect in model.effects
        }
        measured = {name: seed(column, name) if name in by else column for name, column in channels.items()}
        self.shape = np.shape(next(iter(channels.values())))
        self.start = _Missing(measured)
        for name in ("torque", "drawbar_pull"):
            if name in measured:
                self.start[f"measured_{name}"] = self.start.pop(name)
        self.start.update(wheel._asdict())
        self.start["wheel_radius"] = self.start.pop("radius")

    def law(self, quantity: str, q: dict[str, Any]) -> Any:
        """Apply every law on a quantity."""
        for effect in self.model.changing.get(quantity, ()):
            q[quantity] = effect.laws[quantity](ChainMap(self.own[effect.id], q))
        return q[quantity]

    def run(self, given: Given, *, forces: bool) -> Prediction:
        q = _Missing(self.start)
        self.law("slip", q)
        if "load" in q:
            self.law("load", q)
        if self.model.base == "linear":
            q["sinkage"] = self.true_sinkage(q)
            self.shape_of_contact(q)
            q["torque"], q["drawbar_pull"] = rim_forces.triangular_forces(q, self.wheel.width)
            return Prediction(None, None, *self.shown(q), None)
        if given == "sinkage":
            q["sinkage"] = self.true_sinkage(q)
            carried = self.under_wheel(q)
            balance = carried - q["load"] if "load" in q else None
            return Prediction(balance, carried, *self.shown(q), None)
        load = q["load"]
        q["sinkage"] = self.sought_sinkage(q, load)
        if not forces:
            return Prediction(None, load, None, None, self.law("sinkage", q))
        self.under_wheel(q)
        torque, pull = self.shown(q)
        return Prediction(None, load, torque, pull, self.law("sinkage", q))

    def shown(self, q: dict[str, Any]) -> tuple[Any, Any]:
        """Return torque and pull as the sensors show them."""
        torque = self.law("torque", q)
        return torque, self.law("drawbar_pull", q)

    def shape_of_contact(self, q: dict[str, Any]) -> None:
        """Put soil and contact into the quantities, with the laws on them."""
        q["radius"] = np.broadcast_to(self.wheel.radius, self.shape)
        self.law("radius", q)
        share = q["sinkage"] / (2.0 * q["radius"])
        if not np.all((value(share) >= 1e-9) & (value(share) <= 0.5)):
            share = np.minimum(np.maximum(share, 1e-9), 0.5)
        one = q["entry_angle"] = 2.0 * np.arcsin(np.sqrt(share))
        q.update(self.soil)
        for name in self.model.soil:
            self.law(name, q)
            if name in _LEAST and self.model.changes(name):
                q[name] = np.maximum(q[name], _LEAST[name])
        q["max_stress_angle"], q["exit_angle"] = 0.5 * one, np.zeros(self.shape)
        self.law("max_stress_angle", q)
        self.law("exit_angle", q)
        if self.model.changes("max_stress_angle") or self.model.changes("exit_angle"):
            self.order_of_angles(q)
        q["shear_radius"] = q["radius"]
        self.law("shear_radius", q)

    def order_of_angles(self, q: dict[str, Any]) -> None:
        """Keep the rear end of the contact behind its front, and the angle of maximum stress between them."""
        one, peak, two = (q[f"{name}_angle"] for name in ("entry", "max_stress", "exit"))
        front, middle, back = value(one), value(peak), value(two)
        if np.any(back > 0.9 * front):
            two = q["exit_angle"] = np.minimum(two, 0.9 * one)
            back = value(two)
        if np.any((middle < back + 0.01 * (front - back)) | (middle > 0.99 * front)):
            q["max_stress_angle"] = np.minimum(np.maximum(peak, two + 0.01 * (one - two)), 0.99 * one)

    def under_wheel(self, q: dict[str, Any]) -> Any:
        """Put torque and pull into the quantities, and return the load that the soil carries."""
        self.shape_of_contact(q)
        order = self.order
        if order is None:
            one, peak, two = (value(q[f"{name}_angle"]) for name in ("entry", "max_stress", "exit"))
            reach = np.maximum(one - peak, peak - two) * value(q["shear_radius"]) / value(q["shear_modulus"])
            order = order_for(float(np.max(reach, initial=0.0)))
        if STRESSES.intersection(self.model.changing):
            bends = [self.own[effect][name] for effect, name in self.model.bends]
            load, q["torque"], q["drawbar_pull"] = rim_forces.forces(
                q, self.wheel.width, self.law, bends=bends, order=order
            )
            return load
        # Most have the shape already, and to ask costs less than to broadcast.
        numbers = {name: np.asarray(value(q[name])) for name in contact.NAMES}
        plain = contact.Contact(
            **{
                name: x if x.shape == self.shape else np.broadcast_to(x, self.shape)
                for name, x in numbers.items()
            }
        )
        by = [name for name in contact.NAMES if slopes(q[name])]
        totals, partial = contact.forces(plain, self.wheel.width, by=by, order=order)
        load, q["torque"], q["drawbar_pull"] = rows(totals, [(partial[name], q[name]) for name in by])
        return load

    def true_sinkage(self, q: dict[str, Any]) -> Any:
        """Find the sinkage that the sensor shows as the one measured."""
        measured = q["sinkage"]
        if not self.model.changes("sinkage"):
            return measured

        def shown(z: Any) -> Any:
            return self.law("sinkage", _Missing({**q, "sinkage": z}))

        true = dual.inverse(shown, value(measured))
        return dual.implicit(true, shown(seed(true, dual.UNKNOWN)) - measured)

    def sought_sinkage(self, q: dict[str, Any], load: Any) -> Any:
        """Find the sinkage at which the soil carries a load; NaN where it carries less."""
        plain = self.without_derivatives()
        known = {name: value(number) for name, number in q.items() if name != "sinkage"}
        wanted = np.broadcast_to(value(load), self.shape)
        # Bekker's sinkage of a rigid wheel starts the search.
        stiffness, exponent = (value(self.soil[name]) for name in ("stiffness", "sinkage_exponent"))
        arc = self.wheel.width * (3.0 - np.minimum(exponent, 2.0)) * np.sqrt(2.0 * self.wheel.radius)
        start = (3.0 * np.maximum(wanted, 0.0) / (stiffness * arc)) ** (1.0 / (exponent + 0.5))
        deepest = 2.0 * self.wheel.radius * np.sin(0.5 * DEEPEST) ** 2
        if self.guess is not None:
            start = np.where((self.guess > 0.0) & (self.guess < deepest), self.guess, start)
        true, found = dual.carrying(
            lambda z: plain.under_wheel(_Missing({**known, "sinkage": z})),
            wanted,
            np.broadcast_to(start, self.shape),
            exponent + 0.5,
            deepest,
            dual.CLOSE if self.order is None else _NEAR,
        )
        root: Any = true
        if self.by:
            here = self.under_wheel(_Missing({**q, "sinkage": seed(true, dual.UNKNOWN)}))
            root = dual.implicit(true, here - load)
        return np.where(found, root, np.full(self.shape, np.nan))

    def without_derivatives(self) -> Self:
        """Return the same samples, with parameters that are plain numbers."""
        plain = copy(self)
        plain.soil = {name: value(number) for name, number in self.soil.items()}
        plain.own = {
            name: {own: value(number) for own, number in numbers.items()}
            for name, numbers in self.own.items()
        }
        return plain
