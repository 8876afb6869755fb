"""Drives of which it is known what a model without effects leaves out, if anything.

The truth is `simulator`'s, which shares nothing with the program: the contact that the base assumes,
and one physical effect or none.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from simulator import (
    CHANNELS,
    DRY_SAND,
    LETE_SAND,
    SANDY_LOAM,
    UPLAND_SANDY_LOAM,
    Drive,
    Sensor,
    Track,
    Wheel,
    base_contact,
    simulate,
    steps,
    undulation,
)

from formats import Labels
from terrain_cli.comparison.compare import of_fitted, on_few_soils
from terrain_cli.estimation.estimate_request import EstimateRequest
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.models import ModelFile
from terrain_cli.telemetry.wheel_samples import Geometry, Samples
from terrain_cli.windows.cut_windows import cut

if TYPE_CHECKING:
    from collections.abc import Mapping

WHEEL = Wheel(radius=0.125, width=0.1, grouser_height=0.01, grouser_count=12)
RATE = 20.0
SOILS = (DRY_SAND, LETE_SAND, SANDY_LOAM, UPLAND_SANDY_LOAM)
MEASURED = (
    *CHANNELS,
    "slip",
    "drawbar_pull",
    "pitch",
    "yaw_rate",
    "motor_temperature",
    "pass_number",
)
#: Patches of a soil that varies, and s that each lasts.
PATCHES, PATCH = 16, 8.0


def compare(wheels, model, *, fixed=None, progress=lambda _: None, **options):
    """Compare a model with wheels, of which nothing is known beforehand but the parameters held."""
    held = fixed or {}
    fitted, told = on_few_soils(wheels, model, FitSettings(held, {}, (), None), progress=progress)
    found = of_fitted(fitted, warnings=told, progress=progress, **options)
    return replace(found, soils=EstimateRequest(wheels=wheels, file=ModelFile(model=model, fixed=held)))


@dataclass(frozen=True)
class Kind:
    """What the drives of one kind have in common.

    `share` is the deviation of the noise of load, torque, sinkage and slip as a share of each;
    `memory` its correlation from sample to sample. `varies` puts another variety of the soil under
    every patch, and `runs` says where they begin. On `two` soils it is another one in the second half.
    """

    effects: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    share: float = 0.03
    memory: float = 0.0
    varies: bool = False
    runs: bool = False
    two: bool = False


def soil_of(rng, kind):
    """Return a soil, or its varieties patch by patch: some twelve of them, so that drives share tables."""
    name = int(rng.integers(len(SOILS)))
    soil = base_contact(SOILS[name])
    if kind.two:
        return [(base_contact(SOILS[(name + j) % len(SOILS)]), PATCHES * PATCH / 2.0) for j in range(2)]
    if not kind.varies:
        return [(soil, PATCHES * PATCH)]
    some = np.random.default_rng(name).normal(size=(6, 3))
    varieties = [
        replace(
            soil,
            name=f"{soil.name} {j}",
            cohesion=soil.cohesion * (1.0 + 0.1 * a),
            frictional_modulus=soil.frictional_modulus * (1.0 + 0.1 * b),
            friction_angle=soil.friction_angle * (1.0 + 0.02 * c),
        )
        for j, (a, b, c) in enumerate(some)
    ]
    return [(varieties[j], PATCH) for j in rng.integers(len(varieties), size=PATCHES)]


def samples_of(seed, kind):
    """Drive, measure, and return the samples of the wheel."""
    rng = np.random.default_rng([3, seed])
    seconds = PATCHES * PATCH
    spans = rng.uniform((4.0, 5.0, 8.0, 8.0, 8.0), (12.0, 16.0, 20.0, 20.0, 20.0))
    track = Track(
        "wheel",
        soil_of(rng, kind),
        undulation(80.0, 0.2, spans[0], seed),
        undulation(0.32, 0.5, spans[1], seed + 1),
        steps([(float(j % 2), seconds / 8.0) for j in range(8)]),
        lambda t: 30.0 + 20.0 * t / seconds + undulation(5.0, 1.0, 25.0, seed + 2)(t),
    )
    memory = -1.0 / (RATE * np.log(kind.memory)) if kind.memory else 0.0
    noisy = Sensor(relative=kind.share, correlation_time=memory)
    drive = Drive(
        [track],
        WHEEL,
        undulation(0.1, 0.3, spans[2], seed + 3),
        lambda t: undulation(0.1, 1.0, spans[3], seed + 4)(t) - 0.1,
        effects=kind.effects,
        rate=RATE,
        yaw_rate=lambda t: undulation(0.05, 1.0, spans[4], seed + 5)(t) - 0.05,
        sensors={
            **dict.fromkeys(("load", "torque", "sinkage", "slip"), noisy),
            "drawbar_pull": Sensor(absolute=5.0 * kind.share * 10.0 / 3.0, correlation_time=memory),
        },
        channels=MEASURED,
        seed=seed,
    )
    columns = simulate(drive).wheels["wheel"].aligned()
    time = columns.pop("time")
    n = len(time)
    patch = np.minimum((time / PATCH).astype(np.int32), PATCHES - 1)
    labels = {"run": Labels(patch, tuple(f"run {j}" for j in range(PATCHES)))} if kind.runs else {}
    return Samples(
        source=f"drive {seed}",
        wheel="wheel",
        geometry=Geometry(WHEEL.radius, WHEEL.width, 0.018, WHEEL.grouser_height, WHEEL.grouser_count),
        origin=0.0,
        time=time,
        channels=columns,
        labels=labels,
        stretch=patch.astype(np.intp) if kind.runs else np.zeros(n, dtype=np.intp),
        distance=columns["x"],
        set_aside=Labels(np.full(n, -1, dtype=np.int32), ()),
    )


def windows_of(seed, kind, segments="auto"):
    """Return the windows of a drive."""
    return cut(samples_of(seed, kind), segments)


#: Known misfits: the effect, and (channel, drivers) of the findings that hit it.
MISFITS = {
    "torque bias 0.25 N m": (
        {"drivetrain-friction": {"Tc": 0.25}},
        {"torque": ("",)},
    ),
    "viscous friction 0.4 N m s": (
        {"drivetrain-friction": {"Tc": 0.0, "Bv": 0.4}},
        {"torque": ("angular_velocity", "velocity")},
    ),
    "slip-sinkage n1 = 0.3": (
        {"slip-sinkage": {"n1": 0.3, "form": "other"}},
        {"sinkage": ("slip",), "torque": ("slip",), "drawbar_pull": ("slip",)},
    ),
    "load cell 8 N too low": (
        {"load-bias": {"gain": 1.0, "offset": 8.0}},
        {"sinkage": ("load", ""), "drawbar_pull": ("load", "")},
    ),
    "torque ripple": (
        {"grouser-ripple": {"torque_sine": 0.01}},
        {"torque": ("wheel_angle",)},
    ),
    "motor −0.3 %/K": (
        {"motor-temperature": {"alpha": -0.003}},
        {"torque": ("motor_temperature",)},
    ),
    "second pass 40 % stiffer": (
        {"multi-pass": {"stiffness_gain": 0.4}},
        {"sinkage": ("pass_number",)},
    ),
}
