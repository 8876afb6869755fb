"""Physical effects on the ground under a wheel: what they do to the soil, the stresses and the contact.

Each is a scalar function that changes `wheel.Ground` before it is integrated. "catalogue" is the
law by which the program knows the effect, so that its parameters can be recovered; "other" is
another law of the same thing, which the program's can only come near. Effects that change a
force, or what a sensor shows, are in `sensing`.

Tables serve effects that follow load and slip smoothly. Where an effect follows speed, slip angle
or pass number each value has a table of its own if enough samples share it, and else every sample
is integrated, some 4 ms each, as it is for hardpan, crust and a skidding wheel. In long drives those
are interpolated too, the former between tables at a few speeds or slip angles: relative errors are
then below 1e-5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.polynomial.chebyshev import chebvander

from simulator.tables import forces_under
from simulator.wheel import Moment, forces, sinkage_under

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from simulator.soils import Soil
    from simulator.wheel import Ground, Model, Wheel

    Array = NDArray[np.float64]

#: id → its parameters, and "form" where that is "other".
Given: TypeAlias = "Mapping[str, Mapping[str, float | str]]"
Numbers: TypeAlias = dict[str, float]
#: The same, hashable: (id, form, ((name, value), …)) in the order in which they act.
Frozen: TypeAlias = tuple[tuple[str, str, tuple[tuple[str, float], ...]], ...]


@dataclass(frozen=True, slots=True)
class Known:
    """An effect that the simulator can do.

    Parameters
    ----------
    parameters : dict of str to float
        Names and the values without effect.
    phase : {"numbers", "angles", "stresses"}
        When it changes the ground.
    reads : tuple of str
        What of `Moment` the ground answers to, beside slip and load.
    sharp : bool
        Whether forces have kinks in sinkage, which tables cannot follow.
    forms : tuple of str
    act : callable, optional
        None where it does not change the ground.
    """

    parameters: Numbers
    phase: str = "numbers"
    reads: tuple[str, ...] = ()
    sharp: bool = False
    forms: tuple[str, ...] = ("catalogue", "other")
    act: Callable[[Ground, Moment, Numbers, bool], None] | None = None


def base_contact(soil: Soil) -> Soil:
    """Return a soil with the contact that a model without effects has: θm = θ1/2, θ2 = 0."""
    return replace(soil, c1=0.5, c2=0.0, exit_ratio=0.0)


# The soil


def slip_sinkage(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    # Ding et al. 2010: the exponent grows with slip.
    slip = abs(ground.slip)
    straight, parabola = p["n1"] * (1.0 - p["bend"]) * slip, p["n1"] * p["bend"] * slip**2
    ground.exponent += p["n1"] * slip**1.5 if other else straight + parabola
    if ground.slip < 0.0:
        ground.exponent += p["n2"] * -ground.slip


def multi_pass(ground: Ground, moment: Moment, p: Numbers, other: bool) -> None:
    # The first pass does most of it, or here all of it.
    passes = moment.pass_number
    share = math.exp(-1.0) + p["further"]
    done = min(passes, 1.0) if other else (1.0 - share**passes) / (1.0 - share)
    ground.stiffness *= 1.0 + p["stiffness_gain"] * done
    ground.cohesion *= 1.0 + p["cohesion_gain"] * done
    ground.shear_modulus *= 1.0 + p["shear_modulus_gain"] * done


def shear_modulus(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    slip = abs(ground.slip)
    ground.shear_modulus *= 1.0 + p["k1"] * (math.tanh(slip) if other else slip)


def hardpan(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    # A spring below the top of the layer; or one that stiffens.
    loose = ground.pressure

    def pressure(depth: float) -> float:
        below = max(depth - p["top"], 0.0) / 0.01
        return loose(depth) + p["modulus"] * 0.01 * below ** (1.2 if other else 1.0)

    ground.pressure = pressure
    ground.kinks.append(p["top"])


def crust(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    below = ground.pressure

    def pressure(depth: float) -> float:
        share = max(depth, 0.0) / p["thickness"]
        return below(depth) + p["strength"] * (math.tanh(share) if other else 1.0 - math.exp(-share))

    ground.pressure = pressure


# The contact


def max_stress_angle(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    # Wong & Reece 1967; in the other form it levels off.
    ground.peak = (p["c1"] + p["c2"] * (math.tanh(ground.slip) if other else ground.slip)) * ground.entry


def rear_contact(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    # Ishigami et al. 2007: the rut is a share λ of the sinkage high, for which c3 stands as √λ.
    if other:
        ground.leave = -math.acos(1.0 - p["c3"] ** 2 * ground.sinkage / ground.radius)
    else:
        ground.leave = -p["c3"] * ground.entry


def grousers(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    # Ding et al. 2011; in the other form the tips, a tenth of the area, press outside the rim too.
    lift = p["lambda_s"] * ground.wheel.grouser_height
    ground.shear_radius = ground.radius + lift
    if other:
        ground.radius += 0.1 * lift


def wheel_radius(ground: Ground, _moment: Moment, p: Numbers, _other: bool) -> None:
    larger = 1.0 + p["whole"] * p["relative_error"]
    ground.radius *= larger
    ground.shear_radius *= larger


def flexible_wheel(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    # An arc as long as that of a wheel sunk by δ more, sheared about an axle that is δ lower.
    r = ground.wheel.radius
    least = 0.0 if other else 0.02 * r
    ground.arm = (1.0 - p["deflection"]) * r
    flatter = ground.radius * p["deflection"] * r / (ground.sinkage + least)
    ground.radius += flatter
    ground.shear_radius += flatter


# The shear stress


def rate_dependence(ground: Ground, moment: Moment, p: Numbers, other: bool) -> None:
    ratio = moment.velocity / 0.1
    gain = ratio ** p["beta"] if other else 1.0 + p["beta"] * math.log(ratio)
    ground.cohesion *= gain
    ground.tan_phi *= gain


def strength_curvature(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    phi = math.atan(ground.tan_phi)

    def strength(stress: float) -> float:
        if other:
            # The angle, not its tangent, falls by so much for each factor e, and not without end.
            fall = p["B"] * math.sin(phi) * math.cos(phi) * math.log((stress + 100.0) / 10e3)
            return ground.cohesion + stress * math.tan(phi - fall)
        return ground.cohesion + stress * ground.tan_phi * math.exp(
            -p["B"] * math.log(max(stress, 1.0) / 10e3)
        )

    ground.strength = strength


def post_peak_softening(ground: Ground, _moment: Moment, p: Numbers, other: bool) -> None:
    before = ground.mobilised

    def mobilised(displacement: float, theta: float) -> float:
        way = abs(displacement) / p["length"]
        lost = way * way / (1.0 + way * way) if other else 1.0 - math.exp(-way)
        return before(displacement, theta) * (1.0 - p["loss"] * lost)

    ground.mobilised = mobilised


def side_slip(ground: Ground, moment: Moment, p: Numbers, other: bool) -> None:
    # The soil shears along and across at once, and its strength points the way it is sheared.
    ground.shear_modulus *= 1.0 + p["k_growth"] * abs(moment.slip_angle)
    alone = ground.mobilised

    def mobilised(displacement: float, theta: float) -> float:
        way = ground.radius * ground.grip * (ground.entry - theta) * math.tan(moment.slip_angle)
        along = displacement / ground.shear_modulus
        across = math.sqrt(p["lateral"]) * way / ground.shear_modulus
        both = math.hypot(along, across)
        if both == 0.0:
            return 0.0
        if other:
            # Each mobilised by itself, and both within one circle of strength.
            x, y = abs(alone(displacement, theta)), 1.0 - math.exp(-abs(across))
            return math.copysign(x, along) / max(1.0, math.hypot(x, y))
        return (1.0 - math.exp(-both)) * along / both

    ground.mobilised = mobilised


KNOWN: dict[str, Known] = {
    "slip-sinkage": Known({"n1": 0.0, "n2": 0.0, "S": 0.0, "bend": 0.0}, act=slip_sinkage),
    "multi-pass": Known(
        {"stiffness_gain": 0.0, "cohesion_gain": 0.0, "shear_modulus_gain": 0.0, "further": 0.0},
        reads=("pass_number",),
        act=multi_pass,
    ),
    "shear-modulus": Known({"k1": 0.0}, act=shear_modulus),
    "hardpan": Known({"modulus": 0.0, "top": 0.02}, "stresses", sharp=True, act=hardpan),
    "crust": Known({"strength": 0.0, "thickness": 0.005}, "stresses", sharp=True, act=crust),
    "max-stress-angle": Known({"c1": 0.5, "c2": 0.0}, "angles", act=max_stress_angle),
    "rear-contact": Known({"c3": 0.0}, "angles", act=rear_contact),
    "grousers": Known({"lambda_s": 0.0}, act=grousers),
    "flexible-wheel": Known({"deflection": 0.0}, act=flexible_wheel),
    "rate-dependence": Known({"beta": 0.0}, reads=("velocity",), act=rate_dependence),
    "strength-curvature": Known({"B": 0.0}, "stresses", act=strength_curvature),
    "post-peak-softening": Known({"loss": 0.0, "length": 0.05}, "stresses", act=post_peak_softening),
    "side-slip": Known({"k_growth": 0.0, "lateral": 0.0}, "stresses", reads=("slip_angle",), act=side_slip),
    "bulldozing": Known({"factor": 0.0}),
    "slope": Known({"factor": 0.0}, forms=("catalogue",)),
    "load-transfer": Known({"ratio": 0.0, "slope_ratio": 0.0}),
    "drivetrain-friction": Known({"Tc": 0.0, "Bv": 0.0}),
    "gear-efficiency": Known({"eta": 1.0}),
    "motor-temperature": Known({"alpha": 0.0}),
    "load-bias": Known({"gain": 1.0, "offset": 0.0}, forms=("catalogue",)),
    "sinkage-bias": Known({"offset": 0.0}),
    "drawbar-bias": Known({"offset": 0.0}),
    "wheel-radius": Known({"relative_error": 0.0, "whole": 0.0}, forms=("catalogue",), act=wheel_radius),
    "sinkage-relaxation": Known({"length": 0.0}),
    "sensor-lag": Known({"torque_lag": 0.0, "drawbar_pull_lag": 0.0, "sinkage_lag": 0.0, "filtered": 0.0}),
    "acceleration-torque": Known({"J": 0.0}, forms=("catalogue",)),
    "grouser-ripple": Known(
        {f"{channel}_{part}": 0.0 for channel in ("torque", "pull", "sinkage") for part in ("sine", "cosine")}
    ),
}


def freeze(given: Given) -> Frozen:
    """Check effects and fill in their parameters.

    Raises
    ------
    ValueError
        No such effect, parameter or form.
    """
    frozen = []
    for name, numbers in given.items():
        if name not in KNOWN:
            raise ValueError(f"no effect {name!r}, only {', '.join(KNOWN)}")
        own = dict(numbers)
        form = own.pop("form", "catalogue")
        unknown = own.keys() - KNOWN[name].parameters.keys()
        if unknown or form not in KNOWN[name].forms:
            raise ValueError(f"{name} has no {', '.join(unknown) or f'form {form}'}")
        frozen.append((name, str(form), tuple({**KNOWN[name].parameters, **own}.items())))
    return tuple(frozen)


@dataclass(frozen=True)
class OnGround:
    """What effects do to the ground, as `wheel` calls it; equal ones share their tables."""

    effects: Frozen
    moment: Moment

    def __call__(self, ground: Ground, phase: str) -> None:
        for name, form, numbers in self.effects:
            known = KNOWN[name]
            if known.act and known.phase == phase:
                known.act(ground, self.moment, dict(numbers), form == "other")


#: From so many different samples on a table is faster than to integrate each.
_WORTH_A_TABLE = 60
#: From so many on a long drive is worth an error of 1e-5.
_LONG = 400
#: Tables at so many Chebyshev points of the speed (its logarithm) or of the slip angle (either way).
_POINTS = 6
_SMOOTH: dict[str, tuple[Callable[[Array], Array], Callable[[float], float], float]] = {
    "velocity": (np.log, math.exp, 0.25),
    "slip_angle": (np.abs, float, 0.05),
}


def forces_with(
    effects: Frozen,
    soil: Soil,
    wheel: Wheel,
    load: Array,
    slip: Array,
    moments: Mapping[str, Array],
    model: Model = "wong-reece",
) -> tuple[Array, Array, Array]:
    """Return sinkage in m, torque in N m and drawbar pull in N of many samples, effects included.

    Parameters
    ----------
    effects : Frozen
        Of `freeze`; those that are not on the ground do nothing here.
    soil : Soil
    wheel : Wheel
    load, slip : ndarray, shape (n,)
        As the soil feels them.
    moments : mapping of str to ndarray, shape (n,)
        The channels of `Moment`.
    model : {"wong-reece", "linear"}
    """
    on_ground = tuple(effect for effect in effects if KNOWN[effect[0]].act)
    if not on_ground and np.all(slip >= 0.0):
        return forces_under(soil, wheel, load, slip, model)
    read = [name for name in Moment.__slots__ if any(name in KNOWN[e[0]].reads for e in on_ground)]
    sharp = any(KNOWN[effect[0]].sharp for effect in on_ground)
    found = np.empty((3, len(load)))
    columns = np.array([moments[name] for name in read]).reshape(len(read), len(load))
    kinds, kind = np.unique(columns, axis=1, return_inverse=True)
    long = len(load) > _LONG and bool(np.all(slip >= 0.0))
    if long and kinds.shape[1] > _LONG and len(read) == 1 and read[0] in _SMOOTH:
        return _between(on_ground, soil, wheel, load, slip, read[0], columns[0], model)
    sharp = sharp and not long
    for j in range(kinds.shape[1]):
        laws = OnGround(on_ground, Moment(**dict(zip(read, kinds[:, j].tolist(), strict=True))))
        here = np.flatnonzero(kind.ravel() == j)
        smooth = here[slip[here] >= 0.0] if not sharp and len(here) >= _WORTH_A_TABLE else here[:0]
        found[:, smooth] = forces_under(soil, wheel, load[smooth], slip[smooth], model, laws)
        rest = np.setdiff1d(here, smooth)
        pairs, pair = np.unique([load[rest], slip[rest]], axis=1, return_inverse=True)
        each = [_one(soil, wheel, *row, model, laws) for row in pairs.T.tolist()]
        found[:, rest] = np.array(each).reshape(-1, 3)[pair.ravel()].T
    return found[0], found[1], found[2]


def _between(
    on_ground: Frozen,
    soil: Soil,
    wheel: Wheel,
    load: Array,
    slip: Array,
    name: str,
    values: Array,
    model: Model,
) -> tuple[Array, Array, Array]:
    """Interpolate between tables at Chebyshev points of what the ground answers to."""
    scale, back, step = _SMOOTH[name]
    along = scale(values)
    # Rounded outwards, so that drives share their tables.
    low, high = step * math.floor(along.min() / step), step * math.ceil(along.max() / step)
    points = np.cos(np.pi * (np.arange(_POINTS) + 0.5) / _POINTS)
    at_points = np.array(
        [
            forces_under(
                soil,
                wheel,
                load,
                slip,
                model,
                OnGround(on_ground, Moment(**{name: back(0.5 * (low + high) + 0.5 * (high - low) * x)})),
            )
            for x in points.tolist()
        ]
    )
    coefficients = np.linalg.inv(chebvander(points, _POINTS - 1))
    basis = chebvander((2.0 * along - low - high) / (high - low), _POINTS - 1) @ coefficients
    sinkage, torque, pull = np.einsum("np,pfn->fn", basis, at_points)
    return sinkage, torque, pull


@lru_cache(maxsize=100_000)
def _one(
    soil: Soil, wheel: Wheel, load: float, slip: float, model: Model, laws: OnGround
) -> tuple[float, float, float]:
    depth = sinkage_under(soil, wheel, load, slip, model, laws)
    found = forces(soil, wheel, depth, slip, model, laws)
    return depth, found.torque, found.pull
