"""Wrong units, found by combinations of channels that no wheel on soil can show.

Bounds marked "ranges" are what the equations of Wong and Reece give for wheels of 5 to 30 cm radius at
depths up to 0.7 r, over the soils of Tables I and II of Iagnemma et al. 2004.
"""

from collections.abc import Callable

import numpy as np

from terrain_cli.telemetry import unit_doubts
from terrain_cli.telemetry.unit_doubts import (
    ALIKE,
    ROUNDED,
    Doubt,
    Mend,
    Suspicion,
    UnitEvidence,
    Weight,
    limited,
    pull,
    stuck,
)
from terrain_cli.telemetry.usable_samples import MOST_PRESSURE
from terrain_cli.telemetry.wheel_samples import Plan
from terrain_cli.vocabulary.arrays import Array

#: Ranges: 1.5 kPa and more, under 1.5 kPa of load on r · b. A rover of 1 kg on the Moon has 0.8; Pa.
LEAST_PRESSURE = 200.0
#: T/(W r). Ranges: up to 2.05, at full slip on the soil of most cohesion; grousers and friction add 30 %.
MOST_TORQUE = 2.5
#: T/(W r) over the slip. Ranges: 0.08 and more, from a slip of 0.05 on; an offset may take most of it.
LEAST_TORQUE = 0.02
FAR = 4.0  # What is further out of bounds by this factor is a wrong unit and no odd soil: judged
#: Time and velocity against the track. A wheel on the outside of a tight turn drives three times as far as
#: the body, and one that slips by 0.8 five times if V is its rim's; wrong units of time make 60 and more.
MOST_DISTANCE = 10.0
WANDERING = 50.0  # A satellite receiver that stands still wanders by some 10 m, there and back; m
#: V/(ω r) with a torque that drives. Ranges: T/(W r) at 2 and more is below −0.07; friction adds 0.1 to that.
MOST_SKID, DRIVING = 2.0, 0.1
#: A measured slip against that of ω and V. Another radius (tips of grousers, loaded tyre) makes 0.2.
ODD_SLIP, WRONG_SLIP = 0.3, 0.5
#: z/r. Ranges: 0.001 and more; and no sensor resolves a fiftieth of a millimetre on a wheel of 10 cm.
LEAST_DEPTH = 2e-4
STEEPEST = 1.0  # Pitch and roll in rad: no soil lies steeper than 45°
HOTTEST = 200.0  # A motor's windings are burnt at 180 °C (class H); 20 °C are 293 K
#: Distance between two samples in r: what one tells of the soil the next does not. Judged: 2.5 m of a wheel
#: of 12.5 cm; a rover that sends a sample every 20 s drives 1 m between them.
SPARSE = 20.0
#: What a typical drive has: z/r, T/(W r), mean pressure in Pa. Of several units the likeliest comes nearest.
_DEPTH, _TORQUE, _PRESSURE = 0.1, 0.35, 15e3


def _track(e: UnitEvidence) -> Suspicion | None:
    """Set the distance by time and velocity against the track."""
    blocks = np.array([block for block in e.blocks if block[0] > 0.0])
    if not len(blocks):
        return None
    driven, path, ends, jitter = blocks.T
    with np.errstate(invalid="ignore", divide="ignore"):
        more, less = np.median(driven / path), np.median((ends - 10.0 * jitter) / driven)
    along = float(np.median(path)) * len(blocks)
    if more > MOST_DISTANCE and along > 2.0 * e.geometry.radius:
        times = float(more)
    elif less > MOST_DISTANCE and np.median(ends) * len(blocks) > WANDERING * e.on_earth:
        times = 1.0 / float(less)
    else:
        return None
    # A velocity that was derived is from ω and slip.
    speed = "velocity" if "velocity" in e.measured else "angular_velocity"
    options = [
        *(Mend("time", unit) for unit in ("ms", "µs", "ns", "min", "h")),
        *(Mend(speed, unit) for unit in _SPEEDS[speed]),
        *(Mend("x", unit) for unit in ("km", "cm", "mm")),
        Mend("longitude", "rad"),
    ]
    # Of two that explain it, a clock with samples a second apart is the likelier.
    slow = not e.interval < 1.0

    def off(mend: Mend) -> tuple[float, bool]:
        left = times / mend.factor if mend.channel in ALIKE else times * mend.factor
        return round(abs(np.log(left)), 1), (mend.channel == "time") != slow

    chosen = min((mend for mend in options if mend.channel in e.feeds), key=off)
    driven_by = _metres(times * along if times > 1.0 else float(driven.sum()))
    what = f"time and velocity make {driven_by} of a track of {_metres(along)}"
    return Suspicion(what, chosen.channel, chosen, "contradiction")


