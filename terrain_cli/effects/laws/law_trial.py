"""A user's law tried on random numbers: it must do nothing at the null values, and something elsewhere."""

import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from terrain_cli.mechanics.dual import seed, slopes, value
from terrain_cli.mechanics.effect import Effect, Law
from terrain_cli.vocabulary.arrays import Array

SAMPLES = 256  # Samples of a trial
ROUNDING = 1e-9  # Largest difference at the null values, as a share of the quantity

_ORDINARY = tomllib.loads(Path(__file__).with_name("ordinary_values.toml").read_text("utf-8"))
_COLUMN = (0.1, 10.0)
_WHOLE = frozenset({"pass_number", "grouser_count"})


class Trial(NamedTuple):
    # Largest difference from the quantity at the null values, as a share of it; NaN where the law is nowhere
    # a number
    deviation: float
    # gave, wanted: there
    gave: float
    wanted: float
    where: dict[str, float]  # There, what the law reads
    skids_only: bool  # The difference is there only where the wheel skids
    no_number: float  # Share of the samples for which it is no number at the null values
    example: dict[str, float]  # One of them


def at_null(effect: Effect, quantity: str, reads: Collection[str]) -> Trial:
    """Compare a law with the quantity itself, at the null values of all parameters."""
    nulls = {parameter.name: parameter.null for parameter in effect.parameters}
    given = inputs({quantity, *reads} - nulls.keys())
    gave, wanted = _called(effect.laws[quantity], {**given, **nulls}), given[quantity]
    known = np.isfinite(gave)
    # The exit angle is 0 throughout: then the difference counts as it is.
    size = np.abs(wanted) + (1e-3 * np.max(np.abs(wanted)) or 1.0)
    difference = np.where(known, np.abs(np.where(known, gave, 0.0) - wanted) / size, 0.0)
    worst, unknown = int(np.argmax(difference)), int(np.argmin(known))
    shown = [name for name in reads if name in given]
    return Trial(
        float(difference[worst]) if known.any() else float("nan"),
        float(gave[worst]),
        float(wanted[worst]),
        {name: float(given[name][worst]) for name in shown},
        bool(np.all(difference[given["slip"] >= 0.0] <= ROUNDING)),
        float(np.mean(~known)),
        {name: float(given[name][unknown]) for name in shown},
    )


def influence(effect: Effect, quantity: str, reads: Collection[str], name: str) -> tuple[float, float]:
    """Return the rms derivative of a law by a parameter, times its scale: at null values, at typical ones."""
    nulls = {p.name: p.null for p in effect.parameters}
    given = inputs({quantity, *reads} - nulls.keys())
    typical = {
        p.name: p.null + p.scale if p.null + p.scale <= p.upper else max(p.null - p.scale, p.lower)
        for p in effect.parameters
    }
    scale = next(p.scale for p in effect.parameters if p.name == name)
    sizes = []
    for values in (nulls, typical):
        plain = _called(effect.laws[quantity], {**given, **values})
        with np.errstate(all="ignore"):
            result = effect.laws[quantity](
                {**given, **values, name: seed(np.full(SAMPLES, values[name]), name)}
            )
        slope = np.broadcast_to(slopes(result).get(name, 0.0), SAMPLES)[np.isfinite(plain)]
        with np.errstate(all="ignore"):
            sizes.append(float(scale * np.sqrt(np.mean(np.square(slope)))) if slope.size else 0.0)
    return sizes[0], sizes[1]


def shifts(effect: Effect, quantity: str) -> bool:
    """Tell whether one of an effect's parameters alone adds the same to a quantity everywhere."""
    nulls = {parameter.name: parameter.null for parameter in effect.parameters}
    given = inputs({quantity, *effect.reads} - nulls.keys())
    law = effect.laws[quantity]
    plain = _called(law, {**given, **nulls})
    changes = (_called(law, {**given, **nulls, p.name: p.null + p.scale}) - plain for p in effect.parameters)
    return any(np.ptp(change) < ROUNDING * np.max(np.abs(change)) for change in changes)


def _called(law: Law, q: Mapping[str, Any]) -> Array:
    return np.broadcast_to(np.asarray(value(law(q)), dtype=float), SAMPLES)


def inputs(names: Collection[str]) -> dict[str, Array]:
    """Draw ordinary values that go together as in the base model, always the same; shape (SAMPLES,)."""
    random = np.random.default_rng(20040829)

    def draw(low: float, high: float, *, whole: bool = False) -> Array:
        values = random.uniform(low, high, SAMPLES)
        return np.floor(values) if whole else values

    q = {name: draw(low, high, whole=name in _WHOLE) for name, (low, high) in _ORDINARY.items()}
    r = q["radius"] = q["shear_radius"] = q["wheel_radius"]
    q["sinkage"] = r * draw(0.02, 0.4)
    q["entry_angle"] = np.arccos(1.0 - q["sinkage"] / r)
    q["max_stress_angle"], q["exit_angle"] = 0.5 * q["entry_angle"], np.zeros(SAMPLES)
    rim = r * q["angular_velocity"]
    q["velocity"] = np.where(q["slip"] >= 0.0, rim * (1.0 - q["slip"]), rim / (1.0 + q["slip"]))
    q["angle"] = q["entry_angle"] * draw(0.0, 0.999)
    q["depth"] = r * (np.cos(q["angle"]) - np.cos(q["entry_angle"]))
    q["normal_stress"] = q["stiffness"] * q["depth"] ** q["sinkage_exponent"]
    rise = np.sin(q["entry_angle"]) - np.sin(q["angle"])
    j = q["shear_displacement"] = r * (q["entry_angle"] - q["angle"] - (1.0 - q["slip"]) * rise)
    fade = np.exp(-np.abs(j) / q["shear_modulus"])
    q["shear_stress"] = np.sign(j) * (q["cohesion"] + q["tan_phi"] * q["normal_stress"]) * (1.0 - fade)
    for name in sorted({*names} - q.keys()):
        base = name.removesuffix("_rate")
        spread = float(np.std(q[base])) if base in q and base != name else 1.0
        q[name] = draw(-spread, spread) if base != name else draw(*_COLUMN)
    return q
