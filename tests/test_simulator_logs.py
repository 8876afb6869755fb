"""The files of the simulator hold every bit, and the sample data are what their script makes."""

from __future__ import annotations

import csv
import importlib.util
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest
import simulator
from pyarrow import parquet
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from simulator import SOILS, Clock, Sensor, simulate
from simulator.logs import write_csv, write_parquet, write_ros1, write_ros2
from test_simulator import WHEEL, two_wheels

SAMPLE = Path(__file__).parent.parent / "sample_data"


@pytest.fixture(scope="module")
def run() -> simulator.Run:
    return simulate(
        two_wheels(
            rate=20.0,
            start=1_754_000_000.0,
            origin=(10.0, 50.0),
            clocks={"front-right/sinkage": Clock(20.0, gaps=((1.0, 2.0),))},
            sensors={"torque": Sensor(relative=0.02)},
            channels=(*simulator.CHANNELS, "drawbar_pull"),
        )
    )


def bag_columns(path: Path, *, ros1: bool, latency: float = 0.0) -> dict[str, list]:
    """Read a bag of standard messages back into rows: topics by their times, joints by their names."""
    rows: dict[tuple[float, str], dict[str, float]] = {}
    wheels = ("front-left", "front-right")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        for connection, log_time, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            header = getattr(message, "header", None)
            stamp = (
                header.stamp.sec * 10**9 + header.stamp.nanosec if header else log_time - round(latency * 1e9)
            )
            assert stamp + round(latency * 1e9) == log_time
            time = stamp // 1000 * 1e-6
            where = [w for w in wheels if f"/{w.replace('-', '_')}/" in connection.topic] or wheels
            for wheel in where:
                row = rows.setdefault((round(time, 6), wheel), {})
                if connection.topic == "/joint_states":
                    place = list(message.name).index(wheel.replace("-", "_") + "_wheel")
                    row["torque"] = message.effort[place]
                    row["angular_velocity"] = message.velocity[place]
                elif connection.topic.endswith("/force"):
                    row["load"], row["drawbar_pull"] = message.wrench.force.z, message.wrench.force.x
                elif connection.topic.endswith("/sinkage"):
                    row["sinkage"] = message.data
                elif connection.topic == "/odom":
                    row["velocity"] = message.twist.twist.linear.x
                    row["x"], row["y"] = message.pose.pose.position.x, message.pose.pose.position.y
                elif connection.topic == "/fix":
                    row["longitude"], row["latitude"] = message.longitude, message.latitude
    ordered = sorted(rows)
    table: dict[str, list] = {"time": [t for t, _ in ordered], "wheel": [w for _, w in ordered]}
    for channel in sorted({channel for row in rows.values() for channel in row}):
        table[channel] = [rows[key].get(channel, math.nan) for key in ordered]
    return table


def assert_same(table: dict[str, list], expected: dict[str, np.ndarray]) -> None:
    assert table.keys() == expected.keys()
    for name, column in expected.items():
        if name == "wheel":
            assert list(table[name]) == list(column)
        else:
            np.testing.assert_array_equal(np.array(table[name], dtype=float), column, err_msg=name)


def test_tables_hold_every_bit(run: simulator.Run, tmp_path: Path) -> None:
    write_csv(run, tmp_path / "run.csv", terrain=True)
    write_parquet(run, tmp_path / "run.parquet")
    expected = run.columns(terrain=True)
    with (tmp_path / "run.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    read = {name: [row[name] for row in rows] for name in rows[0]}
    assert read.pop("terrain") == list(expected.pop("terrain"))
    assert read["sinkage"].count("") == 20
    wheels = read.pop("wheel")
    assert_same(
        {"wheel": wheels} | {name: [float(v or "nan") for v in column] for name, column in read.items()},
        expected,
    )
    assert_same(parquet.read_table(tmp_path / "run.parquet").to_pydict(), expected)


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_ros1_bag_holds_every_bit(run: simulator.Run, tmp_path: Path, compression: str) -> None:
    write_ros1(run, tmp_path / "run.bag", compression=compression, latency=0.01)
    assert_same(bag_columns(tmp_path / "run.bag", ros1=True, latency=0.01), run.columns())


@pytest.mark.parametrize(
    ("storage", "compression", "folder"),
    [
        ("mcap", "none", True),
        ("mcap", "storage", True),
        ("mcap", "message", True),
        ("sqlite3", "none", True),
        ("sqlite3", "file", True),
        ("mcap", "storage", False),
        ("sqlite3", "none", False),
    ],
)
def test_ros2_bag_holds_every_bit(
    run: simulator.Run, tmp_path: Path, storage: str, compression: str, *, folder: bool
) -> None:
    ending = "" if folder else {"mcap": ".mcap", "sqlite3": ".db3"}[storage]
    path = tmp_path / f"run{ending}"
    write_ros2(run, path, storage=storage, compression=compression, folder=folder)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    assert path.is_dir() == folder
    assert_same(bag_columns(path, ros1=False), run.columns())


@pytest.mark.parametrize("ros1", [True, False])
def test_custom_messages_hold_every_bit(run: simulator.Run, tmp_path: Path, *, ros1: bool) -> None:
    path = tmp_path / ("run.bag" if ros1 else "run.mcap")
    (write_ros1 if ros1 else write_ros2)(run, path, custom=True)
    fields = ("load", "torque", "sinkage", "angular_velocity", "velocity", "x", "y")
    table: dict[str, list] = {name: [] for name in ("time", "wheel", *fields)}
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=store) as reader:
        for connection, stamp, raw in reader.messages():
            assert connection.msgtype == "rover_msgs/msg/WheelTelemetry"
            message = reader.deserialize(raw, connection.msgtype)
            table["time"].append(round(stamp * 1e-9, 6))
            for name in ("wheel", *fields):
                table[name].append(getattr(message, name))
    assert_same(table, {name: run.columns()[name] for name in table})


def test_sample_is_what_its_script_makes(tmp_path: Path) -> None:
    spec = importlib.util.spec_from_file_location("make", SAMPLE / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    make.main(tmp_path)
    # Tables of text are equal to the byte; the rest may differ by what the libraries sign it with.
    for name in ("run.csv", "truth.csv"):
        assert (tmp_path / name).read_bytes() == (SAMPLE / name).read_bytes()
    expected = simulate(make.drive()).columns()
    assert_same(parquet.read_table(SAMPLE / "run.parquet").to_pydict(), expected)
    assert_same(bag_columns(SAMPLE / "run.bag", ros1=True), expected)
    assert_same(bag_columns(SAMPLE / "run.mcap", ros1=False), expected)


def test_sample_is_small_and_its_rover_is_the_one_simulated() -> None:
    assert sum(path.stat().st_size for path in SAMPLE.glob("run.*")) < 2_000_000
    rover = tomllib.loads((SAMPLE / "rover.toml").read_text("utf-8"))
    assert (rover["wheel"]["radius"], rover["wheel"]["width"]) == (WHEEL.radius, WHEEL.width)
    with (SAMPLE / "truth.csv").open(newline="") as file:
        truth = list(csv.DictReader(file))
    assert {row["wheel"] for row in truth} == set(rover["wheels"])
    for row in truth:
        soil = SOILS[row["terrain"]]
        assert soil.shear_modulus == rover["soil"]["shear_modulus"]
        strength = soil.strength(float(row["sigma_kPa"]) * 1e3)
        assert float(row["strength_kPa"]) * 1e3 == pytest.approx(strength, rel=1e-3)