_SPEEDS = {"velocity": ("cm/s", "mm/s", "km/h"), "angular_velocity": ("deg/s", "rpm", "rev/s")}


def _metres(distance: float) -> str:
    return f"{distance:,.{2 if distance < 10.0 else 0}f} m"


def _sparse(e: UnitEvidence) -> Suspicion | None:
    """Find samples that are too far apart, where no track shows that they are."""
    found = e.columns("velocity") if "time" in e.measured and not e.blocks else None
    if found is None:
        return None
    apart = e.interval * float(np.median(np.abs(found[0])))
    if not apart > SPARSE * e.geometry.radius:
        return None
    what = f"samples are {e.interval:.3g} s apart, in which the wheel drives {_metres(apart)}"
    # At 10 to 1000 Hz a clock in ms has steps of 1 to 100.
    unit = "ms" if e.interval <= 1e3 else "µs" if e.interval <= 1e5 else "ns"
    return Suspicion(what, "time", Mend("time", unit))


def _slip(e: UnitEvidence) -> Suspicion | None:
    found = e.columns("slip") if "slip" in e.measured else None
    if found is None:
        return None
    size = np.abs(found[0])
    share = float(np.mean(size > 1.0))
    # Near standstill a slip may be anything, in a few samples.
    if share < 0.25:
        return None
    what = f"slip is beyond ±1 in {share:.0%} of the samples, {np.median(size[size > 1.0]):.3g} in the median"
    return Suspicion(what, "slip", Mend("slip", "%"), "impossible" if share > 0.5 else "odd")


def _rim(e: UnitEvidence) -> Suspicion | None:
    if not {"angular_velocity", "velocity"} <= e.measured:
        return None
    found = e.columns("angular_velocity", "velocity")
    if found is None:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = found[1] / (e.geometry.radius * found[0])
    ratio = ratio[np.isfinite(ratio)]
    if "slip" in e.measured:
        return _two_slips(e, float(np.median(ratio)))
    low, middle, high = np.quantile(ratio, [0.05, 0.5, 0.95])
    for unit in ("deg/s", "rpm"):
        mend = Mend("angular_velocity", unit)
        # Driving slips of 0 to 0.8, with 15 % for noise.
        if 0.2 * mend.factor < low and high < 1.15 * mend.factor and (unit == "deg/s" or _follows(e, ratio)):
            what = f"ω r is {1.0 / middle:.3g} times V, a slip of {1.0 - middle:.3f} through the whole drive"
            return Suspicion(what, mend.channel, mend, "impossible" if unit == "deg/s" else "odd")
    drives = e.columns("torque", "load")
    if middle > MOST_SKID and drives and np.median(drives[0] - DRIVING * e.geometry.radius * drives[1]) > 0.0:
        options = [
            *(Mend("velocity", unit) for unit in _SPEEDS["velocity"]),
            Mend("angular_velocity", "rev/s"),
        ]
        mend = min(options, key=lambda m: abs(np.log(middle * _times(m) / 0.8)))
        what = f"V is {middle:.3g} times ω r, as if the wheel skidded, while its torque drives"
        return Suspicion(what, mend.channel, mend, "impossible" if middle > 5.0 * FAR else "odd")
    return None


def _follows(e: UnitEvidence, ratio: Array) -> bool:
    """Tell whether the torque follows a slip that seems to be above 0.89 all the time."""
    # The shear of the soil is spent there: T/(W r) changes by less than the slip itself does.
    found = e.columns("torque", "load", "angular_velocity", "velocity")
    if found is None:
        return False
    torque, load, omega, velocity = found
    with np.errstate(divide="ignore", invalid="ignore"):
        share, own = torque / (load * e.geometry.radius), velocity / (e.geometry.radius * omega)
    fast = own > np.median(ratio)
    if fast.all() or not fast.any():
        return False
    apart = np.median(own[fast]) - np.median(own[~fast])
    return bool(np.median(share[~fast]) - np.median(share[fast]) > 2.0 * apart)


