"""The files of a simulation: the log as a table or as the messages of a bag, the truth and the rover file."""

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Literal

import numpy as np

import formats
from formats.output.bag_writer import Topic, write_bag
from formats.output.text_writer import PACKINGS, write_packed
from terrain_cli.simulation import simulated_log as logs
from terrain_cli.simulation.scenario import Scenario
from terrain_cli.simulation.simulated_log import TOGETHER, SimulatedLog, SimulatedSeries, truth_table
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.arrays import Array

#: One stamped number; the name of the topic says of what.
NUMBER = "terrain_est_msgs/msg/Float64Stamped"
NUMBER_DEFINITION = "std_msgs/Header header\nfloat64 data\n"
FORMAT = "terrain-est/truth/1"
JOINTS = "/joint_states"
#: Channel of the body → its place in an Odometry.
_ODOMETRY = {
    "velocity": "twist.twist.linear.x",
    **{name: f"pose.pose.position.{axis}" for name, axis in (("x", "x"), ("y", "y"), ("elevation", "z"))},
}
#: A file that begins so may be replaced.
HEADER = "# Written by terrain-est simulate, which replaces it as long as this line stands first."


def identifier(wheel: str) -> str:
    """Return the name of a wheel as topics and joints have it: no hyphens."""
    return wheel.replace("-", "_")


def joint(wheel: str) -> str:
    return f"{identifier(wheel)}_joint"


def topics(log: SimulatedLog) -> list[Topic]:
    """Return the messages of a log.

    Joint states carry torque (effort, N m) and wheel speed, a WrenchStamped for each wheel load (force.z) and
    drawbar pull (force.x), Odometry and Imu what is of the body, Float64Stamped any other number in SI units.
    """
    return [*_joint_states(log), *_of_wheels(log), *_of_body(log)]


def _joint_states(log: SimulatedLog) -> Iterator[Topic]:
    efforts = {name: measured["torque"] for name, measured in log.wheels.items()}
    speeds = [measured["angular_velocity"].values for measured in log.wheels.values()]
    time = next(iter(efforts.values())).time
    effort, velocity = np.column_stack([e.values for e in efforts.values()]), np.column_stack(speeds)
    columns = {"velocity": velocity, "effort": effort, "name": [joint(name) for name in efforts]}
    yield _topic(log, JOINTS, "sensor_msgs/msg/JointState", time, columns)


def _of_wheels(log: SimulatedLog) -> Iterator[Topic]:
    for wheel, measured in log.wheels.items():
        place = f"/{identifier(wheel)}"
        numbers = ["sinkage", "motor_temperature", "pass_number"]
        load, pull = measured["load"], measured.get("drawbar_pull")
        if pull is None:
            numbers.insert(0, "load")
        else:
            columns = {"header.frame_id": identifier(wheel), "wrench.force.x": pull.values}
            columns["wrench.force.z"] = load.values
            yield _topic(log, f"{place}/force", "geometry_msgs/msg/WrenchStamped", load.time, columns)
        for name in numbers:
            yield _number(log, f"{place}/{name}", measured[name])


def _of_body(log: SimulatedLog) -> Iterator[Topic]:
    body = log.body
    columns: dict[str, Any] = {path: body[name].values for name, path in _ODOMETRY.items()}
    columns |= {"header.frame_id": "site", "child_frame_id": "body", "pose.pose.orientation.w": 1.0}
    yield _topic(log, "/odom", "nav_msgs/msg/Odometry", body["velocity"].time, columns)
    pitch, roll, yaw_rate = (body[name] for name in TOGETHER["attitude"][0])
    columns = {"header.frame_id": "body", "angular_velocity.z": yaw_rate.values}
    columns |= _orientation(pitch.values, roll.values)
    known = np.column_stack([pitch.values, roll.values, yaw_rate.values])
    yield _topic(log, "/imu", "sensor_msgs/msg/Imu", pitch.time, columns, known)
    for name in ("acceleration", "slip_angle"):
        yield _number(log, f"/{name}", body[name])


def _number(log: SimulatedLog, name: str, series: SimulatedSeries) -> Topic:
    return _topic(log, name, NUMBER, series.time, {"data": series.values}, definition=NUMBER_DEFINITION)


def _topic(
    log: SimulatedLog,
    name: str,
    message_type: str,
    time: Array,
    columns: Mapping[str, Any],
    known: Array | None = None,
    definition: str = "",
) -> Topic:
    """Keep the messages in which anything is `known`: of the columns, if it is not said of what."""
    if known is None:
        known = np.column_stack([column for column in columns.values() if isinstance(column, np.ndarray)])
    kept = ~np.isnan(known).all(axis=1)
    # Whole microseconds, which a double in seconds since 1970 only nearly holds.
    stamps = np.round((log.scenario.start + time[kept]) * 1e6).astype(np.int64) * 1000
    cut = {path: c[kept] if isinstance(c, np.ndarray) else c for path, c in columns.items()}
    return Topic(name, message_type, stamps, cut, definition)


def _orientation(pitch: Array, roll: Array) -> dict[str, Array]:
    """Quaternion of an attitude, of REP 103: about y it is positive nose down."""
    down, side = -0.5 * pitch, 0.5 * roll
    return {
        "orientation.w": np.cos(down) * np.cos(side),
        "orientation.x": np.cos(down) * np.sin(side),
        "orientation.y": np.sin(down) * np.cos(side),
        "orientation.z": -np.sin(down) * np.sin(side),
    }


