"""Forces rise and fall as one grouser after another enters the soil."""

from __future__ import annotations

from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities


def _wave(q: Quantities, name: str) -> Any:
    phase = q["grouser_count"] * q["wheel_angle"]
    return q[f"{name}_sine"] * np.sin(phase) + q[f"{name}_cosine"] * np.cos(phase)


def _torque(q: Quantities) -> Any:
    return q["torque"] + q["load"] * q["wheel_radius"] * _wave(q, "torque")


def _pull(q: Quantities) -> Any:
    return q["drawbar_pull"] + q["load"] * _wave(q, "pull")


def _sinkage(q: Quantities) -> Any:
    return q["sinkage"] * (1.0 + _wave(q, "sinkage"))


def _pair(name: str, channel: str, of: str) -> tuple[Parameter, Parameter]:
    sine, cosine = (
        Parameter(
            f"{name}_{part}",
            "1",
            0.0,
            0.05,
            lower=-0.9,
            upper=0.9,
            meaning=f"{part} of the ripple, over {of}",
            needs=(channel,),
        )
        for part in ("sine", "cosine")
    )
    return sine, cosine


EFFECT = Effect(
    id="grouser-ripple",
    title="Ripple at the passing of grousers",
    kind="sensor",
    parameters=(
        *_pair("torque", "torque", "load times radius"),
        *_pair("pull", "drawbar_pull", "the load"),
        *_pair("sinkage", "sinkage", "the sinkage"),
    ),
    laws={"torque": _torque, "drawbar_pull": _pull, "sinkage": _sinkage},
    needs=("load", "wheel_angle", "grouser_count"),
    formula="T += W r A(ψ), DP += W A(ψ), z *= 1 + A(ψ), A = sine · sin ψ + cosine · cos ψ, ψ = Ng ∫ω dt",
    explanation=(
        "Each grouser that enters the soil adds to the thrust and each that leaves takes from it, so "
        "torque, pull and sinkage swing at the frequency Ng ω/2π, by 5 to 30 % of the pull; the stick and "
        "slip of a smooth wheel looks alike, at another frequency. Amplitudes are given over the load, "
        "since the pull itself passes through zero, each with a sine and a cosine because the phase is not "
        "known. Means are right and the residual is periodic in the wheel's angle. Where wheel speed "
        "swings with it, acceleration-torque has the same period, in torque alone. A log of fewer than two "
        "samples a grouser shows it at a false, lower frequency, which this law follows as well, as long "
        "as ω is exact. The angle is not known where a run begins or after a gap: in a log of several "
        "stretches, of 1.5 grousers at the least in each third, ψ counts from the crest of the channel that "
        "ripples most, each third of a stretch being told by the next, so that noise cannot align itself."
    ),
    shows="torque, drawbar pull and sinkage, periodic at Ng ω/2π; below twice that rate of samples, aliased",
    reference=(
        "Shikanai, Hashiguchi, Nohse, Ueno, Okayasu (2000), Precise measurement of soil deformation and "
        "fluctuation in drawbar pull for steel and rubber-coated rigid wheels, Journal of Terramechanics "
        "37(1), 21–39"
    ),
    settled_by="a steady drive sampled at ten times Ng ω/2π, and another at another wheel speed",
)
