"""Drivers: the quantities that the residuals of a wheel may depend on, recorded or derived."""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import partial

import numpy as np

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison import shapes
from terrain_cli.comparison.comparison_outcome import Driver
from terrain_cli.mechanics import rates
from terrain_cli.telemetry.effect_inputs import WITH_COURSE, sources
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS, LABEL
from terrain_cli.windows.cut_windows import Windows, at_rows

#: Channels that are predicted, or what predicted ones were derived from.
_LEFT_OUT = frozenset({"time", "torque", "drawbar_pull", "entry_angle", "motor_current"})
_PLACE = frozenset({"longitude", "latitude"})  # The place, where x and y do not say it
#: Columns that say how far another one scatters, and drive nothing.
_SCATTER = re.compile(r"(^|[_ ])(std|stdev|stddev|sd|sigma|variance)($|[_ ])", re.IGNORECASE)
ANGLE = "wheel_angle"  # Angle through which the wheel has turned: what grousers and an eccentric hub follow
#: What is no cause of a residual that lasts: see `beside`.
_NO_CAUSE = frozenset({"time", "x", "y", "elevation", *_PLACE, ANGLE, "sinkage"})
_TELL = 4_000  # Samples that tell whether a residual follows a driver
_BY_CHANCE = 0.05  # How often chance makes one of all drivers seem to be followed
#: Labels that tell one part of the data from another, and nothing of what drives a residual.
PARTS = frozenset({"segment"})


def of_wheel(windows: Windows) -> dict[str, Driver]:
    """Collect the drivers of a wheel's usable samples by name; only what is known somewhere.

    Channels and further columns have their own names; "time", "wheel_angle", and the labels "terrain",
    "run" and "segment" are added.
    """
    samples, rows = windows.samples, windows.rows
    omega = samples.channels.get("angular_velocity")
    backwards = at_rows(omega, rows) < 0.0 if omega is not None else np.zeros(len(rows), dtype=bool)
    found: dict[str, Driver] = {}
    for name, column in {**samples.drivers, **samples.channels}.items():
        # Rates of channels, angles and slopes of the rut are there only where an effect asked for them.
        asked = name not in CHANNELS and sources(name)[0] in CHANNELS
        twice = name in _PLACE and "x" in samples.channels
        scatter = name not in CHANNELS and _SCATTER.search(name)
        if name in _LEFT_OUT or asked or twice or scatter:
            continue
        channel = CHANNELS.get(name)
        if channel is not None and channel.dimension == LABEL:
            continue
        unit = channel.unit.symbol if channel is not None and channel.unit is not None else ""
        values = at_rows(column, rows)
        if name in WITH_COURSE:
            # Torque and pull are counted the way the wheel turns: so is the slope that they follow.
            values = np.where(backwards, -values, values)
        if np.isfinite(values).any():
            found[name] = Driver(name, unit, values)
    stretch = samples.stretch[rows]
    if samples.time is not None:
        time = at_rows(samples.time, rows)
        found["time"] = Driver("time", "s", time)
        if "acceleration" not in found and "velocity" in found:
            slope = rates.rate(time, stretch, found["velocity"].values)
            found["acceleration"] = Driver("acceleration", "m/s²", slope)
        if "angular_velocity" in found:
            angle = rates.wheel_angle(time, stretch, found["angular_velocity"].values)
            found[ANGLE] = Driver(ANGLE, "rad", angle)
    for name, labels in samples.labels.items():
        codes = labels.codes[rows].astype(float)
        found[name] = Driver(name, "", np.where(codes >= 0.0, codes, np.nan), tuple(map(str, labels.names)))
    count = np.diff(windows.bounds)
    segment = np.repeat(np.arange(1.0, len(count) + 1.0), count)
    found["segment"] = Driver("segment", "", segment, tuple(str(j + 1) for j in range(len(count))))
    return found