def _two_slips(e: UnitEvidence, ratio: float) -> Suspicion | None:
    """Set a measured slip against that of ω and V."""
    found = e.columns("slip", "angular_velocity", "velocity")
    if found is None or np.median(np.abs(found[0])) > 1.0:
        return None
    slip = float(np.median(found[0]))

    def off(times: float) -> float:
        return abs(_slip_of(ratio * times) - slip)

    if off(1.0) < ODD_SLIP:
        return None
    options = [Mend(name, unit) for name, several in _SPEEDS.items() for unit in several]
    mend = min(options, key=lambda m: off(_times(m)))
    weight: Weight = "contradiction" if off(1.0) > WRONG_SLIP else "odd"
    what = f"slip is {slip:.2f} in the median, but by ω, V and the wheel's radius it is {_slip_of(ratio):.2f}"
    if off(_times(mend)) > 0.5 * ODD_SLIP:
        return Suspicion(what, "slip", None, weight)
    return Suspicion(what, mend.channel, mend, weight)


def _times(mend: Mend) -> float:
    """Return by what a unit of one of the speeds multiplies V/(ω r)."""
    return mend.factor if mend.channel == "velocity" else 1.0 / mend.factor


def _slip_of(ratio: float) -> float:
    return 1.0 - ratio if ratio <= 1.0 else 1.0 / ratio - 1.0


def _depth(e: UnitEvidence) -> Suspicion | None:
    source = "sinkage" if "sinkage" in e.measured else "entry_angle"
    found = e.columns(source) if source in e.measured else None
    if found is None:
        return None
    if source == "entry_angle":
        share = float(np.mean(np.abs(found[0]) > np.pi / 2.0))
        what = f"entry_angle is beyond a right angle in {share:.0%} of the samples"
        mend = Mend(source, "deg")
    else:
        radius, depth = e.geometry.radius, found[0][found[0] > 0.0]
        if len(depth) < 5:
            return None
        share, middle = float(np.mean(depth >= radius)), float(np.median(depth))
        options = [Mend(source, unit) for unit in ("mm", "cm", "in")]
        mend = min(options, key=lambda m: abs(np.log(middle * m.factor / radius / _DEPTH)))
        if middle < LEAST_DEPTH * radius:
            what = f"sinkage is {middle:.2g} m in the median, less than a sensor resolves"
            return Suspicion(what, source)
        what = f"sinkage is {middle:.3g} m in the median, and beyond the radius in {share:.0%} of the samples"
    if share < 0.25:
        return None
    return Suspicion(what, source, mend, "impossible" if share > 0.5 else "odd")


def _forces(e: UnitEvidence) -> Suspicion | None:
    """Set the load against the torque, and against the area that the sinkage gives it."""
    radius, width = e.geometry.radius, e.geometry.width
    pressure = share = slip = np.nan
    found = e.columns("load", "sinkage")
    if found:
        load, depth = found
        inside = (load > 0.0) & (depth > 0.0) & (depth < radius)
        if np.mean(inside) > 0.5:
            area = width * np.sqrt((2.0 * radius - depth[inside]) * depth[inside])
            pressure = float(np.median(load[inside] / area))
    found = e.columns("torque", "load", "slip")
    if found:
        torque, load, slips = found
        drives = (load > 0.0) & (np.abs(slips) <= 1.0)
        if np.mean(drives) > 0.5:
            # The upper quarter: a drive may begin at no slip, and no torque.
            share = float(np.quantile(np.abs(torque[drives]) / (radius * load[drives]), 0.75))
            slip = float(np.median(slips[drives]))
    turned = f"torque is {share:.3g} times load times wheel radius"
    pressed = f"the load presses on the soil with {pressure / 1e3:.2g} kPa at this sinkage"
    # How far out of its bound each is; what is not known is NaN, and within.
    bounds = (
        (share / MOST_TORQUE, f"{turned}, more than any soil can resist"),
        (_over(LEAST_TORQUE * slip, share) if slip > 0.05 else 0.0, f"{turned} at a slip of {slip:.2f}"),
        (pressure / MOST_PRESSURE, f"{pressed}, more than any soil can bear"),
        (_over(LEAST_PRESSURE, pressure), f"{pressed}, too little for such a sinkage"),
    )
    out, what = max(bounds, key=lambda bound: np.nan_to_num(bound[0]))
    if not out > 1.0:
        return None
    mend = _unit_of_force(e, share, pressure)
    return Suspicion(what, mend.channel if mend else "load", mend, "impossible" if out > FAR else "odd")


