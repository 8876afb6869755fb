"""From a drive to what is measured of it, and the truth behind that."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from simulator import sensing
from simulator.effects import forces_with, freeze
from simulator.noise import Clock, Sensor, generator

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from simulator.drive import Drive, Track
    from simulator.effects import Frozen
    from simulator.profiles import Profile
    from simulator.soils import Soil

    Array = NDArray[np.float64]
    Columns = dict[str, NDArray[Any]]
    At = Callable[[Array], dict[str, Array]]

#: channel → the topic whose clock it shares. Those of `BODY` are measured once for all wheels.
CLOCK_OF = {
    "torque": "joints",
    "angular_velocity": "joints",
    "slip": "joints",
    "motor_temperature": "joints",
    "pass_number": "joints",
    "load": "load",
    "drawbar_pull": "load",
    "sinkage": "sinkage",
    "velocity": "odometry",
    "x": "odometry",
    "y": "odometry",
    "slip_angle": "odometry",
    "pitch": "imu",
    "yaw_rate": "imu",
    "acceleration": "imu",
    "longitude": "fix",
    "latitude": "fix",
}
BODY = frozenset(
    {"velocity", "x", "y", "longitude", "latitude", "slip_angle", "pitch", "yaw_rate", "acceleration"}
)
#: Mean radius of the Earth in m, for fixes about `Drive.origin`.
EARTH = 6_371_008.8


@dataclass(frozen=True, slots=True)
class Series:
    """A measured channel: times in s on the drive's clock, and values in SI units."""

    time: Array
    values: Array


@dataclass(frozen=True, slots=True)
class Stretch:
    """One soil under one wheel, from start to end in s on the drive's clock."""

    soil: Soil
    start: float
    end: float


@dataclass(frozen=True, slots=True)
class WheelLog:
    """One wheel's measurements and the truth behind them.

    Parameters
    ----------
    name : str
    measured : dict of str to Series
    truth : dict of str to ndarray
        At the times of the torque samples ("time"): every channel as it truly is, which effects on
        sensors do not show, "drawbar_pull", "slip" (NaN when standing), "flat_load" in N, before
        slope and load transfer, "cohesion" in Pa, "tan_phi" and "soil", the index into `stretches`.
    stretches : tuple of Stretch
    """

    name: str
    measured: dict[str, Series]
    truth: dict[str, Array]
    stretches: tuple[Stretch, ...]

    @property
    def boundaries(self) -> tuple[float, ...]:
        """Times in s at which the soil changes."""
        return tuple(stretch.start for stretch in self.stretches[1:])

    def strength(self, stress: float) -> Array:
        """Return the true shear strength in Pa under a normal stress in Pa, sample by sample."""
        return self.truth["cohesion"] + stress * self.truth["tan_phi"]

    def aligned(self) -> dict[str, Array]:
        """Return the measured channels at the times of the torque samples, NaN where one was lost.

        Raises
        ------
        ValueError
            A channel was sampled at other times.
        """
        time = self.measured["torque"].time
        columns = {"time": time}
        for channel, series in self.measured.items():
            common = np.isin(time, series.time)
            if not common.any():
                raise ValueError(f"{channel} was not sampled with the torque")
            columns[channel] = np.full(len(time), np.nan)
            columns[channel][common] = series.values[np.isin(series.time, time)]
        return columns


@dataclass(frozen=True, slots=True)
class Run:
    """A drive and what was measured of it, wheel by wheel."""

    drive: Drive
    wheels: dict[str, WheelLog]

    def columns(self, *, terrain: bool = False) -> Columns:
        """Return one table: a row per wheel and time at which any of its channels was measured.

        Parameters
        ----------
        terrain : bool
            Add the name of the true soil.

        Returns
        -------
        dict of str to ndarray, shape (n,)
            By time, then by wheel; NaN where a channel was not measured then.
        """
        parts = [_wheel_columns(log, terrain=terrain) for log in self.wheels.values()]
        table = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        order = np.argsort(table["time"], kind="stable")
        return {name: column[order] for name, column in table.items()}


def simulate(drive: Drive) -> Run:
    """Drive, and measure; the same drive always gives the same numbers."""
    channels = (*drive.channels, *drive.further, *(("longitude", "latitude") if drive.origin else ()))
    logs = {}
    for track in drive.tracks:
        measured = {}
        shown = _remembered(partial(_shown, drive, track))
        for channel in channels:
            measured[channel] = _measure(drive, track, channel, shown)
        time = measured["torque"].time
        truth = _state(drive, track, np.round(time - drive.start, 6))
        ends = drive.start + np.cumsum([0.0, *(seconds for _, seconds in track.soils)])
        stretches = tuple(
            Stretch(soil, float(start), float(end))
            for (soil, _), start, end in zip(track.soils, ends[:-1], ends[1:], strict=True)
        )
        logs[track.name] = WheelLog(track.name, measured, {"time": time, **truth}, stretches)
    return Run(drive, logs)


def _wheel_columns(log: WheelLog, *, terrain: bool) -> Columns:
    time = np.unique(np.concatenate([series.time for series in log.measured.values()]))
    table: Columns = {"time": time, "wheel": np.full(len(time), log.name, dtype=object)}
    for channel, series in log.measured.items():
        table[channel] = np.full(len(time), np.nan)
        table[channel][np.searchsorted(time, series.time)] = series.values
    if terrain:
        names = np.array([stretch.soil.name for stretch in log.stretches], dtype=object)
        table["terrain"] = names[np.searchsorted(log.boundaries, time, side="right")]
    return table