def beside(
    residual: Array,
    memory: int,
    drivers: Mapping[str, Driver],
    smooth: Mapping[str, Array],
    grousers: int = 0,
) -> Array:
    """Return what is left of a residual without what rises, falls or bends with drivers, by more than chance.

    Nor what swings with the wheel's angle, as with so many `grousers`: at a speed that wanders it has no
    period in time. Drivers are taken one by one, that of the largest share first. Samples are alike for
    `memory`: so many times fewer are independent. Their number times a share that is chance is χ² of two
    degrees of freedom, which goes beyond x with the probability exp(−x/2). Channels in `smooth` stand
    there without their own noise, which is in the residual too. What follows only the clock, the place or
    a label may be soil that varies, and a sinkage is one of what is predicted.
    """
    rows = np.flatnonzero(np.isfinite(residual))
    rows = rows[:: max(1, len(rows) // _TELL)]
    bent: dict[str, Callable[[Index | slice], Array]] = {}
    for name, driver in drivers.items():
        values = smooth.get(name, driver.values)
        known = values[rows][np.isfinite(values[rows])]
        if not driver.labels and name not in _NO_CAUSE and len(known) and np.ptp(known) > 0.0:
            bent[name] = partial(_bent, values, float(np.mean(known)), float(np.std(known)))
    if ANGLE in drivers:
        angle = drivers[ANGLE].values
        turning = shapes.of_turning(ANGLE, [angle], sorted({*shapes.HARMONICS, grousers} - {0}))
        for cosine, sine in zip(turning[::2], turning[1::2], strict=True):
            bent[f"{ANGLE} {cosine.at}"] = partial(_swinging, angle, cosine, sine)
    least = 2.0 * np.log(max(len(bent), 1) / _BY_CHANCE)
    independent = np.isfinite(residual).sum() / max(memory, 1)
    some, taken = residual[rows], [np.ones((len(rows), 1))]
    left, chosen = float(np.var(some)), []
    while bent:
        tables = {name: np.concatenate([*taken, of(rows)], axis=1) for name, of in bent.items()}
        slopes = {name: np.linalg.lstsq(table, some, rcond=None)[0] for name, table in tables.items()}
        sizes = {name: float(np.var(some - table @ slopes[name])) for name, table in tables.items()}
        best = min(sizes, key=lambda name: sizes[name])
        if not (left - sizes[best]) * independent > least * left:
            break
        taken, left, found = [tables[best]], sizes[best], slopes[best]
        chosen.append(bent.pop(best))
    if not chosen:
        return residual
    whole = [np.ones((len(residual), 1)), *(of(slice(None)) for of in chosen)]
    return np.asarray(residual - np.concatenate(whole, axis=1) @ found)


def _bent(values: Array, middle: float, spread: float, rows: Index | slice) -> Array:
    unit = np.nan_to_num((values[rows] - middle) / spread)
    return np.stack([unit, unit**2], axis=1)


def _swinging(angle: Array, cosine: shapes.Shape, sine: shapes.Shape, rows: Index | slice) -> Array:
    return np.nan_to_num(np.stack([cosine(angle[rows]), sine(angle[rows])], axis=1))


def functions_under_all(name: str, wheels: Iterable[Mapping[str, Array]]) -> tuple[str, ...]:
    """Name the drivers of which one is a function (`functions_of`) under every wheel that has it."""
    several = [functions_of(name, values) for values in wheels if name in values]
    return tuple(other for other in several[0] if all(other in one for one in several)) if several else ()


def functions_of(name: str, values: Mapping[str, Array]) -> tuple[str, ...]:
    """Name the drivers that rise or fall wherever another does: what follows it may as well be theirs.

    The values of each are of shape (n,); labels have no place among them.
    """
    own, found = values[name], []
    for other, column in values.items():
        known = np.isfinite(own) & np.isfinite(column)
        if other == name or known.sum() < criteria.NOISE_SAMPLES:
            continue
        ranks = [np.argsort(np.argsort(one[known])).astype(float) for one in (own, column)]
        # Ranks of what does not vary are those of its samples.
        varied = min(float(np.ptp(one[known])) for one in (own, column)) > 0.0
        if varied and abs(float(np.corrcoef(ranks)[0, 1])) >= criteria.SAME_DRIVER:
            found.append(other)
    return tuple(found)
