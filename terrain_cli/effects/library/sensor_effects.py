"""Effects on what a sensor shows."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.effects.laws.grammar import Law
from terrain_cli.effects.library import parameter
from terrain_cli.mechanics.contact import slip_of_radius
from terrain_cli.mechanics.effect import Effect, Quantities

if TYPE_CHECKING:
    from collections.abc import Iterator

    from terrain_cli.mechanics.effect import Parameter

LOAD_BIAS = Effect(
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
    explanation=(
        "A load cell that was zeroed under the weight of the leg, or drifts with temperature, shows g W + o: "
        "on the wheels of a rover in the field g was 0.95 to 0.99 and o 1 to 114 N. Sinkage, torque and pull "
        "are all too high or too low for the load that is shown. An offset passes for cohesion, as both are "
        "the same at every load; a gain passes for friction and stiffness. At one load gain and offset are "
        "the same thing. Drivetrain-friction moves torque only; load-transfer is nothing on the flat."
    ),
    shows="sinkage, torque and drawbar pull against load",
    reference=(
        "Gerdes, Pérez del Pulgar, Castilla Arquillo, Azkarate (2024), Field assessment of force torque "
        "sensors for planetary rover navigation, arXiv 2411.04700"
    ),
    settled_by="a load step, and the reading with the wheel in the air",
)

SINKAGE_BIAS = Effect(
    id="sinkage-bias",
    title="Offset of the sinkage sensor",
    kind="sensor",
    parameters=(
        parameter("offset", 0.002, "sinkage shown by a wheel that does not sink", (-0.1, 0.1), unit="m"),
    ),
    laws={"sinkage": Law("sinkage + offset")},
    needs=("sinkage",),
    formula="z shown = z + offset",
    explanation=(
        "Sinkage is read from an image of the rim, or from the height of the axle over ground whose height "
        "is guessed: a few millimetres are easily missed, and the rut's wall or a heap before the wheel "
        "counts as ground. The reading is off by the same amount everywhere. Torque and pull that are "
        "predicted from it are wrong through the entry angle, most where the wheel sinks least, and a wheel "
        "on firm ground shows a sinkage, perhaps a negative one. A softer soil adds sinkage in proportion to "
        "load instead; slip-sinkage adds it with slip."
    ),
    shows="sinkage by a constant; torque and drawbar pull through the entry angle",
    reference=(
        "Brooks, Iagnemma, Dubowsky (2006), Visual wheel sinkage measurement for planetary rover mobility "
        "characterization, Autonomous Robots 21"
    ),
    settled_by="the reading on firm ground, or a load step",
)


DRAWBAR_BIAS = Effect(
    id="drawbar-bias",
    title="Offset of the drawbar-pull sensor",
    kind="sensor",
    parameters=(
        parameter("offset", 10.0, "pull shown by a wheel that pulls nothing", (-1000.0, 1000.0), unit="N"),
    ),
    laws={"drawbar_pull": Law("drawbar_pull + offset")},
    formula="DP shown = DP + offset",
    explanation=(
        "The pull is read from a force sensor at the hub, or from a cell between the carriage and what holds "
        "it back. Friction of the carriage's guides, the drag of a cable, a sensor zeroed under load or one "
        "mounted some degrees off the horizontal, which shows a share of the weight, add the same newtons at "
        "every slip and sinkage. Torque and sinkage stay as they are. A parasitic torque "
        "(drivetrain-friction) leaves the same gap between torque and pull, but on the side of the torque; "
        "bulldozing and a slope take pull away too, the one with the sinkage, the other with the pitch."
    ),
    shows="drawbar pull by a constant",
    reference=(
        "Gerdes, Pérez del Pulgar, Castilla Arquillo, Azkarate (2024), Field assessment of force torque "
        "sensors for planetary rover navigation, arXiv 2411.04700: offsets of such sensors on a rover"
    ),
    settled_by="the reading with the wheel in the air, another load, or a slope",
)


def _slip_of_another_radius(q: Quantities) -> Any:
    return slip_of_radius(q["slip"], 1.0 + q["relative_error"])


WHEEL_RADIUS = Effect(
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
    explanation=(
        "Slip is 1 − V/(r ω). With grousers, tyre wear or a bent rim the radius on which the wheel rolls is "
        "1 to 10 % off, and slip is off by (1 − i) Δr/r: all of it at low slip, nothing at full slip. A "
        "speed that is off by a factor does the same. The curves of torque and pull over slip are shifted "
        "sideways, so that torque is zero at a slip that is not. Grousers shift them too, but add torque at "
        "high slip; flexible-wheel shifts them and lengthens the contact; shear-modulus bends them and "
        "leaves their beginning at zero. The effect corrects the slip alone: a radius in rover.toml that is "
        "off is to be corrected there, for the contact depends on it too."
    ),
    shows="torque and drawbar pull along the slip axis; no torque at a slip that is not zero",
    reference=(
        "Borenstein, Feng (1996), Measurement and correction of systematic odometry errors in mobile robots, "
        "IEEE Transactions on Robotics and Automation 12(6), 869–880, doi 10.1109/70.544770"
    ),
    settled_by="a slip sweep through zero, or the distance of ten turns on firm ground",
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

SENSOR_LAG = Effect(
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
    explanation=(
        "Filters, buses and clocks that disagree make a channel late by 0.05 to 0.5 s. Where nothing changes "
        "it is right; in a change the residual is the lag times the channel's own rate, with one sign as it "
        "rises and the other as it falls, so that torque over slip becomes a loop. The lags are relative to "
        "slip and load: if those are late, all three come out early, below zero. A wheel that has yet to "
        "sink after a change of slip makes sinkage loop too: there it is a distance that counts, see "
        "sinkage-relaxation. Acceleration-torque follows the wheel's acceleration, not the torque's rate. A "
        "lag longer than the changes themselves is beyond this first-order law: shift the channel instead."
    ),
    shows="the late channel, against its own rate of change",
    reference=(
        "Furgale, Rehder, Siegwart (2013), Unified temporal and spatial calibration for multi-sensor "
        "systems, IEEE/RSJ International Conference on Intelligent Robots and Systems, doi "
        "10.1109/IROS.2013.6696514"
    ),
    settled_by="quick changes of slip or load, up and down; for sinkage, at two speeds",
)


def _wave(name: str) -> str:
    phase = "(grouser_count * wheel_angle)"
    return f"({name}_sine * sin{phase} + {name}_cosine * cos{phase})"


def _pair(name: str, channel: str, of: str) -> Iterator[Parameter]:
    for part in ("sine", "cosine"):
        meaning = f"{part} of the ripple, over {of}"
        yield parameter(f"{name}_{part}", 0.05, meaning, (-0.9, 0.9), needs=(channel,))


GROUSER_RIPPLE = Effect(
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
    explanation=(
        "Each grouser that enters the soil adds to the thrust and each that leaves takes from it, so torque, "
        "pull and sinkage swing at the frequency Ng ω/2π, by 5 to 30 % of the pull; the stick and slip of a "
        "smooth wheel looks alike, at another frequency. Amplitudes are given over the load, since the pull "
        "itself passes through zero, each with a sine and a cosine because the phase is not known. Means are "
        "right and the residual is periodic in the wheel's angle. Where wheel speed swings with it, "
        "acceleration-torque has the same period, in torque alone. A log of fewer than two samples a grouser "
        "shows it at a false, lower frequency, which this law follows as well, as long as ω is exact. The "
        "angle is not known where a run begins or after a gap: in a log of several stretches, of 1.5 "
        "grousers at the least in each third, ψ counts from the crest of the channel that ripples most, each "
        "third of a stretch being told by the next, so that noise cannot align itself."
    ),
    shows="torque, drawbar pull and sinkage, periodic at Ng ω/2π; below twice that rate of samples, aliased",
    reference=(
        "Shikanai, Hashiguchi, Nohse, Ueno, Okayasu (2000), Precise measurement of soil deformation and "
        "fluctuation in drawbar pull for steel and rubber-coated rigid wheels, Journal of Terramechanics "
        "37(1), 21–39"
    ),
    settled_by="a steady drive sampled at ten times Ng ω/2π, and another at another wheel speed",
)