def _measure(drive: Drive, track: Track, channel: str, shown_at: At) -> Series:
    topic = CLOCK_OF.get(channel, "joints")
    own = f"{track.name}/{topic}"
    clock = drive.clocks.get(own) or drive.clocks.get(topic) or Clock(drive.rate)
    shared = topic in {"joints", "odometry", "imu", "fix"}
    time = clock.times(drive.duration, generator(drive.seed, f"clock {topic if shared else own}"))
    key = f"{track.name}/{channel}"
    sensor = drive.sensors.get(key) or drive.sensors.get(channel) or Sensor()
    shown = shown_at(np.maximum(time - sensor.lag, 0.0))[channel]
    values = sensor.measure(time, shown, generator(drive.seed, channel if channel in BODY else key))
    return Series(np.round(drive.start + time, 6), values)


def _shown(drive: Drive, track: Track, time: Array) -> dict[str, Array]:
    """Return what perfect sensors show, at times in s since the start."""
    if not drive.effects and not drive.laws:
        return _state(drive, track, time)
    effects = freeze(drive.effects)

    def omega(moved: Array) -> Array:
        return sensing.angular_velocity(effects, drive.wheel, drive.speed(moved), track.slip(moved))

    at = _remembered(partial(_state, drive, track))
    channels = sensing.shown(effects, time, at, omega, drive.wheel)
    if drive.laws:
        channels["wheel_angle"] = sensing.turned(omega, time)
    for law in drive.laws:
        law(channels)
    return channels


def _remembered(at: At) -> At:
    """Topics on equal clocks ask for the same times again and again."""
    known: dict[bytes, dict[str, Array]] = {}

    def again(time: Array) -> dict[str, Array]:
        key = time.tobytes()
        if key not in known:
            known[key] = at(time)
        return known[key]

    return again


def _state(drive: Drive, track: Track, time: Array) -> dict[str, Array]:
    """Return the truth at times in s since the start."""
    effects = freeze(drive.effects)
    ends = np.cumsum([seconds for _, seconds in track.soils])[:-1]
    soil = np.searchsorted(ends, time, side="right")
    flat, slip, velocity = track.load(time), track.slip(time), drive.speed(time)
    standing = velocity == 0.0
    channels = {
        "velocity": velocity,
        "pitch": drive.pitch(time),
        "yaw_rate": drive.yaw_rate(time),
        "slip_angle": drive.slip_angle(time),
        "pass_number": track.pass_number(time),
        "motor_temperature": track.motor_temperature(time),
        "acceleration": _slope(drive.speed, time),
        **{name: profile(time) for name, profile in drive.further.items()},
    }
    load, sinkage, torque, pull = (np.empty(len(time)) for _ in range(4))
    # One call per soil, however often it comes back: its table then serves all its stretches.
    for kind in dict.fromkeys(s for s, _ in track.soils):
        here = np.isin(soil, [j for j, (s, _) in enumerate(track.soils) if s == kind])
        of_here = {name: column[here] for name, column in channels.items()}
        load[here], sinkage[here], torque[here], pull[here] = _forces(
            drive, effects, kind, flat[here], slip[here], of_here
        )
    distance = _distance(drive, time)
    x, y = distance * math.cos(drive.heading), distance * math.sin(drive.heading)
    longitude, latitude = drive.origin or (math.nan, math.nan)
    return {
        **channels,
        "load": load,
        "flat_load": flat,
        "torque": np.where(standing, 0.0, torque),
        "sinkage": sinkage,
        "angular_velocity": sensing.angular_velocity(effects, drive.wheel, velocity, slip),
        "slip": np.where(standing, np.nan, slip),
        "drawbar_pull": np.where(standing, 0.0, pull),
        "x": x,
        "y": y,
        "longitude": longitude + np.degrees(x / (EARTH * math.cos(math.radians(latitude)))),
        "latitude": latitude + np.degrees(y / EARTH),
        "cohesion": np.array([s.cohesion for s, _ in track.soils])[soil],
        "tan_phi": np.array([s.tan_phi for s, _ in track.soils])[soil],
        "soil": soil,
    }


def _forces(
    drive: Drive, effects: Frozen, soil: Soil, flat: Array, slip: Array, channels: dict[str, Array]
) -> tuple[Array, Array, Array, Array]:
    """Return load, sinkage, torque and drawbar pull of samples on one soil."""

    def under(load: Array) -> tuple[Array, Array, Array]:
        sinkage, torque, pull = forces_with(effects, soil, drive.wheel, load, slip, channels, drive.model)
        net = sensing.net_pull(effects, soil, drive.wheel, sinkage, pull, flat, channels)
        return sinkage, torque, net

    load = sensing.felt_load(effects, flat, channels, lambda load: under(load)[2])
    return load, *under(load)


def _slope(profile: Profile, time: Array) -> Array:
    """Return the slope of a profile by time; profiles go on before the start and after the end."""
    step = 1e-4
    return (profile(time + step) - profile(time - step)) / (2.0 * step)


def _distance(drive: Drive, time: Array) -> Array:
    """Distance in m since the start: the speed, integrated in steps of 10 ms."""
    grid = np.linspace(0.0, drive.duration, math.ceil(drive.duration * 100.0) + 1)
    middle = 0.5 * (grid[1:] + grid[:-1])
    travelled = np.concatenate([[0.0], np.cumsum(drive.speed(middle) * np.diff(grid))])
    return np.asarray(np.interp(time, grid, travelled))
