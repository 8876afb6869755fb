"""Further inputs that the effects of a model need beside load, torque, sinkage and slip."""

from collections.abc import Collection, Iterable

import numpy as np

from terrain_cli.effects import Effect
from terrain_cli.mechanics import rates
from terrain_cli.rover import Wheel
from terrain_cli.telemetry.raw_columns import as_numbers
from terrain_cli.telemetry.rover_advice import Lack
from terrain_cli.telemetry.wheel_samples import NEEDED, Geometry, Raw, Samples
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.vocabulary.quantities import listed

#: Constants of a wheel, which rover.toml gives.
CONSTANTS = ("wheel_radius", "width", "grouser_height", "grouser_count", "gravity")
ANGLE, RUT = "wheel_angle", "rut_slope"
#: What is told by the body, and turned where the wheel turns backwards: uphill is where it goes.
WITH_COURSE = frozenset({"pitch", "roll"})
#: Of what is no channel, column or rate of one.
_SOURCES: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(CONSTANTS, ()),
    ANGLE: ("angular_velocity", "time"),
    RUT: ("sinkage", "velocity", "time"),
}
_RATE = "_rate"
#: What shows the passing of grousers, and what it follows besides.
_RIPPLING, _BESIDE = ("torque", "drawbar_pull", "sinkage"), ("time", "load", "slip")


def sources(name: str) -> tuple[str, ...]:
    """Return the channels and columns, "time" among them, that a need is computed from."""
    if name in CHANNELS or not name.endswith(_RATE):
        return _SOURCES.get(name, (name,))
    return (name.removesuffix(_RATE), "time")


def read(effects: Iterable[Effect]) -> tuple[set[str], set[str]]:
    """Split what makes a difference to some effects into channels and further columns."""
    names = {source for effect in effects for name in effect.reads for source in sources(name)}
    return names & CHANNELS.keys(), names - CHANNELS.keys()


def missing(effect: Effect, available: Collection[str]) -> tuple[str, ...]:
    """Return what an effect lacks to be computed, as a person reads it.

    `available` are channels and further columns, "time" among them, and constants that rover.toml may lack.
    """

    def known(name: str) -> bool:
        return name in available or bool(sources(name) and {*available}.issuperset(sources(name)))

    lacking = [name for name in effect.needs if not known(name)]
    either = [] if any(map(known, effect.any_of)) else list(effect.any_of)
    return (*lacking, *([listed(either, "or")] if either else []))


def lacking(raw: Raw, wheel: Wheel, effects: Iterable[Effect]) -> list[Lack]:
    """Say what is missing for the effects of a model."""
    there = {*NEEDED, *raw.channels, *raw.extras, *(["time"] if raw.time is not None else [])}
    # Slip is needed anyway, and with it ω tells V, and V tells ω.
    speeds = {"velocity", "angular_velocity"}
    return _lacks(there | (speeds if there & speeds else set()), wheel, effects)


def not_read(samples: Samples, effects: Iterable[Effect]) -> list[Lack]:
    """Say what effects need that is not in samples, which were read without them."""
    there = {*samples.channels, *samples.drivers, *(["time"] if samples.time is not None else [])}
    return _lacks(there, samples.geometry, effects)


def _lacks(there: set[str], wheel: Wheel | Geometry, effects: Iterable[Effect]) -> list[Lack]:
    lacks = []
    for effect in effects:
        for name in effect.needs:
            for source in sources(name):
                if source not in there:
                    behind = f" (for {name})" if source != name else ""
                    because = (
                        f"effect {effect.id} needs {source}{behind}, which is neither measured nor derived"
                    )
                    lacks.append(Lack(source, because, (source,) if source in CHANNELS else ()))
            if name.startswith("grouser_") and not getattr(wheel, name):
                because = f"effect {effect.id} needs {name} of rover.toml"
                lacks.append(Lack(name, because, lines=("[wheel]", f"{name} = …")))
        if effect.any_of and not any(there.issuperset(sources(name)) for name in effect.any_of):
            because = (
                f"effect {effect.id} needs one of {', '.join(effect.any_of)}, and none is measured or derived"
            )
            first = next((s for s in sources(effect.any_of[0]) if s not in there), effect.any_of[0])
            lacks.append(Lack(first, because, (first,) if first in CHANNELS else ()))
    return lacks


def drivers(
    raw: Raw, geometry: Geometry, rows: Index, stretch: Index, effects: Iterable[Effect]
) -> dict[str, Array]:
    """Compute what makes a difference to the effects of a model; NaN where not known, and outside `rows`."""
    # What they need is there. Without what they only use, if that is not, and the constants of the wheel.
    known = {**{name: as_numbers(column) for name, column in raw.extras.items()}, **raw.channels}
    return _computed(known, raw.time, rows, stretch, geometry, effects)


def of_samples(samples: Samples, effects: Iterable[Effect]) -> dict[str, Array]:
    """Compute what makes a difference to further effects, where samples for a comparison tell it."""
    known = {**samples.drivers, **samples.channels}
    found = _computed(known, samples.time, samples.usable, samples.stretch, samples.geometry, effects)
    return {name: values for name, values in found.items() if np.isfinite(values).any()}


def _computed(
    known: dict[str, Array],
    time: Array | None,
    rows: Index,
    stretch: Index,
    geometry: Geometry,
    effects: Iterable[Effect],
) -> dict[str, Array]:
    known = dict(known)
    if time is not None:
        known["time"] = time
    omega = known.get("angular_velocity")
    if omega is not None:
        for name in known.keys() & WITH_COURSE:
            known[name] = np.where(omega < 0.0, -known[name], known[name])
    effects = list(effects)
    own, n = stretch[rows], len(stretch)
    result = {}
    needed = {name for effect in effects for name in effect.needs}
    for name in dict.fromkeys(name for effect in effects for name in effect.reads):
        if not sources(name) or not known.keys() >= set(sources(name)):
            continue
        columns = [known[source][rows] for source in sources(name)]
        values = columns[0]
        if name == ANGLE:
            values = rates.wheel_angle(columns[1], own, values)
            shown, beside = ([known[c][rows] for c in some if c in known] for some in (_RIPPLING, _BESIDE))
            values = rates.aligned(values, own, geometry.grouser_count, shown, beside)
        elif name == RUT:
            values = rates.rut_slope(columns[2], own, columns[0], columns[1], radius=geometry.radius)
        elif len(columns) > 1:
            values = rates.rate(columns[1], own, values)
        if name in needed or np.isfinite(values).any():
            result[name] = np.full(n, np.nan)
            result[name][rows] = values
    return result
