"""Drives with a hidden effect, and the answers that a diagnosis of them may give.

The truth is `simulator`'s, which shares nothing with the program. Sizes were set before any result
was looked at, from the values of the literature as they stand beside them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, Literal, TypeAlias

import numpy as np
from simulator import (
    CHANNELS,
    DRY_SAND,
    EFFECTS,
    FURTHER,
    RUBICON_SANDY_LOAM,
    SANDY_LOAM,
    UPLAND_SANDY_LOAM,
    Drive,
    Profile,
    Sensor,
    Soil,
    Track,
    Wheel,
    base_contact,
    constant,
    simulate,
    sinkage_under,
    undulation,
)
from uncatalogued import OUTSIDE

from formats import Labels
from terrain_cli.telemetry.wheel_samples import Geometry, Samples
from terrain_cli.windows.cut_windows import cut

Given: TypeAlias = Mapping[str, Mapping[str, float | str]]
Course = Literal["rich", "poor-load", "poor-speed", "poor"]
#: Correlation of the noise "ar1" from sample to sample.
LASTING = 0.8
Noise = Literal["white", "ar1", "soil", "soil-unlabelled"]

WHEEL = Wheel(radius=0.125, width=0.1, grouser_height=0.01, grouser_count=12)
SOILS = (DRY_SAND, RUBICON_SANDY_LOAM, SANDY_LOAM, UPLAND_SANDY_LOAM)
LOAD, SPEED = 60.0, 0.07
#: s that a patch of soil, a load or a pass lasts.
PATCH = 8.0
#: Deviation of the drawbar pull's noise in N per share of noise: 3 % make 0.45 N.
PULL_NOISE = 15.0

#: Full size of each effect.
FULL: dict[str, dict[str, float]] = {
    "slip-sinkage": {"n1": 0.5},  # Ding 2010: 0.3 to 1.0
    "max-stress-angle": {"c1": 0.18, "c2": 0.32},  # Wong & Reece 1967: loose sand
    "rear-contact": {"c3": 0.45},  # Ishigami 2007: λ from 0.05 to 1.1, in the middle 0.2, c3 = √λ
    "grousers": {"lambda_s": 0.75},  # Ding 2011: 0.5 to 1
    "bulldozing": {"factor": 0.3},  # loose soil: 0.1 to 0.5 of the formula for firm soil
    "side-slip": {"k_growth": 1.2, "lateral": 4.0},  # Ishigami 2007: 0.043 b + 0.036; (kx/ky)² 4 to 8
    "multi-pass": {  # Holm 1969: 10 to 100 % stiffer; looser bonds follow
        "stiffness_gain": 0.5,
        "cohesion_gain": 0.3,
        "shear_modulus_gain": -0.2,
    },
    "drivetrain-friction": {"Tc": 0.3, "Bv": 0.07},  # 5 to 30 % of the torque: here 15 %
    "gear-efficiency": {"eta": 0.8},  # 0.5 to 0.95
    "motor-temperature": {"alpha": -0.002},  # ferrite; the motor warms by 40 K
    "rate-dependence": {"beta": 0.08},  # 0 to 0.15
    "slope": {"factor": 1.0},  # gravity
    "load-transfer": {"ratio": 0.3},  # h/L; 5 to 20 % of the load, with a pull of a fifth of it and slopes
    "load-bias": {"gain": 0.95, "offset": 8.0},  # on a real rover 0.949 to 0.987 and 1 to 114 N
    "sinkage-bias": {"offset": 0.0025},  # millimetres
    "drawbar-bias": {"offset": 2.5},  # on a real rover newtons: here 15 % of the pull
    "wheel-radius": {"relative_error": 0.05},  # 1 to 10 %
    "sinkage-relaxation": {"length": 0.04},  # a third to all of the contact, r θ1: 0.06 m where z is 15 mm
    "sensor-lag": {"torque_lag": 0.2},  # 0.05 to 0.5 s
    "acceleration-torque": {"J": 0.5},  # a rotor of 1e-6 kg m² behind a gear of 700
    "shear-modulus": {"k1": 1.0},  # k from 1 to 40 mm: here from 18 to 36
    "post-peak-softening": {"loss": 0.3, "length": 0.03},  # Wong 2008: residual 0.5 to 0.9, snow 0.022 m
    "strength-curvature": {"B": 0.15},  # Senatore & Iagnemma 2011: 0.05 to 0.2
    "hardpan": {"modulus": 1e7},  # Bowles, Foundation Analysis and Design: stiff clay, dense sand from 1e7
    "crust": {"strength": 5e3, "thickness": 0.005},  # Arvidson 2010: 0.5 to 10 kPa
    "flexible-wheel": {"deflection": 0.05},  # 2 to 10 %
    "grouser-ripple": {  # Shikanai 2000: 5 to 30 % of a pull that is a quarter of the load
        "torque_sine": 0.018,
        "torque_cosine": 0.018,
        "pull_sine": -0.018,
        "pull_cosine": 0.018,
        "sinkage_sine": 0.018,
        "sinkage_cosine": -0.018,
    },
}
#: Powers of force and length in what is no share.
_UNITS: dict[str, dict[str, tuple[int, int]]] = {
    "drivetrain-friction": {"Tc": (1, 1), "Bv": (1, 1)},
    "load-bias": {"offset": (1, 0)},
    "sinkage-bias": {"offset": (0, 1)},
    "drawbar-bias": {"offset": (1, 0)},
    "sinkage-relaxation": {"length": (0, 1)},
    "acceleration-torque": {"J": (1, 1)},
    "post-peak-softening": {"length": (0, 1)},
    "hardpan": {"modulus": (1, -3)},
    "crust": {"strength": (1, -2), "thickness": (0, 1)},
}
#: They say where or how fast an effect acts, not how much.
SHAPES = {("post-peak-softening", "length"), ("hardpan", "top"), ("crust", "thickness")}
#: Beyond these a scaled parameter makes no sense: the greatest stress stays ahead of the lowest point.
LEAST = {"c1": 0.05}

#: Pairs of effects that act in different places, each in its full size.
PAIRS: tuple[tuple[str, str], ...] = (
    ("slip-sinkage", "drivetrain-friction"),
    ("slip-sinkage", "motor-temperature"),
    ("max-stress-angle", "sinkage-bias"),
    ("multi-pass", "slope"),
    ("motor-temperature", "slope"),
    ("grouser-ripple", "drivetrain-friction"),
    ("load-bias", "motor-temperature"),
    ("side-slip", "slope"),
    ("slip-sinkage", "sensor-lag"),
    ("bulldozing", "drivetrain-friction"),
)
#: Drives too poor to tell the first effect from the second, and what has to vary to do so.
SEPARABLE: tuple[tuple[str, str, Course], ...] = (
    ("drivetrain-friction", "rate-dependence", "poor"),
    ("drivetrain-friction", "gear-efficiency", "poor"),
    ("gear-efficiency", "motor-temperature", "poor"),
    ("motor-temperature", "drivetrain-friction", "poor"),
    ("bulldozing", "load-bias", "poor"),
    ("slip-sinkage", "max-stress-angle", "poor"),
    ("load-bias", "strength-curvature", "poor"),
    ("hardpan", "slip-sinkage", "poor"),
    ("sinkage-bias", "load-bias", "poor"),
    ("wheel-radius", "shear-modulus", "poor"),
)


@dataclass(frozen=True)
class Rover:
    """What drives, and on what.

    Parameters
    ----------
    wheel : Wheel
    load : float
        Mean on the wheel, in N.
    speed : float
        Usual V in m/s.
    soils : tuple of Soil
        Of which a drive meets one, or two in turn.
    told_modulus : float
        k in m, as the rover file says it.
    rough : Profile, optional
        Factor of the load.
    """

    wheel: Wheel = WHEEL
    load: float = LOAD
    speed: float = SPEED
    soils: tuple[Soil, ...] = SOILS
    told_modulus: float = 0.018
    rough: Profile = field(default_factory=lambda: constant(1.0))

    @property
    def force(self) -> float:
        """Size of its forces in those of the usual rover."""
        return self.load / LOAD

    @property
    def length(self) -> float:
        """Size of its wheel in those of the usual rover."""
        return self.wheel.radius / WHEEL.radius


@dataclass(frozen=True)
class Kind:
    """What the drives of one kind have in common.

    Parameters
    ----------
    effects : mapping of str to mapping of str to float
        Effects by id with their parameters, as `simulator.Drive` takes them; see `sized`.
    outside : str, optional
        An effect of `uncatalogued.OUTSIDE`, in no catalogue.
    outside_size : float
        1 is its full size.
    course : {"rich", "poor-load", "poor-speed", "poor"}
        What varies: everything; all but the load; all but the speed; slip alone.
    noise : {"white", "ar1", "soil", "soil-unlabelled"}
        "ar1" has a correlation of 0.8 from sample to sample. "soil" puts another variety of the soil
        under every patch, and "run" says where they begin.
    share : float
        Deviation of the noise of load, torque, sinkage and slip as a share of each.
    seconds, rate : float
        Length in s, samples per s.
    soils : int
        1 or 2; two take turns every 32 s.
    rover : Rover
    """

    effects: Given = field(default_factory=dict)
    outside: str | None = None
    outside_size: float = 1.0
    course: Course = "rich"
    noise: Noise = "white"
    share: float = 0.03
    seconds: float = 128.0
    rate: float = 20.0
    soils: int = 1
    rover: Rover = field(default_factory=Rover)


def sized(
    effect: str, size: float = 1.0, form: str = "catalogue", rover: Rover | None = None
) -> dict[str, dict[str, float | str]]:
    """Return an effect at a size, 1 being full: parameters as far from where it is absent.

    The form "other" is "catalogue" where the simulator has no other. What has a unit goes with the
    size of the rover.
    """
    nulls = EFFECTS[effect].parameters
    given: dict[str, float | str] = {
        name: value
        if (effect, name) in SHAPES
        else max(nulls[name] + size * (value - nulls[name]), LEAST.get(name, -np.inf))
        for name, value in FULL[effect].items()
    }
    if rover is not None:
        forces, lengths = _UNITS.get(effect, {}), rover.length
        for name, (force, length) in forces.items():
            given[name] *= rover.force**force * lengths**length
    return {effect: {**given, "form": form if form in EFFECTS[effect].forms else "catalogue"}}


def two(first: str, second: str, form: str = "catalogue") -> dict[str, dict[str, float | str]]:
    """Return two effects at full size."""
    return sized(first, form=form) | sized(second, form=form)


def windows_of(seed: int, kind: Kind, segments: str = "auto") -> list[Any]:
    """Drive, measure, and return the windows of the wheel, as `diagnose` takes them."""
    return [cut(samples_of(seed, kind), segments)]


def samples_of(seed: int, kind: Kind) -> Samples:
    """Drive, measure, and return the samples of the wheel."""
    return samples_from(f"drive {seed}", simulate(drive_of(seed, kind)).wheels["wheel"].aligned(), kind)


def drive_of(seed: int, kind: Kind) -> Drive:
    """Return a drive; the same seed gives the same course and noise, whatever is hidden in it."""
    rng = np.random.default_rng([5, seed])
    soils = _soils(rng, seed, kind)
    course = _course(rng, seed, kind)
    outside = OUTSIDE[kind.outside] if kind.outside else None
    if outside and outside.soil:
        soils = outside.patches(soils[0][0], kind.seconds, kind.outside_size, seed)
    further = {"ambient_light": undulation(300.0, 0.4, rng.uniform(15.0, 30.0), seed + 11)}
    track = Track(
        "wheel", soils, course["load"], course["slip"], course["pass_number"], course["motor_temperature"]
    )
    memory = -1.0 / (kind.rate * math.log(LASTING)) if kind.noise == "ar1" else 0.0
    noisy = Sensor(relative=kind.share, correlation_time=memory)
    return Drive(
        [track],
        kind.rover.wheel,
        course["speed"],
        course["pitch"],
        course["slip_angle"],
        course["yaw_rate"],
        effects=_placed(kind, soils),
        rate=kind.rate,
        sensors={
            **dict.fromkeys(("load", "torque", "sinkage", "slip"), noisy),
            "drawbar_pull": Sensor(
                absolute=PULL_NOISE * kind.share * kind.rover.force, correlation_time=memory
            ),
        },
        channels=(*CHANNELS, *FURTHER),
        further={**further, **(outside.columns(kind.seconds, seed) if outside else {})},
        laws=(outside.law(kind.outside_size),) if outside and not outside.soil else (),
        seed=seed,
    )


def _soils(rng, seed, kind):
    """Return a soil, or two in turn, or one in some six varieties, few so that drives share tables."""
    some = kind.rover.soils
    name, second = np.random.default_rng([6, seed]).permutation(len(some))[:2]
    soil = base_contact(some[name])
    if kind.soils == 2:
        other = base_contact(some[second])
        turns = math.ceil(kind.seconds / 32.0)
        return [((soil, other)[j % 2], kind.seconds / turns) for j in range(turns)]
    if not kind.noise.startswith("soil"):
        return [(soil, kind.seconds)]
    away = np.random.default_rng(name).normal(size=(6, 3))
    varieties = [
        replace(
            soil,
            name=f"{soil.name} {j}",
            cohesion=soil.cohesion * (1.0 + 0.1 * a),
            frictional_modulus=soil.frictional_modulus * (1.0 + 0.1 * b),
            friction_angle=soil.friction_angle * (1.0 + 0.02 * c),
        )
        for j, (a, b, c) in enumerate(away)
    ]
    patches = math.ceil(kind.seconds / PATCH)
    return [(varieties[j], kind.seconds / patches) for j in rng.integers(len(varieties), size=patches)]


def ramps(values, seconds, ramp=1.0):
    """Return one value after another, each for as long, and straight between within `ramp` s."""
    values = np.asarray(values, dtype=float)
    ends = seconds * np.arange(1, len(values))
    times = np.concatenate([[0.0], np.column_stack([ends - ramp / 2, ends + ramp / 2]).ravel()])
    levels = np.concatenate([values[:1], np.column_stack([values[:-1], values[1:]]).ravel()])
    return lambda t: np.interp(t, times, levels)


def _course(rng, seed, kind):
    """Return the profiles of a drive; poor ones leave the random numbers of the others alone."""
    spans = rng.uniform((5.0, 7.0, 12.0, 8.0, 8.0, 8.0), (9.0, 12.0, 20.0, 20.0, 20.0, 20.0))
    patches = math.ceil(kind.seconds / PATCH)
    stepped = ramps(rng.choice([0.8, 0.92, 1.08, 1.2], size=patches), PATCH)
    uneven = undulation(1.0, 0.07, spans[0], seed)
    fast = undulation(1.0, 1.0, spans[2], seed + 3)
    first = int(rng.integers(3))
    rover = kind.rover
    course = {
        "load": lambda t: rover.load * stepped(t) * uneven(t) * rover.rough(t),
        "slip": _sweep(spans[1], seed + 1, 0.05, 0.7),
        # From 0.02 to 0.2 m/s, as much time at low as at high speed.
        "speed": lambda t: rover.speed * np.exp(1.1 * (fast(t) - 1.0)),
        "pitch": lambda t: undulation(0.2, 1.0, spans[3], seed + 4)(t) - 0.2,
        "yaw_rate": lambda t: undulation(0.08, 1.0, spans[4], seed + 5)(t) - 0.08,
        "slip_angle": lambda t: undulation(0.25, 1.0, spans[5], seed + 6)(t) - 0.25,
        "pass_number": lambda t: (np.floor(np.maximum(t, 0.0) / (2.0 * PATCH)) + first) % 3.0,
        "motor_temperature": lambda t: (
            25.0 + 35.0 * t / kind.seconds + undulation(5.0, 1.0, 25.0, seed + 2)(t)
        ),
    }
    level = constant(0.0)
    if kind.course in {"poor", "poor-load"}:
        course["load"] = lambda t: rover.load * rover.rough(t)
    if kind.course in {"poor", "poor-speed"}:
        course["speed"] = constant(rover.speed)
    if kind.course == "poor":
        course.update(pitch=level, yaw_rate=level, slip_angle=level, pass_number=level)
        course["motor_temperature"] = constant(30.0)
    return course


def _sweep(span, seed, low, high):
    """Return a slip that goes up and down between bounds, denser where it is low, where soils differ most."""
    wave = undulation(1.0, 1.0, span, seed)
    return lambda t: low + (high - low) * np.clip(0.5 + 0.75 * (wave(t) - 1.0), 0.0, 1.0) ** 1.3


def _placed(kind, soils):
    """Put the top of a hardpan at 0.6 of the mean sinkage, where the wheel always reaches it."""
    effects, rover = kind.effects, kind.rover
    if "hardpan" not in effects or "top" in effects["hardpan"]:
        return effects
    return {**effects, "hardpan": {**effects["hardpan"], "top": _top(soils[0][0], rover.wheel, rover.load)}}


@lru_cache
def _top(soil, wheel, load):
    return round(0.6 * sinkage_under(soil, wheel, load, 0.3), 5)


def samples_from(source, columns, kind):
    """Return the samples of the wheel from its table."""
    time, wheel = columns.pop("time"), kind.rover.wheel
    n = len(time)
    patches = math.ceil(kind.seconds / PATCH)
    patch = np.minimum((time / PATCH).astype(np.int32), patches - 1)
    runs = kind.noise == "soil"
    return Samples(
        source=source,
        wheel="wheel",
        geometry=Geometry(
            wheel.radius, wheel.width, kind.rover.told_modulus, wheel.grouser_height, wheel.grouser_count
        ),
        origin=0.0,
        time=time,
        channels=columns,
        labels={"run": Labels(patch, tuple(f"run {j}" for j in range(patches)))} if runs else {},
        stretch=patch.astype(np.intp)
        if runs
        else np.cumsum(np.diff(time, prepend=time[:1]) > 1.5 / kind.rate),
        distance=columns["x"],
        set_aside=Labels(np.full(n, -1, dtype=np.int32), ()),
    )
