"""Laws for what no effect of the catalogue explains: a quantity, one driver, and a simple shape.

A draft is a file such as a user writes, units included, and goes the way of every other effect from
there: fitted, held out, judged.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from terrain_cli.comparison import shapes
from terrain_cli.comparison.comparison_outcome import UNITS, Driver
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import driver_range, signatures
from terrain_cli.diagnosis.screening import DRIVEN_BEFORE
from terrain_cli.effects import Effect
from terrain_cli.effects.laws import effect_file, grammar
from terrain_cli.effects.laws.law_names import LONGEST_NAME, is_column
from terrain_cli.errors import TerrainError
from terrain_cli.mechanics.effect import QUANTITIES
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.vocabulary.quantities import listed

SHOWN = tuple(UNITS)  # Quantities that a draft changes: what a channel shows, then what is in the ground
#: What models read from a sensor, of which a draft changes the zero and the gain.
_READ = ("load", "slip")
#: Channels that act on a sensor from outside, as further columns may: heat and age.
_AROUND = frozenset({"motor_temperature", "time"})
SENSED = (*SHOWN, *_READ)
IN_THE_GROUND = ("tan_phi", "cohesion", "stiffness", "shear_modulus")
_NO_CAUSE = frozenset({"torque", "drawbar_pull"})  # Drivers of which no law is made: these are predicted
#: Place and clock stand for something else: a drifting sensor, a tether, a soil that varies.
ALONG = frozenset({"time", "x", "y", "elevation", "longitude", "latitude"})
#: Shapes, the plainest first.
FORMS = ("constant", "linear", "gain", "magnitude", "quadratic", "saturating", "step", "periodic")
ANGLE = "wheel_angle"
_ACCELERATION, _SLOPE = "acceleration", "velocity_rate"
#: How large a law of a quantity may well be: at least this, or this part of what was measured.
_USUAL = {"torque": 0.3, "drawbar_pull": 3.0, "sinkage": 0.002, "load": 3.0, "slip": 0.01}
_PART = 0.1
_OF_SOIL = 0.2  # The same of a property of the soil, as a part of it
_BEND = 0.3  # Part of a driver's range at which a saturating law has most of its effect
_PLACES = 81  # Values of a driver at which a step is tried
#: What a form multiplies by its size, where it has one.
_MULTIPLIED = {
    **dict.fromkeys(("linear", "gain"), "{}"),
    "magnitude": "abs({})",
    "quadratic": "{}^2",
    "saturating": "tanh({} / s)",
}
_HELD = "typical of the drive that the law was drafted from; c and φ are those there"


@dataclass(frozen=True, kw_only=True)
class Draft:
    """A law that may be added."""

    changes: str
    driver: str  # Empty for a constant
    form: str  # One of `FORMS`
    text: str
    effect: Effect
    at: float = 0.0  # Of a step where it is; of a periodic law how often it returns in a turn of the wheel

    def in_words(self, same: Sequence[str] = (), form: str = "") -> str:
        """Say what is off, and what it follows; to these data drivers in `same` are no others."""
        what = self.changes if self.changes in SENSED else f"the soil's {self.changes}"
        if self.form == "gain":
            what, form = f"the gain of {what}", form and "linear"
        if self.form == "periodic" and self.at > 1.0:
            form = f"{self.at:.0f} times in a turn of the wheel"
        if self.of_sensor:
            told = f"{what} is off by a constant{' and a factor' * bool(self.driver)}"
        else:
            several = "; these data cannot tell which" if same else ""
            shape = f" ({form}{several})" if form else ""
            told = f"{what} varies with {listed([self.driver, *same], 'or')}{shape}"
        return told.replace("tan_phi", "tan φ").replace("_", " ")

    @property
    def along(self) -> bool:
        """Whether a soil that varies along the drive does much the same."""
        return self.driver in ALONG and self.changes in SENSED

    @property
    def of_sensor(self) -> bool:
        """Whether it is the zero, or zero and gain, of the sensor of what it changes."""
        return self.driver in ("", self.changes)


def readable(wheel: FittedWheel) -> dict[str, Driver]:
    """Return all drivers by the names that a law reads them by."""
    found = dict(wheel.drivers)
    if _ACCELERATION not in wheel.windows.samples.channels and _ACCELERATION in found:
        # Nothing recorded it: a model reads it as the rate of what was.
        found[_SLOPE] = replace(found.pop(_ACCELERATION), name=_SLOPE)
    return found


def drivers(wheel: FittedWheel) -> dict[str, Array]:
    """Return what a draft may follow: numbers that vary and that a law can read."""
    found = {}
    no_cause = _NO_CAUSE if wheel.one_soil is None else _NO_CAUSE | {DRIVEN_BEFORE}
    for name, driver in readable(wheel).items():
        known = driver.values[np.isfinite(driver.values)]
        varies = len(known) > 0 and float(np.ptp(known)) > 1e-9 * max(float(np.abs(known).max()), 1e-300)
        if not driver.labels and name not in no_cause and varies and grammar.written(name):
            found[name] = driver.values
    return found


def followed(wheel: FittedWheel, channels: Mapping[str, Array], rows: Index) -> list[Array]:
    """Return drivers of some samples, and their squares, of mean 0 and deviation 1 before they are squared.

    `channels` have some of them without their noise.
    """
    columns = []
    for name, values in drivers(wheel).items():
        column = channels.get(name, values[rows])
        known = column[np.isfinite(column)]
        if name == ANGLE or len(known) == 0 or float(np.std(known)) == 0.0:
            continue
        unit = np.nan_to_num((column - float(np.mean(known))) / float(np.std(known)))
        columns += [unit, unit**2]
    return columns


def screen(
    wheel: FittedWheel,
    values: Mapping[str, Array],
    channels: Mapping[str, Array],
    rows: Index,
    steps: Mapping[str, float],
) -> Iterator[tuple[str, dict[tuple[str, str], dict[str, Array]]]]:
    """Yield every quantity with the signatures of its drafts, by driver and form, without writing them.

    What a law Q + a h(driver) leaves in the channels is h times what Q + a leaves: tables by channel, shape
    (n, columns). `values` are the drivers' at the rows, `steps` what `step_of` returns of each.
    """
    shape_of = cache(lambda driver, form, own: _shapes(form, values[driver], steps[driver], own_offset=own))
    on_or_off = {driver for driver, column in values.items() if driver_range.on_or_off(column)}
    shown = [name for name in SHOWN if name in wheel.measured]
    read = [name for name in _READ if name in channels]
    inner = [name for name in IN_THE_GROUND if name in wheel.model.soil]
    for changes in (*shown, *read, *inner):
        offset, gain = f"{changes} + a", f"{changes} * (1 + a)"
        probes = {"gain": ("1", gain)}
        if changes in SENSED:
            probes["offset"] = QUANTITIES[changes], offset
        effects = [
            effect_file.parse(_text(f"probe-{name}", name, changes, law, {"a": (unit, 0.0, 1.0)}, [], {}))
            for name, (unit, law) in probes.items()
        ]
        found = [one.tables for one in signatures.of_effects(wheel, effects, channels, rows)]
        of_gain, of_offset = found[0], found[-1]
        drafts = {("", "constant"): of_offset} if changes in SENSED else {}
        for driver in values:
            for form in forms(changes, driver, on_or_off=driver in on_or_off):
                shape = shape_of(driver, form, changes in SENSED)
                if shape is not None:
                    tables = of_gain if form == "gain" else of_offset
                    drafts[driver, form] = {c: t * shape for c, t in tables.items()}
        yield changes, drafts


def forms(changes: str, driver: str, *, on_or_off: bool) -> Sequence[str]:
    """Name the forms in which a quantity may follow a driver, which may be one that is on or off."""
    around = is_column(driver) or driver in _AROUND
    if changes in _READ or driver == changes:
        # The zero of a sensor moves with its surroundings; what the wheel does, it rather shows.
        return ("linear",) if changes in _READ and (around or driver == changes) else ()
    if driver == ANGLE:
        return ("periodic",) if changes in SHOWN else ()
    if on_or_off:
        return ("step",)
    # Heat or a supply voltage changes the gain of a sensor; what a wheel does, no sensor follows.
    gain = changes in SHOWN and is_column(driver)
    return [form for form in FORMS[1:-1] if gain or form != "gain"]


def _shapes(form: str, column: Array, at: float, *, own_offset: bool) -> Array | None:  # noqa: PLR0911 - one a form
    """Return the columns of a shape: with a constant where the law has an offset of its own."""
    low, high = driver_range.limits(column)
    one = np.ones_like(column)
    size = driver_range.size(column)
    if form == "periodic":
        return np.stack([np.sin(at * column), np.cos(at * column)], axis=1)
    if form in ("linear", "gain"):
        return np.stack([column / size, one], axis=1) if own_offset else (column / size)[:, None]
    if form == "magnitude":
        return (np.abs(column) / size)[:, None] if low < 0.0 < high else None
    if form == "quadratic" and own_offset and driver_range.far_from_zero(column):
        _, middle, _, spread = driver_range.ends(column)
        away = (column - middle) / spread
        return np.stack([away**2, away, one], axis=1)
    if form == "quadratic":
        return ((column / size) ** 2)[:, None]
    if form == "saturating":
        if len(np.unique(column[np.isfinite(column)][:5000])) < 4:
            return None
        return np.tanh(column / (_BEND * size))[:, None]
    if form == "step":
        return np.where(column > at, 1.0, 0.0)[:, None] if high > low else None
    return one[:, None]


def usual(changes: str, measured: Array) -> float:
    """Return how large a law may well be.

    In the quantity's SI unit; of a property of the soil as a part of it. `measured` may have any length.
    """
    if changes not in SENSED:
        return _OF_SOIL
    known = measured[np.isfinite(measured)]
    size = float(np.sqrt(np.mean(known**2))) if len(known) else 0.0
    return max(_USUAL[changes], _PART * size)


def step_of(wheel: FittedWheel, driver: str, rows: Index) -> float:
    """Return above which value of a driver the residuals of some samples differ most from the others.

    Of the wheel's angle, how often in a turn they return most.
    """
    column = readable(wheel)[driver].values[rows]
    residuals = np.nan_to_num([own[rows] - np.nanmean(own[rows]) for own in wheel.residuals.values()])
    residuals /= np.maximum(np.sqrt((residuals**2).sum(axis=1, keepdims=True)), 1e-150)
    if driver == ANGLE:
        returns = [round(2.0 * np.pi / (one.at or np.inf)) for one in shapes.of_turning(driver, [column])]

        def swing(count: int) -> float:
            return float((np.abs(residuals @ np.nan_to_num(np.exp(1j * count * column))) ** 2).sum())

        return float(max(returns, key=swing, default=1))
    levels = np.unique(column[np.isfinite(column)])
    if len(levels) <= _PLACES:
        places = 0.5 * (levels[1:] + levels[:-1])
    else:
        places = np.nanquantile(column, np.linspace(0.1, 0.9, _PLACES))
    if driver == "time":
        found = shapes.of_stretches(driver, column, wheel.segment[rows])
        places = np.append(places, [one.at for one in found if one.name == "step"])

    if len(places) == 0:
        return 0.0
    above = (column[:, None] > places).astype(float)
    share = above.mean(axis=0)
    taken = ((residuals @ above) ** 2).sum(axis=0) / np.maximum(share * (1.0 - share), 1e-12)
    return float(places[np.argmax(taken)])


def write(  # noqa: C901, PLR0912, PLR0915 - one branch for each form
    changes: str,
    driver: str,
    form: str,
    column: Array | None,
    unit: str = "",
    *,
    usual: float,
    step: float = 0.0,
) -> Draft | None:
    """Write a draft of some size; None where the units of the driver do not allow the form.

    `step` is what `step_of` returns.
    """
    shown = changes in SENSED
    own = QUANTITIES[changes] if shown and form != "gain" else "1"
    usual = _PART if form == "gain" else usual
    of = _unit(driver, unit)
    divisor = of if of.isalpha() else f"({of})"
    per = own if of in ("", "1") else f"{own}/{divisor}"
    size = 1.0
    if column is not None:
        size = driver_range.size(column)
    read = grammar.written(driver)
    parameters: dict[str, tuple[Any, ...]] = {}  # Unit, null, scale, and what keys there are besides
    factor = _MULTIPLIED.get(form, "")
    term = f"a * {factor.format(read)}"
    if form == "constant":
        term, parameters["a"] = "a", (own, 0.0, usual)
    elif form in ("linear", "gain"):
        parameters["a"] = (per, 0.0, usual / size)
        if shown and column is not None:
            # Of what is never near 0 the slope and the offset are large, and nearly cancel.
            slope = usual / driver_range.spread(column)
            parameters["a"] = (per, 0.0, slope)
            term, parameters["b"] = f"{term} + b", (own, 0.0, max(usual, slope * size))
    elif form == "periodic":
        turned = f"{step:.0f} * {read}" if step > 1.0 else read
        term = f"a * sin({turned}) + b * cos({turned})"
        parameters["a"] = parameters["b"] = (own, 0.0, usual)
    elif form == "magnitude":
        parameters["a"] = (per, 0.0, usual / size)
    elif form == "quadratic":
        squared = own if of in ("", "1") else f"{own}/{divisor}/{divisor}"
        parameters["a"] = (squared, 0.0, usual / size**2)
        if shown and column is not None and driver_range.far_from_zero(column):
            low, middle, high, spread = driver_range.ends(column)
            term = f"a * ({read} - middle)^2 + b"
            parameters["a"] = (squared, 0.0, usual / spread**2)
            parameters["middle"] = (of or "1", middle, spread, {"lower": low, "upper": high})
            parameters["b"] = (own, 0.0, usual)
    elif form == "saturating":
        parameters["a"] = (own, 0.0, usual)
        parameters["s"] = (of or "1", driver_range.rounded(_BEND * size), _BEND * size)
    else:
        term = f"a * where({read} > at, 1, 0)"
        parameters["a"] = (own, 0.0, usual)
        parameters["at"] = (of or "1", float(f"{step:.6g}") or 1e-12, 0.01 * size)
    if factor and not shown and column is not None and (typical := driver_range.typical(column)):
        # The soil where the driver is 0 would be an extrapolation, of which no sample tells.
        term = f"a * ({factor.format(read)} - {factor.format('typical')})"
        parameters["typical"] = (of or "1", typical, driver_range.spread(column), {"held": _HELD})
    law = f"{changes} + {term}" if shown and form != "gain" else f"{changes} * (1 + {term})"
    name = _id(changes, driver, form)
    what = changes.replace("_", " ").capitalize()
    does = f"varies with {driver} ({form}; empirical)" if driver else "is off by a constant (empirical)"
    columns = {driver: unit} if unit and is_column(driver) else {}
    needs = [driver] if driver else []
    text = _text(name, f"{what} {does}", changes, law, parameters, needs, columns)
    try:
        effect = effect_file.parse(text)
    except TerrainError:
        return None
    if form == "step":
        # A threshold has no slope: it stays where it was found.
        effect = replace(
            effect, parameters=tuple(replace(p, shape=p.name == "at" or p.shape) for p in effect.parameters)
        )
    return Draft(changes=changes, driver=driver, form=form, text=text, effect=effect, at=step)


def _id(changes: str, driver: str, form: str) -> str:
    """Name a draft; of a long driver no more than there is room for."""
    room = LONGEST_NAME - len(f"{changes}-with--{form}")
    follows = f"with-{driver[:room]}" if driver else "offset"
    return re.sub(r"[^a-z0-9]+", "-", f"{changes}-{follows}-{form}".lower()).strip("-")


def _unit(driver: str, unit: str) -> str:
    channel = CHANNELS.get(driver)
    if channel is not None and channel.unit is not None:
        return channel.unit.symbol
    return unit


def _text(
    name: str,
    title: str,
    changes: str,
    law: str,
    parameters: Mapping[str, tuple[Any, ...]],
    needs: Sequence[str],
    columns: Mapping[str, str],
) -> str:
    told = {"id": name, "title": title, "changes": changes, "law": law, "needs": needs}
    lines = toml_files.lines({**told, "reference": "empirical: drafted from the data, no physics behind it"})
    if columns:
        lines += ["[columns]", *toml_files.lines(columns)]
    for parameter, (unit, null, scale, *more) in parameters.items():
        own = {"unit": unit, "null": null, "scale": driver_range.rounded(scale)}
        lines += [f"[parameters.{parameter}]", *toml_files.lines(own), *toml_files.lines(dict(*more))]
    return "\n".join(lines) + "\n"
