"""Which missing channels can be derived, and what rover.toml would have to say for the others."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from terrain_cli.mechanics import linear
from terrain_cli.telemetry import derived_channels
from terrain_cli.telemetry.wheel_samples import NEEDED
from terrain_cli.toml import toml_text

if TYPE_CHECKING:
    from collections.abc import Collection

    from numpy.typing import NDArray

    from terrain_cli.rover import Rover, Wheel
    from terrain_cli.telemetry.wheel_samples import Raw

    Array = NDArray[np.float64]

#: Positive forward or nose up, and so with the other sign to a wheel that turns backwards. Pitch and roll
#: are turned for the effects only (`effect_inputs.drivers`): in the body's frame they say where the load is.
_WITH_DIRECTION = ("torque", "drawbar_pull", "acceleration")
#: How a reason begins where the data are silent.
NOWHERE = "nothing measures it"
#: Every channel from which a needed one, or the place of a sample, may come.
SOURCES = (
    *NEEDED,
    *("time", "run", "terrain", "entry_angle", "angular_velocity", "velocity", "pitch", "roll", "yaw_rate"),
    *("motor_current", "motor_temperature", "x", "y", "longitude", "latitude"),
)


class Lack(NamedTuple):
    """Something that is needed and can be had from nothing."""

    #: A channel, "geometry" or "shear modulus".
    what: str
    because: str
    #: Channels that would supply it; empty where rover.toml itself must say it.
    ask: tuple[str, ...] = ()
    #: What to add to rover.toml, if not a channel: the header of a table, then its keys.
    lines: tuple[str, ...] = ()


def routes(available: Collection[str], wheel: Wheel, rover: Rover) -> tuple[dict[str, str], list[Lack]]:
    """Say how each needed channel that was not recorded can be derived, or what is missing.

    So for the velocity, which no estimate needs, but some effects do.
    """
    have = set(available)
    ways = {
        "load": _load(have, wheel, rover),
        "torque": _torque(have, wheel),
        "sinkage": _sinkage(have),
        "slip": _slip(have),
    }
    found = {name: way for name, way in ways.items() if name not in have}
    derived = {name: way for name, way in found.items() if isinstance(way, str)}
    if "velocity" not in have and {"angular_velocity", "slip"} <= have:
        derived["velocity"] = "angular velocity and slip"
    return derived, [way for way in found.values() if isinstance(way, Lack)]


def _load(have: set[str], wheel: Wheel, rover: Rover) -> str | Lack:
    if rover.vehicle is None:
        return Lack("load", f"{NOWHERE}, and there is no [vehicle] to balance", ("load",))
    if wheel.position is None:
        lines = (f"[wheels.{toml_text.key(wheel.name)}]", "position = [x, y, z]  # m")
        return Lack("load", "the balance of the vehicle needs the place of every wheel", lines=lines)
    if "pitch" not in have:
        return Lack("load", "the balance of the vehicle needs the pitch", ("pitch",))
    return "the quasi-static balance of the vehicle, pitch" + " and roll" * ("roll" in have)


def _torque(have: set[str], wheel: Wheel) -> str | Lack:
    if "motor_current" not in have:
        return Lack("torque", f"{NOWHERE}, nor the motor current", ("torque",))
    if wheel.motor is None:
        lines = ("[motor]", "torque_constant = …  # N m/A", "gear_ratio = …")
        return Lack("torque", "motor_current is there, but not the data of the motor", lines=lines)
    if wheel.motor.temperature_coefficient == 0.0:
        return "motor current"
    if "motor_temperature" not in have:
        because = "temperature_coefficient is not 0, and needs the temperature of the motor"
        return Lack("torque", because, ("motor_temperature",))
    return "motor current and temperature"


def _sinkage(have: set[str]) -> str | Lack:
    if "entry_angle" in have:
        return "entry angle"
    return Lack("sinkage", f"{NOWHERE}, nor the entry angle", ("sinkage",))


def _slip(have: set[str]) -> str | Lack:
    missing = tuple(name for name in ("angular_velocity", "velocity") if name not in have)
    if not missing:
        return "angular velocity and velocity"
    return Lack("slip", f"{NOWHERE}, nor {' and '.join(missing)} to derive it from", missing)


def settings(wheel: Wheel, rover: Rover) -> list[Lack]:
    """Return what rover.toml does not say of a wheel and its soil."""
    lacks = []
    sizes = [name for name in ("radius", "width") if getattr(wheel, name) is None]
    if sizes:
        lines = ("[wheel]", *(f"{name} = …  # m" for name in sizes))
        lacks.append(Lack("geometry", f"the {' and '.join(sizes)} of the wheel", lines=lines))
    if rover.shear_modulus is None:
        lines = ("[soil]", "shear_modulus = …  # m, the k assumed of the soil: 0.001 to 0.04")
        lacks.append(Lack("shear modulus", "the shear modulus of the soil", lines=lines))
    return lacks


def complete(raw: Raw, wheel: Wheel, rover: Rover) -> dict[str, str]:
    """Derive in place the channels not recorded that `routes` finds; say where every channel comes from."""
    origins = {name: str(feed) for name, feed in raw.feeds.items()}
    body = raw.feeds.get("velocity")
    # What is infinite is set aside later.
    with np.errstate(invalid="ignore", over="ignore"):
        if body is not None and body.of_body and wheel.position and "yaw_rate" in raw.channels:
            raw.channels["velocity"] = derived_channels.wheel_velocity(
                raw.channels["velocity"], raw.channels["yaw_rate"], wheel.position[1]
            )
            origins["velocity"] = f"derived from {body} and yaw rate"
        derived, _ = routes(raw.channels, wheel, rover)
        _derive(raw.channels, derived, wheel, rover)
    _turn(raw.channels, _WITH_DIRECTION)
    return origins | {name: f"derived from {how}" for name, how in derived.items()}


def _turn(channels: dict[str, Array], names: Collection[str]) -> None:
    """Count what has a direction the way the wheel turns: the soil sees no other way."""
    omega = channels.get("angular_velocity")
    if omega is not None:
        for name in channels.keys() & names:
            channels[name] = np.where(omega < 0.0, -channels[name], channels[name])


def _derive(channels: dict[str, Array], derived: Collection[str], wheel: Wheel, rover: Rover) -> None:
    radius = rover.geometry(wheel)[0]
    if "load" in derived and rover.vehicle:
        positions = rover.positions()
        roll = channels.get("roll", np.zeros_like(channels["pitch"]))
        loads = derived_channels.wheel_loads(channels["pitch"], roll, rover.vehicle, list(positions.values()))
        channels["load"] = loads[:, list(positions).index(wheel.name)]
    if "torque" in derived and wheel.motor:
        channels["torque"] = derived_channels.torque_from_current(
            channels["motor_current"],
            wheel.motor,
            temperature=channels.get("motor_temperature"),
            angular_velocity=channels.get("angular_velocity"),
        )
    if "sinkage" in derived:
        # Beyond half a turn the cosine would make any depth of it.
        angle = np.clip(channels["entry_angle"], -np.pi, np.pi)
        channels["sinkage"] = np.sign(angle) * linear.sinkage_of(angle, radius)
    if "slip" in derived:
        channels["slip"] = derived_channels.slip(channels["angular_velocity"], channels["velocity"], radius)
    if "velocity" in derived:
        channels["velocity"] = derived_channels.velocity(
            channels["angular_velocity"], channels["slip"], radius
        )
