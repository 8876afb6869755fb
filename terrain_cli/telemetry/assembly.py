"""From the channels of a wheel to its samples: what is missing, what is derived, what is judged."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from formats import Source
from formats.recovery import Notice
from terrain_cli.effects import Effect
from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.rover import Rover, SensorNoise, Wheel
from terrain_cli.telemetry import (
    alignment,
    derived_channels,
    effect_inputs,
    plausibility,
    rover_advice,
    usable_samples,
)
from terrain_cli.telemetry.raw_columns import as_numbers
from terrain_cli.telemetry.unit_doubts import UnitEvidence
from terrain_cli.telemetry.usable_samples import Condition
from terrain_cli.telemetry.wheel_samples import NEEDED, Feed, Geometry, Plan, Raw, Samples, match_name
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.channels import CHANNELS, stated_unit
from terrain_cli.vocabulary.quantities import PREDICTED, the_wheel


@dataclass(frozen=True, kw_only=True)
class Request:
    layout: Plan
    rover: Rover
    channels: frozenset[str] = frozenset(CHANNELS)
    extras: tuple[str, ...] = ()
    wheels: Collection[str] = ()  # Only these; all if empty
    where: Condition | None = None
    effects: Sequence[Effect] | None = None
    beside: Sequence[Effect] = ()  # Which need not be there
    compared: bool = False  # With a model, which predicts what is there

    def feeds(self, wheel: str) -> dict[str, Feed]:
        """Return what gives the channels of a wheel that are asked for."""
        feeds = self.layout.feeds(match_name(wheel, self.layout.wheels) or wheel)
        return {channel: feed for channel, feed in feeds.items() if channel in self.channels}


def wheel_of(raw: Raw, rover: Rover) -> Wheel:
    """Return what rover.toml says of the wheel of some samples."""
    return rover.wheel(match_name(raw.wheel, rover.wheels) or raw.wheel)


def lacking(raw: Raw, rover: Rover) -> list[rover_advice.Lack]:
    """Say what is missing for an estimate under one wheel: channels, then what rover.toml does not say."""
    wheel = wheel_of(raw, rover)
    return rover_advice.routes(raw.channels, wheel, rover)[1] + rover_advice.settings(wheel, rover)


def _cannot_give(
    layout: Plan, lacks: dict[str, list[rover_advice.Lack]], rover: Rover, *, compared: bool
) -> InputError | ConfigurationError:
    """Say all that is missing, and the lines of rover.toml that would supply it."""
    reasons: dict[str, list[str]] = {}
    for wheel, missing in lacks.items():
        for reason in rover_advice.reasons(layout, wheel, [lack for lack in missing if lack.what in NEEDED]):
            reasons.setdefault(reason, []).append(wheel)
    lines = rover_advice.lines(layout, lacks)
    if rover.path is None:
        lines += "\n# terrain-est init drafts this file from the log"
    if not reasons:
        first = f"{rover.path} does not give" if rover.path else "there is no rover.toml to give"
        what = " and ".join(dict.fromkeys(lack.because for missing in lacks.values() for lack in missing))
        add = f"add to {rover.path}:" if rover.path else "write it beside the input, or name it with --rover:"
        return ConfigurationError(f"{first} {what}", hint=f"{add}\n{lines}")
    parts = [
        text if len(wheels) == len(lacks) else f"wheel {', '.join(wheels)}: {text}"
        for text, wheels in reasons.items()
    ]
    hint = f"add to {rover.label} (terrain-est inspect shows what there is):\n{lines}"
    what = "a model cannot be compared with it" if compared else "c and φ cannot be estimated"
    return InputError(f"{layout.source.path}: {what}: {'; '.join(parts)}", hint=hint)


def _model_cannot_be_fitted(
    layout: Plan, lacks: dict[str, list[rover_advice.Lack]], rover: Rover
) -> InputError | ConfigurationError:
    """Say which effect needs what, and how to supply it."""
    missing = [lack for several in lacks.values() for lack in several]
    text = "; ".join(dict.fromkeys(lack.because for lack in missing))
    if all(lack.lines for lack in missing):
        hint = f"add to {rover.label}:\n{rover_advice.lines(layout, lacks)}"
        return ConfigurationError(f"{rover.label}: {text}", hint=hint)
    hints = []
    if any(lack.ask or lack.lines for lack in missing):
        hints.append(f"add to {rover.label}:\n{rover_advice.lines(layout, lacks)}")
    columns = dict.fromkeys(lack.what for lack in missing if not (lack.ask or lack.lines))
    if columns:
        there = f"; this one has {', '.join(layout.extras)}" if layout.extras else ""
        what = "no channel, but a numeric column that a table (CSV, Parquet) has"
        hints.append(f"{', '.join(columns)}: {what}{there}")
    return InputError(f"{layout.source.path}: {text}", hint="\n".join(hints))


def check(request: Request, raws: Sequence[Raw]) -> None:
    """Refuse wheels of which something is missing."""
    layout, rover, effects = request.layout, request.rover, request.effects or ()
    lacks = {raw.wheel: lacking(raw, rover) for raw in raws}
    if request.compared:
        # A model predicts what is there: any one of these will do.
        for raw in raws:
            if raw.channels.keys().isdisjoint(PREDICTED):
                continue
            absent = [lack for lack in lacks[raw.wheel] if lack.what in PREDICTED]
            lacks[raw.wheel] = [lack for lack in lacks[raw.wheel] if lack not in absent]
            raw.remarks += map(Notice, rover_advice.not_compared(layout, raw.wheel, absent))
    if any(lacks.values()):
        raise _cannot_give(layout, lacks, rover, compared=request.compared)
    lacks = {raw.wheel: effect_inputs.lacking(raw, wheel_of(raw, rover), effects) for raw in raws}
    if any(lacks.values()):
        raise _model_cannot_be_fitted(layout, lacks, rover)


def assemble(
    request: Request, raw: Raw, columns: Collection[str] = (), *, checked: bool = False, judged: bool = True
) -> Samples:
    """Derive what was not recorded, and judge every sample of a wheel; its raw channels are consumed."""
    # `columns` are further ones that are kept; `checked` says that it is a later part of a log, whose units
    # were looked at, and without `judged` they are only so far as a clock goes.
    source, rover, where, effects = request.layout.source, request.rover, request.where, request.effects
    wheel = wheel_of(raw, rover)
    # Without these `check` has refused it.
    radius, width = cast("tuple[float, float]", (wheel.radius, wheel.width))
    k, factor = rover.soil_shear_modulus(), rover.shear_modulus_factor
    grousers = wheel.grouser_height, wheel.grouser_count
    gravity = rover.vehicle.gravity if rover.vehicle else units.STANDARD_GRAVITY
    errors = wheel.radius_error, wheel.width_error
    geometry = Geometry(radius, width, k, *grousers, gravity, factor, *errors)
    if not checked:
        _check_clock(source, raw, radius)
    noise, remarks = dict(rover.noise), list(source.remarks)
    stated = noise.get("torque", SensorNoise(known=False))
    if "torque" not in raw.channels and "motor_current" in raw.channels and not stated.gain:
        noise["torque"] = replace(stated, gain=derived_channels.CURRENT_GAIN)
        remarks.append(
            f"{the_wheel(raw.wheel)}: torque from a current: errors allow for a gain that is off by "
            f"{derived_channels.CURRENT_GAIN:.0%}; torque = {{ gain = … }} in [noise] states another"
        )
    origins = rover_advice.complete(raw, wheel, rover)
    if where is not None:
        # The other samples are as if they had never been recorded.
        known = {**raw.channels, **raw.labels, **raw.extras}
        if raw.time is not None:
            known.setdefault("time", raw.time + raw.origin)
        nothing = np.full(len(raw), np.nan)
        raw.select(where.holds({name: known.get(name, nothing) for name in where.names}))
    skids = effects is not None
    reasons, restarts = usable_samples.set_aside(raw.channels, raw.time, radius, width, skids=skids)
    gap = usable_samples.longest_gap(raw.time, reasons, rover.max_gap) if raw.time is not None else 0.0
    runs = raw.labels.get("run") if raw.time is not None else None
    stretch = usable_samples.stretches(raw.time, reasons, runs=runs, restarts=restarts, max_gap=gap)
    drivers = effect_inputs.drivers(raw, geometry, np.flatnonzero(reasons.codes < 0), stretch, effects or ())
    for name, values in drivers.items():
        reasons = usable_samples.also_aside(reasons, f"no {name}", ~np.isfinite(values))
    further = {name: as_numbers(column) for name, column in raw.extras.items() if name in columns}
    samples = Samples(
        source=source.path,
        wheel=raw.wheel,
        geometry=geometry,
        origin=raw.origin,
        time=raw.time,
        channels=raw.channels,
        labels=raw.labels,
        stretch=stretch,
        distance=_distance(raw, gap),
        set_aside=reasons,
        origins=origins,
        remarks=[*remarks, *raw.remarks],
        drivers={**further, **drivers},
        noise=noise,
    )
    if back := usable_samples.unsorted(reasons):
        told = f"time runs backwards in {back} of {len(samples)} samples: sort the rows by time"
        samples.remarks.append(Notice(f"{the_wheel(raw.wheel)}: {told}"))
    if judged and not checked:
        evidence = UnitEvidence(geometry, raw.feeds)
        evidence.add(samples)
        samples.remarks += plausibility.found(request.layout, raw.wheel, evidence)
    return samples


def _check_clock(source: Source, raw: Raw, radius: float) -> None:
    feed = raw.feeds.get("time")
    if feed is None or feed.asked or raw.time is None:
        return
    speed = raw.channels.get("velocity")
    if speed is None and "angular_velocity" in raw.channels:
        speed = radius * raw.channels["angular_velocity"]
    if speed is not None and {"x", "y"} <= raw.channels.keys():
        driven = derived_channels.distance_from_velocity(raw.time, speed)[-1:]
        track = derived_channels.distance_from_track(raw.channels["x"], raw.channels["y"])[-1:]
        # Time and velocity make the length of the track, however far apart the samples are.
        speed = None if (driven < plausibility.MOST_DISTANCE * track).all() else speed
    header = feed.fields[0]
    stated = feed.unit is not CHANNELS["time"].unit or stated_unit(header, "time") is not None
    time = raw.time + raw.origin
    alignment.check_unit_of_time(source.path, header, time, speed=speed, radius=radius, stated=stated)


def _distance(raw: Raw, max_gap: float) -> Array | None:
    """Return the metres driven: from the velocity, else from the track."""
    channels = raw.channels
    if raw.time is None:
        return None
    if "velocity" in channels:
        return derived_channels.distance_from_velocity(raw.time, channels["velocity"], max_gap=max_gap)
    if {"x", "y"} <= channels.keys():
        return derived_channels.distance_from_track(channels["x"], channels["y"])
    return None
