"""Effects on what a sensor shows."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import effect, parameter
from terrain_cli.mechanics.contact import slip_of_radius

if TYPE_CHECKING:
    from collections.abc import Iterator

    from terrain_cli.mechanics.effect import Parameter, Quantities

LOAD_BIAS = effect(
    id="load-bias",
    title="Gain and offset of the load cell",
    kind="sensor",
    parameters=(
        parameter("gain", 0.05, "newtons shown per newton on the wheel", (0.7, 1.4), null=1.0),
        parameter("offset", 10.0, "newtons shown with the wheel in the air", (-1000.0, 1000.0), unit="N"),
    ),
    laws={"load": Law("(load - offset) / gain")},
    needs=("load",),
    formula="W shown = gain · W + offset",
)

SINKAGE_BIAS = effect(
    id="sinkage-bias",
    title="Offset of the sinkage sensor",
    kind="sensor",
    parameters=(
        parameter("offset", 0.002, "sinkage shown by a wheel that does not sink", (-0.1, 0.1), unit="m"),
    ),
    laws={"sinkage": Law("sinkage + offset")},
    needs=("sinkage",),
    formula="z shown = z + offset",
)


DRAWBAR_BIAS = effect(
    id="drawbar-bias",
    title="Offset of the drawbar-pull sensor",
    kind="sensor",
    parameters=(
        parameter("offset", 10.0, "pull shown by a wheel that pulls nothing", (-1000.0, 1000.0), unit="N"),
    ),
    laws={"drawbar_pull": Law("drawbar_pull + offset")},
    formula="DP shown = DP + offset",
)


def _slip_of_another_radius(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 + q["relative_error"])


WHEEL_RADIUS = effect(
    id="wheel-radius",
    title="The radius from which slip was computed",
    kind="sensor",
    parameters=(
        parameter(
            "relative_error", 0.03, "Δr/r: how far the rolling radius exceeds the stated one", (-0.4, 0.4)
        ),
    ),
    laws={"slip": _slip_of_another_radius},
    needs=("slip",),
    formula="1 − i felt = (1 − i)/(1 + Δr/r), so that i rises by nearly (1 − i) Δr/r",
)


_LATE_CHANNELS = ("torque", "drawbar_pull", "sinkage")


def _late(channel: str, q: Quantities) -> Any:
    """Show what was true a little earlier, to first order."""
    return q[channel] - q[f"{channel}_lag"] * q.get(f"{channel}_rate", 0.0)


def _late_on_the_way(q: Quantities) -> Any:
    """Take the rate from the slope of the rut: at one speed a distance is a time, and nothing else."""
    if "rut_slope" not in q or "velocity" not in q:
        return _late("sinkage", q)
    return q["sinkage"] - q["sinkage_lag"] * np.absolute(q["velocity"]) * q["rut_slope"]


_LATE = {channel: partial(_late, channel) for channel in _LATE_CHANNELS}

SENSOR_LAG = effect(
    id="sensor-lag",
    title="A channel is late",
    kind="sensor",
    parameters=tuple(
        parameter(
            f"{channel}_lag",
            0.1,
            f"by how much {channel.replace('_', ' ')} is late",
            (-2.0, 2.0),
            unit="s",
            needs=(f"{channel}_rate",),
        )
        for channel in _LATE_CHANNELS
    ),
    laws=_LATE,
    others=({**_LATE, "sinkage": _late_on_the_way},),
    any_of=tuple(f"{channel}_rate" for channel in _LATE_CHANNELS),
    formula="shown = true − lag · d(shown)/dt, for torque, drawbar pull and sinkage each",
)


def _wave(name: str) -> str:
    phase = "(grouser_count * wheel_angle)"
    return f"({name}_sine * sin{phase} + {name}_cosine * cos{phase})"


def _pair(name: str, channel: str, of: str) -> Iterator[Parameter]:
    for part in ("sine", "cosine"):
        meaning = f"{part} of the ripple, over {of}"
        yield parameter(f"{name}_{part}", 0.05, meaning, (-0.9, 0.9), needs=(channel,))


GROUSER_RIPPLE = effect(
    id="grouser-ripple",
    title="Ripple at the passing of grousers",
    kind="sensor",
    parameters=(
        *_pair("torque", "torque", "load times radius"),
        *_pair("pull", "drawbar_pull", "the load"),
        *_pair("sinkage", "sinkage", "the sinkage"),
    ),
    laws={
        "torque": Law(f"torque + load * wheel_radius * {_wave('torque')}"),
        "drawbar_pull": Law(f"drawbar_pull + load * {_wave('pull')}"),
        "sinkage": Law(f"sinkage * (1 + {_wave('sinkage')})"),
    },
    needs=("load", "wheel_angle", "grouser_count"),
    formula="T += W r A(ψ), DP += W A(ψ), z *= 1 + A(ψ), A = sine · sin ψ + cosine · cos ψ, ψ = Ng ∫ω dt",
)
