"""Telemetry: from files to the samples of each wheel, on the clock of its torque, in SI units."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import formats
from terrain_cli import units
from terrain_cli.channels import CHANNELS, stated_unit
from terrain_cli.errors import ConfigurationError, InputError, nearest
from terrain_cli.telemetry import advice, align, complete, derive, health, needs
from terrain_cli.telemetry.columns import as_numbers
from terrain_cli.telemetry.feeds import Plan
from terrain_cli.telemetry.mapping import is_table, plan
from terrain_cli.telemetry.names import match_name
from terrain_cli.telemetry.reading import read_raw
from terrain_cli.telemetry.samples import NEEDED, Geometry, Raw, Samples
from terrain_cli.telemetry.where import Condition

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from formats import Source
    from terrain_cli.effects import Effect
    from terrain_cli.rover import Rover, Wheel

    Array = NDArray[np.float64]

__all__ = [
    "Condition",
    "Geometry",
    "Plan",
    "Samples",
    "assemble",
    "lacking",
    "plan",
    "read",
    "read_source",
    "wheel_of",
]


def read(
    path: str,
    rover: Rover,
    *,
    wheels: Collection[str] = (),
    where: Condition | None = None,
    effects: Sequence[Effect] | None = None,
    compared: bool = False,
) -> list[Samples]:
    """Read the samples of every wheel of a log.

    Parameters
    ----------
    path : str
        A file, a folder that is one log, or "-".
    rover : Rover
    wheels : collection of str
        Only these; all if empty.
    where : Condition, optional
        Keeps the samples that satisfy it.
    effects : sequence of Effect, optional
        For the whole model instead of the line: its effects, whose channels are read too. So is the
        drawbar pull, where it is there.
    compared : bool
        For a comparison with a model: torque may be absent, and every channel and further numeric
        column is read, as something that the residuals may follow.

    Returns
    -------
    list of Samples
        Ordered by the name of the wheel.

    Raises
    ------
    formats.errors.FormatError
        The file cannot be read.
    InputError
        It does not hold what is needed.
    ConfigurationError
        rover.toml does not fit it, or lacks the geometry of a wheel.
    """
    return read_source(
        formats.open_source(path), rover, wheels=wheels, where=where, effects=effects, compared=compared
    )


def read_source(
    source: Source,
    rover: Rover,
    *,
    wheels: Collection[str] = (),
    where: Condition | None = None,
    effects: Sequence[Effect] | None = None,
    compared: bool = False,
) -> list[Samples]:
    """Read the samples of every wheel of an opened source.

    Parameters
    ----------
    source : Source
    rover : Rover
    wheels : collection of str
    where : Condition, optional
    effects : sequence of Effect, optional
    compared : bool

    Returns
    -------
    list of Samples

    Raises
    ------
    formats.errors.FormatError, InputError, ConfigurationError
        As for `read`.
    """
    layout = plan(source, rover)
    extras, names = _condition_columns(layout, where) if where else ([], set())
    wanted = {*complete.SOURCES, *names}
    if effects is not None:
        channels, columns = needs.read(effects)
        wanted |= {"drawbar_pull", *channels}
        extras = sorted({*extras, *columns.intersection(layout.extras)})
    if compared:
        wanted |= CHANNELS.keys()
        extras = sorted({*extras, *layout.extras})
    raws = read_raw(layout, rover, wanted, extras, wheels=wheels)
    lacks = {raw.wheel: lacking(raw, rover) for raw in raws}
    if compared:
        lacks = {wheel: [lack for lack in some if lack.what != "torque"] for wheel, some in lacks.items()}
    if any(lacks.values()):
        raise _cannot_give(layout, lacks, rover)
    lacks = {raw.wheel: needs.lacking(raw, wheel_of(raw, rover), effects or ()) for raw in raws}
    if any(lacks.values()):
        raise _model_cannot_be_fitted(layout, lacks, rover)
    result = []
    while raws:
        result.append(assemble(source, raws.pop(0), rover, where, effects or (), layout.extras))
    if not any(len(samples) for samples in result):
        raise InputError(f"{source.path}: there are no samples" + (f" where {where.text}" if where else ""))
    return result


def _condition_columns(layout: Plan, where: Condition) -> tuple[list[str], set[str]]:
    """Split what a condition reads into columns of the file and channels."""
    headers = {f.name for f in layout.source.streams()[0].fields} if is_table(layout.source) else set[str]()
    columns = where.names & headers
    fed = {channel for feeds in (layout.shared, *layout.wheels.values()) for channel in feeds}
    known = fed.union(NEEDED, () if is_table(layout.source) else ("time",))
    for name in sorted(where.names - headers - known):
        raise InputError(
            f"{layout.source.path}: --where: there is no column {name}{nearest(name, headers | known)}",
            hint=f"there are {', '.join(sorted(headers | known))}",
        )
    return sorted(columns), where.names - columns


def wheel_of(raw: Raw, rover: Rover) -> Wheel:
    """Return what rover.toml says of the wheel of some samples.

    Parameters
    ----------
    raw : Raw
    rover : Rover

    Returns
    -------
    Wheel

    Raises
    ------
    ConfigurationError
        rover.toml names its wheels, and this is none of them.
    """
    return rover.wheel(match_name(raw.wheel, rover.wheels) or raw.wheel)


def lacking(raw: Raw, rover: Rover) -> list[complete.Lack]:
    """Say what is missing for an estimate under one wheel.

    Parameters
    ----------
    raw : Raw
    rover : Rover

    Returns
    -------
    list of Lack
        Channels, then what rover.toml does not say.

    Raises
    ------
    ConfigurationError
        rover.toml names its wheels, and this is none of them.
    """
    wheel = wheel_of(raw, rover)
    return complete.routes(raw.channels, wheel, rover)[1] + complete.settings(wheel, rover)


def _cannot_give(
    layout: Plan, lacks: dict[str, list[complete.Lack]], rover: Rover
) -> InputError | ConfigurationError:
    """Say all that is missing, and the lines of rover.toml that would supply it."""
    reasons: dict[str, list[str]] = {}
    for wheel, missing in lacks.items():
        for reason in advice.reasons(layout, wheel, [lack for lack in missing if lack.what in NEEDED]):
            reasons.setdefault(reason, []).append(wheel)
    lines = advice.lines(layout, lacks)
    if not reasons:
        first = f"{rover.path} does not give" if rover.path else "there is no rover.toml to give"
        what = " and ".join(dict.fromkeys(lack.because for missing in lacks.values() for lack in missing))
        add = f"add to {rover.path}:" if rover.path else "write it beside the input, or name it with --rover:"
        return ConfigurationError(f"{first} {what}", hint=f"{add}\n{lines}")
    parts = [
        text if len(wheels) == len(lacks) else f"wheel {', '.join(wheels)}: {text}"
        for text, wheels in reasons.items()
    ]
    return InputError(
        f"{layout.source.path}: c and φ cannot be estimated: {'; '.join(parts)}",
        hint=f"add to {rover.label} (terrain-est inspect shows what there is):\n{lines}",
    )


def _model_cannot_be_fitted(
    layout: Plan, lacks: dict[str, list[complete.Lack]], rover: Rover
) -> InputError | ConfigurationError:
    """Say which effect needs what, and how to supply it."""
    missing = [lack for several in lacks.values() for lack in several]
    text = "; ".join(dict.fromkeys(lack.because for lack in missing))
    if all(lack.lines for lack in missing):
        return ConfigurationError(
            f"{rover.label}: {text}", hint=f"add to {rover.label}:\n{advice.lines(layout, lacks)}"
        )
    hints = []
    if any(lack.ask or lack.lines for lack in missing):
        hints.append(f"add to {rover.label}:\n{advice.lines(layout, lacks)}")
    columns = dict.fromkeys(lack.what for lack in missing if not (lack.ask or lack.lines))
    if columns:
        there = f"; this one has {', '.join(layout.extras)}" if layout.extras else ""
        hints.append(
            f"{', '.join(columns)}: no channel, but a numeric column that a table (CSV, Parquet) has{there}"
        )
    return InputError(f"{layout.source.path}: {text}", hint="\n".join(hints))


def assemble(
    source: Source,
    raw: Raw,
    rover: Rover,
    where: Condition | None = None,
    effects: Sequence[Effect] = (),
    columns: Collection[str] = (),
) -> Samples:
    """Derive what was not recorded, and judge every sample of a wheel.

    Parameters
    ----------
    source : Source
    raw : Raw
        Consumed: its channels become those of the result. Nothing may be `lacking`.
    rover : Rover
    where : Condition, optional
    effects : sequence of Effect, optional
        As for `read`; samples without something that an effect needs are set aside.
    columns : collection of str
        Further numeric columns that are kept, where they were read.

    Returns
    -------
    Samples

    Raises
    ------
    InputError
        Its times are not in seconds.
    """
    wheel = wheel_of(raw, rover)
    radius, width = rover.geometry(wheel)
    geometry = Geometry(
        radius,
        width,
        rover.soil_shear_modulus(),
        wheel.grouser_height,
        wheel.grouser_count,
        rover.vehicle.gravity if rover.vehicle else units.STANDARD_GRAVITY,
    )
    _check_clock(source, raw, radius)
    origins = complete.complete(raw, wheel, rover)
    if where is not None:
        _keep(raw, where)
    reasons, restarts = health.set_aside(raw.channels, raw.time, radius)
    gap = align.stretch_gap(raw.time, rover.max_gap) if raw.time is not None else 0.0
    stretch = health.stretches(
        raw.time,
        reasons,
        runs=raw.labels.get("run") if raw.time is not None else None,
        restarts=restarts,
        max_gap=gap,
    )
    drivers = needs.drivers(raw, np.flatnonzero(reasons.codes < 0), stretch, effects)
    for name, values in drivers.items():
        reasons = health.also_aside(reasons, f"no {name}", ~np.isfinite(values))
    further = {name: as_numbers(column) for name, column in raw.extras.items() if name in columns}
    return Samples(
        source.path,
        raw.wheel,
        geometry,
        raw.origin,
        raw.time,
        raw.channels,
        raw.labels,
        stretch,
        _distance(raw, radius, gap),
        reasons,
        origins,
        [*source.remarks, *raw.remarks, *health.doubts(raw.channels, reasons)],
        {**further, **drivers},
        rover.noise,
    )


def _check_clock(source: Source, raw: Raw, radius: float) -> None:
    feed = raw.feeds.get("time")
    if feed is None or feed.asked or raw.time is None:
        return
    speed = raw.channels.get("velocity")
    if speed is None and "angular_velocity" in raw.channels:
        speed = radius * raw.channels["angular_velocity"]
    header = feed.fields[0]
    align.check_unit_of_time(
        source.path,
        header,
        raw.time + raw.origin,
        speed=speed,
        radius=radius,
        stated=stated_unit(header, "time") is not None,
    )


def _keep(raw: Raw, where: Condition) -> None:
    """Drop the samples that do not satisfy the condition: as if they had never been recorded."""
    known = {**raw.channels, **raw.labels, **raw.extras}
    if raw.time is not None:
        known.setdefault("time", raw.time + raw.origin)
    nothing = np.full(len(raw), np.nan)
    raw.select(where.holds({name: known.get(name, nothing) for name in where.names}))


def _distance(raw: Raw, radius: float, max_gap: float) -> Array | None:
    """Return the metres driven: from the velocity, else from wheel speed and slip, else from the track."""
    channels = raw.channels
    if raw.time is None:
        return None
    velocity = channels.get("velocity")
    if velocity is None and "angular_velocity" in channels:
        slip = channels["slip"]
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            share = np.where(slip < 0.0, 1.0 / (1.0 + slip), 1.0 - slip)
            velocity = share * radius * channels["angular_velocity"]
    if velocity is not None:
        return derive.distance_from_velocity(raw.time, velocity, max_gap=max_gap)
    if {"x", "y"} <= channels.keys():
        return derive.distance_from_track(channels["x"], channels["y"])
    return None
