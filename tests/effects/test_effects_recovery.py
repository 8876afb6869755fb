"""Every parameter of the catalogue, found again in what other code makes of the effect.

The truth is of the tests' simulator: scalar, by adaptive quadrature, with its own laws. Soil and
effect are fitted together, to sinkage, torque and drawbar pull without noise.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from known_effects import KNOWN_EFFECTS
from scipy.optimize import least_squares
from simulator.drive import Drive, Track
from simulator.effects import base_contact
from simulator.profiles import steps, undulation, wave
from simulator.run import simulate
from simulator.soils import DRY_SAND
from simulator.wheel import Wheel

from terrain_cli import effects
from terrain_cli.mechanics import rates
from terrain_cli.mechanics.dual import slopes, value
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict

WHEEL = Wheel(0.125, 0.1, grouser_height=0.01, grouser_count=12)
SECONDS = 24.0
SOIL = base_contact(DRY_SAND)
OUTPUTS = ("sinkage", "torque", "drawbar_pull")


def measured(name, values):
    """Drive with an effect, everything varying, and return the channels that a model may read."""
    slip = wave(0.42, 0.9, 13.0)
    skids = 0.3 if name == "slip-sinkage" else 0.0
    track = Track(
        "wheel",
        [(SOIL, SECONDS)],
        load=undulation(80.0, 0.5, 9.0, seed=1),
        slip=lambda t: slip(t) - skids,
        pass_number=steps([(0.0, 8.0), (1.0, 7.0), (2.0, 9.0)]),
        motor_temperature=undulation(45.0, 0.6, 11.0, seed=2),
    )
    drive = Drive(
        [track],
        wheel=WHEEL,
        speed=undulation(0.12, 0.6, 7.0, seed=3),
        pitch=wave(0.05, 4.0, 8.0),
        slip_angle=wave(0.05, 6.0, 6.0),
        effects={name: values},
        rate=20.0 if KNOWN_EFFECTS[name].fast else 2.0,
        channels=(
            *("load", "torque", "sinkage", "angular_velocity", "velocity", "slip", "drawbar_pull", "pitch"),
            *("acceleration", "motor_temperature", "pass_number", "slip_angle"),
        ),
    )
    channels = simulate(drive).wheels["wheel"].aligned()
    time = channels.pop("time")
    stretch = np.zeros(len(time), dtype=int)
    channels["wheel_angle"] = rates.wheel_angle(time, stretch, channels["angular_velocity"])
    channels["rut_slope"] = rates.rut_slope(
        time, stretch, channels["sinkage"], channels["velocity"], radius=WHEEL.radius
    )
    for channel in ("torque", "drawbar_pull", "sinkage", "angular_velocity"):
        channels[f"{channel}_rate"] = rates.rate(time, stretch, channels[channel])
    plain = simulate(replace(drive, effects={})).wheels["wheel"].aligned()
    shown = {name: plain[name] for name in ("torque", "drawbar_pull", "sinkage")}
    return channels | along(time, stretch, channels["velocity"], shown)


def fit(model, channels, forms):
    """Fit soil and effect, from another soil and no effect; where it has a shape, from its typical size.

    What chooses the form of a law is held, at its value in `forms`.
    """
    soil = {
        "cohesion": 1500.0,
        "tan_phi": 0.6,
        "shear_modulus": 0.022,
        "stiffness": 1.2e6,
        "sinkage_exponent": 1.0,
    }
    held = {q: forms[p.name] for q, p in model.parameters.items() if p.held}
    start = {q: number for q, number in (soil | model.nulls()).items() if q not in held}
    if any(p.shape for p in model.parameters.values()):
        start |= {q: p.null + p.scale for q, p in model.parameters.items() if not p.shape}
    scale = np.array([model.parameters[q].scale if q in model.parameters else soil[q] for q in start])
    low = [model.parameters[q].lower if q in model.parameters else 0.05 * soil[q] for q in start]
    high = [model.parameters[q].upper if q in model.parameters else 20.0 * soil[q] for q in start]
    wheel = WheelGeometry(WHEEL.radius, WHEEL.width, WHEEL.grouser_height, WHEEL.grouser_count)
    spread = {output: np.std(channels[output]) for output in OUTPUTS}
    last = {}

    def residuals(x):
        values = held | dict(zip(start, x * scale, strict=True))
        p = predict(model, wheel, channels, values, given="load", by=tuple(start))
        rows, jacobian = [], []
        for output in OUTPUTS:
            number = getattr(p, output)
            known = np.isfinite(value(number))
            rows.append(np.where(known, (value(number) - channels[output]) / spread[output], 3.0))
            jacobian.append(
                [
                    np.where(known, np.broadcast_to(slopes(number).get(q, 0.0), known.shape), 0.0)
                    / spread[output]
                    for q in start
                ]
            )
        last["jacobian"] = np.concatenate([np.array(part).T for part in jacobian]) * scale
        return np.concatenate(rows)

    found = least_squares(
        residuals,
        np.clip(list(start.values()) / scale, np.array(low) / scale + 1e-6, np.array(high) / scale - 1e-6),
        jac=lambda _x: last["jacobian"],
        bounds=(low / scale, high / scale),
        x_scale="jac",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
        max_nfev=200,
    )
    return held | dict(zip(start, found.x * scale, strict=True))


def test_every_effect_has_a_truth():
    for name, known in KNOWN_EFFECTS.items():
        assert list(known.values) == [p.name for p in effects.find(name).parameters]


@pytest.mark.parametrize("name", effects.NAMES)
def test_parameters_are_found_again(name):
    truth, tolerance = KNOWN_EFFECTS[name].values, KNOWN_EFFECTS[name].found_within
    effect = effects.find(name)
    found = fit(Model("wong-reece", (effect,)), measured(name, truth), truth)
    for p in effect.parameters:
        assert found[effect.qualified(p)] == pytest.approx(truth[p.name], abs=tolerance * p.scale), p.name
    assert found["cohesion"] == pytest.approx(SOIL.cohesion, rel=max(tolerance, 1e-3))
    assert found["tan_phi"] == pytest.approx(SOIL.tan_phi, rel=max(tolerance, 1e-3))
