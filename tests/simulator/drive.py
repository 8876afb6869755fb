"""A drive: its soils, loads and slip, and how they are measured."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from simulator.noise import Clock, Sensor
from simulator.profiles import Profile, constant, undulation, wave
from simulator.wheel import Model, Wheel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from simulator.profiles import Array
    from simulator.soils import Soil

CHANNELS = ("load", "torque", "sinkage", "angular_velocity", "velocity", "x", "y")
#: What else can be measured, for effects that answer to it.
FURTHER = (
    "slip",
    "drawbar_pull",
    "pitch",
    "yaw_rate",
    "acceleration",
    "motor_temperature",
    "pass_number",
    "slip_angle",
)


@dataclass(frozen=True, slots=True)
class Track:
    """What one wheel meets, over time.

    Parameters
    ----------
    name : str
    soils : sequence of (Soil, float)
        With how many s each lasts.
    load, slip : Profile
        In N; slip from 0 to 1, or from −1 where the wheel skids.
    pass_number : Profile
        How many wheels drove here before.
    motor_temperature : Profile
        In °C.
    """

    name: str
    soils: Sequence[tuple[Soil, float]]
    load: Profile = field(default_factory=lambda: undulation(80.0, 0.2, 7.0))
    slip: Profile = field(default_factory=lambda: wave(0.3, 0.4, 11.0))
    pass_number: Profile = field(default_factory=lambda: constant(0.0))
    motor_temperature: Profile = field(default_factory=lambda: constant(25.0))


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive of some wheels at one speed.

    Parameters
    ----------
    tracks : sequence of Track
        All equally long.
    wheel : Wheel
    speed : Profile
        V in m/s; at 0 the rover stands and its wheels with it. Its slope is the acceleration.
    pitch, slip_angle, yaw_rate : Profile
        In rad and rad/s; they do nothing but through effects, and the path is straight.
    model : {"wong-reece", "linear"}
    effects : mapping of str to mapping of str to float
        Physical effects by their ids, each with its parameters in SI units, in the order in which
        they act; "form": "other" takes another law than the program's. See `effects`, `sensing`.
    clocks : mapping of str to Clock
        By topic ("joints", "load", "sinkage", "odometry", "fix"), or by "WHEEL/topic" for one
        wheel's load or sinkage; `rate` for the others.
    rate : float
        Hz. Topics on equal clocks without losses have equal stamps.
    sensors : mapping of str to Sensor
        By channel, or by "WHEEL/channel"; the others are perfect.
    channels : tuple of str
        Those measured, of `run.CLOCK_OF`.
    further : mapping of str to Profile
        Columns that are measured besides, on the clock of the torque.
    laws : sequence of callable
        What no effect is: each is called, after all effects, with what perfect sensors show, further
        columns and "wheel_angle" in rad included, and changes it in place.
    start : float
        Clock at the start in s.
    heading : float
        Direction of the drive in rad from x to y.
    origin : (float, float), optional
        Longitude and latitude of x = y = 0 in degrees; adds these channels.
    seed : int
    """

    tracks: Sequence[Track]
    wheel: Wheel = field(default_factory=Wheel)
    speed: Profile = field(default_factory=lambda: constant(0.1))
    pitch: Profile = field(default_factory=lambda: constant(0.0))
    slip_angle: Profile = field(default_factory=lambda: constant(0.0))
    yaw_rate: Profile = field(default_factory=lambda: constant(0.0))
    model: Model = "wong-reece"
    effects: Mapping[str, Mapping[str, float | str]] = field(default_factory=dict)
    clocks: Mapping[str, Clock] = field(default_factory=dict)
    rate: float = 50.0
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    channels: tuple[str, ...] = CHANNELS
    further: Mapping[str, Profile] = field(default_factory=dict)
    laws: Sequence[Callable[[dict[str, Array]], None]] = ()
    start: float = 0.0
    heading: float = 0.0
    origin: tuple[float, float] | None = None
    seed: int = 0

    @property
    def duration(self) -> float:
        """Length in s."""
        lengths = {round(sum(seconds for _, seconds in track.soils), 6) for track in self.tracks}
        if len(lengths) != 1:
            raise ValueError(f"the wheels drive for different times: {sorted(lengths)}")
        return lengths.pop()


def one_wheel(
    soils: Sequence[tuple[Soil, float]],
    *,
    load: Profile | None = None,
    slip: Profile | None = None,
    noise: float = 0.0,
    rate: float = 50.0,
    model: Model = "wong-reece",
    effects: Mapping[str, Mapping[str, float | str]] | None = None,
    seed: int = 0,
) -> Drive:
    """Return the plainest drive: one wheel, named "wheel", white noise as a share of W, T, z and i.

    The noise is on a slip channel of its own: the same share on ω and V would make far more of it.
    """
    plain = Track("wheel", soils)
    track = Track("wheel", soils, load or plain.load, slip or plain.slip)
    sensors = {channel: Sensor(relative=noise) for channel in ("load", "torque", "sinkage", "slip")}
    return Drive(
        [track],
        model=model,
        effects=effects or {},
        rate=rate,
        sensors=sensors,
        channels=(*CHANNELS, "slip"),
        seed=seed,
    )