def document(log: SimulatedLog) -> dict[str, Any]:
    """Describe the truth behind a log, ready for JSON; see docs/simulate.md."""
    scenario = log.scenario
    return {
        "format": FORMAT,
        "seed": scenario.seed,
        "start_s": scenario.start,
        "duration_s": scenario.duration,
        "model": {"base": scenario.base, "effects": [_effect(chosen) for chosen in scenario.effects]},
        "soils": {
            soil.name: {
                "c_kPa": soil.cohesion / 1e3,
                "phi_deg": math.degrees(math.atan(soil.tan_phi)),
                **soil.values(scenario.geometry.width),
                "reference": soil.reference,
            }
            for soil in scenario.soils
        },
        "wheel": scenario.geometry._asdict(),
        "noise": {name: sensor.describe() for name, sensor in scenario.sensors.items()},
        "wheels": [
            {
                "wheel": place.name,
                "position_m": [place.x, place.y],
                "soils": [
                    {
                        "soil": scenario.soils[stretch.soil].name,
                        "t_start_s": scenario.start + stretch.start,
                        "t_end_s": scenario.start + stretch.end,
                    }
                    for stretch in log.stretches[place.name]
                ],
            }
            for place in scenario.wheels
        ],
        "channels": {name: _plain(column) for name, column in truth_table(log).items()},
    }


def _effect(chosen: Any) -> dict[str, Any]:
    parameters = {p.name: {"value": chosen.values[p.name], "unit": p.unit} for p in chosen.effect.parameters}
    told = {"effect": chosen.effect.id, "title": chosen.effect.title, "hidden": chosen.hidden}
    return {**told, "parameters": parameters}


def _plain(column: Any) -> list[Any]:
    """Return a column as JSON can hold it: null where nothing is defined."""
    cells = column.tolist() if isinstance(column, np.ndarray) else column
    return [None if cell != cell else cell for cell in cells]  # noqa: PLR0124 - NaN


Kind = Literal["csv", "parquet", "ros1", "mcap", "db3"]
_KINDS: dict[str, Kind] = {
    ".csv": "csv",
    ".parquet": "parquet",
    ".bag": "ros1",
    ".mcap": "mcap",
    ".db3": "db3",
}
BAGS = frozenset({"ros1", "mcap", "db3"})


def kind_of(destination: str) -> Kind:
    """Tell from its name how a log is written; "-" takes CSV, as do pipes and devices."""
    path = Path(destination)
    folder = destination.endswith("/")
    packed = path.suffix.lower() in PACKINGS
    kind = _KINDS.get(Path(path.stem).suffix.lower() if packed else path.suffix.lower())
    if kind is None and (destination == "-" or path.is_fifo() or path.is_char_device()):
        return "csv"
    if kind is None or (packed and kind != "csv") or (folder and kind not in {"mcap", "db3"}):
        raise formats.CannotWriteError(
            destination,
            f"the ending {path.suffix!r} is not known" if kind is None else "cannot be written so",
            hint=f"known are {', '.join(_KINDS)}, .csv{', .csv'.join(PACKINGS)}, "
            "and .mcap/ and .db3/ for the folder of a ROS 2 recording",
        )
    return kind


def write_log(log: SimulatedLog, destination: str) -> None:
    kind = kind_of(destination)
    if kind in BAGS:
        write_bag(topics(log), destination, kind)
    elif Path(destination).suffix.lower() in PACKINGS:
        write_packed(logs.table(log), destination)
    else:
        formats.write_table(logs.table(log), destination, kind=kind)


def write(log: SimulatedLog, destination: str, *, truth: str | None = None, rover: str | None = None) -> None:
    """Write all that belongs to a log, or none; the truth is a table where it ends in .csv or .parquet."""
    with ExitStack() as stack:
        if truth:
            temporary = stack.enter_context(formats.replacing(truth))
            if Path(temporary).suffix.lower() in {".csv", ".parquet"}:
                formats.write_table(logs.truth_table(log), temporary)
            else:
                text = json.dumps(document(log), ensure_ascii=False, indent=1, allow_nan=False)
                Path(temporary).write_text(text + "\n", encoding="utf-8")
        if rover:
            temporary = stack.enter_context(formats.replacing(rover))
            Path(temporary).write_text(rover_text(log.scenario), encoding="utf-8")
        write_log(log, destination)


def rover_text(scenario: Scenario) -> str:
    """Write what a reader of the log needs to know of the rover; nothing of its effects."""
    wheel = scenario.geometry
    lines = [
        HEADER,
        "# Tables name their columns as channels: the entries with a topic are for bags.",
        "",
        "[wheel]",
        f"radius = {toml_files.value(wheel.radius)}  # m",
        f"width = {toml_files.value(wheel.width)}  # m",
    ]
    if wheel.grouser_count:
        lines.append(f"grouser_count = {wheel.grouser_count}")
        lines.append(f"grouser_height = {toml_files.value(wheel.grouser_height)}  # m")
    shear_modulus = toml_files.value(scenario.soils[0].shear_modulus)
    lines += ["", "[soil]", f"shear_modulus = {shear_modulus}  # m, of {scenario.soils[0].name}"]
    for place in scenario.wheels:
        lines += ["", f"[wheels.{toml_files.key(place.name)}]"]
        if len(scenario.wheels) > 1:
            lines.append(f"position = {toml_files.value([place.x, place.y, 0.0])}  # m")
        entry = {"topic": JOINTS, "field": "effort", "name": joint(place.name), "unit": "N m"}
        lines += [
            f"[wheels.{toml_files.key(place.name)}.channels]",
            "# A JointState does not say whether its effort is a torque or a current.",
            f"torque = {toml_files.value(entry)}",
        ]
    return "\n".join(lines) + "\n"


def rover_is_in_the_way(destination: Path) -> bool:
    """Tell whether a rover file is there that was not written by this program."""
    try:
        return not destination.read_text("utf-8").startswith(HEADER)
    except FileNotFoundError:
        return False
    except (OSError, UnicodeDecodeError):
        return True