def _over(limit: float, value: float) -> float:
    return limit / value if value > 0.0 else 0.0


def _unit_of_force(e: UnitEvidence, share: float, pressure: float) -> Mend | None:
    """Choose the unit that comes nearest to a typical drive."""
    # By what T/(W r) and the pressure are multiplied: the powers of the factor.
    options = {
        **{Mend("load", unit): (-1.0, 1.0) for unit in ("kgf", "kN", "mN")},
        Mend("load", "kgf", 1e-3): (-1.0, 1.0),
        **{Mend("torque", unit): (1.0, 0.0) for unit in ("N mm", "N cm", "kN m")},
        Mend("motor_current", "mA"): (1.0, 0.0),
        **{Mend("sinkage", unit): (0.0, -0.5) for unit in ("mm", "cm")},
    }

    def far(powers: tuple[float, float], factor: float) -> float:
        values = (share * factor ** powers[0] / _TORQUE, pressure * factor ** powers[1] / _PRESSURE)
        return float(np.nansum(np.abs(np.log(values))))

    there = [mend for mend in options if mend.channel in e.feeds]
    best = min(there, key=lambda mend: far(options[mend], mend.factor), default=None)
    return best if best and far(options[best], best.factor) < far((0.0, 0.0), 1.0) else None


def _sign(e: UnitEvidence) -> Suspicion | None:
    """Find a torque that brakes a driving wheel."""
    found = e.columns("torque", "slip")
    if found is None or np.median(found[0]) >= 0.0 or np.median(found[1]) <= 0.0:
        return None
    source, unit = ("torque", "N m") if "torque" in e.feeds else ("motor_current", "A")
    return Suspicion("torque is negative although the wheel drives", source, Mend(source, unit, -1.0))


def _angle(name: str, most: float) -> Callable[[UnitEvidence], Suspicion | None]:
    def check(e: UnitEvidence) -> Suspicion | None:
        found = e.columns(name) if name in e.measured else None
        if found is None:
            return None
        # From 0 to 2π is as good as from −π to π.
        steep = float(np.quantile(np.abs((found[0] + np.pi) % (2.0 * np.pi) - np.pi), 0.95))
        if steep <= most:
            return None
        reached = float(np.quantile(np.abs(found[0]), 0.95))
        return Suspicion(f"{name} reaches {reached:.3g} rad", name, Mend(name, "deg"))

    return check


def _hot(e: UnitEvidence) -> Suspicion | None:
    """Find a motor that would have burnt."""
    found = e.columns("motor_temperature") if "motor_temperature" in e.measured else None
    if found is None or (middle := float(np.median(found[0]))) <= HOTTEST:
        return None
    what = f"motor_temperature is {middle:.0f} °C in the median, at which a motor burns"
    return Suspicion(what, "motor_temperature", Mend("motor_temperature", "K"))


_CHANGING = ("torque", "motor_current", "drawbar_pull", "load", *ROUNDED)  # With slip or load, of a wheel
#: In this order: of several that are errors the first is raised.
CHECKS: tuple[Callable[[UnitEvidence], Suspicion | None], ...] = (
    # A velocity that was derived from a slip in % is wrong with it.
    _slip,
    _track,
    _sparse,
    _rim,
    _depth,
    _forces,
    _sign,
    pull,
    _angle("pitch", STEEPEST),
    _angle("roll", STEEPEST),
    # A wheel dragged sideways has a right angle; a tenth for the sensor.
    _angle("slip_angle", 0.55 * np.pi),
    _hot,
    # T grows by a third and more from a slip of 0.1 to 0.2, and with the load; z with load^0.6 (ranges).
    *map(stuck, _CHANGING),
    *map(limited, _CHANGING),
)


def found(layout: Plan, wheel: str, evidence: UnitEvidence) -> list[Doubt]:
    """Say what is hardly true of a wheel, and what would mend it; what cannot be true is an error."""
    suspicions = filter(None, (check(evidence) for check in CHECKS))
    return unit_doubts.tell(layout, wheel, evidence.feeds, suspicions)
