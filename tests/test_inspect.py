"""What `terrain-est inspect` says of a log: a person's first contact."""

from __future__ import annotations

import json
import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from simulator import DRY_SAND, Clock, Drive, Track, simulate
from simulator.logs import write_ros1

from formats.rosbag.bag_source import BagSource
from terrain_cli import rover as rovers
from terrain_cli.app import main
from terrain_cli.presentation.inspection import inspect, text
from terrain_cli.telemetry import read

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data"
DATA = ROOT.parent / "shared" / "data"
GEOMETRY = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
measured = pytest.mark.skipif(not DATA.is_dir(), reason="the measured data are not here")


@pytest.fixture
def rover():
    return rovers.load(SAMPLE / "rover.toml")


@pytest.fixture
def run(capsys):
    """Return a function that runs inspect and returns exit code, stdout and stderr."""

    def run(*args):
        with pytest.raises(SystemExit) as end:
            main(["inspect", *map(str, args)])
        return end.value.code, *capsys.readouterr()

    return run


def squeezed(words):
    """Lines without the spaces that align them."""
    return [" ".join(line.split()) for line in words.splitlines()]


def test_a_bag(run):
    code, out, err = run(SAMPLE / "run.bag")
    assert (code, err) == (0, "")
    lines = squeezed(out)
    assert lines[0] == f"{SAMPLE / 'run.bag'}: ROS 1 bag, 6 topics, from 2025-07-31 22:13:20 UTC"
    assert "topic type messages rate largest gap" in lines
    assert "/front_right/sinkage std_msgs/msg/Float64 1150 20.0 Hz 1.55 s" in lines
    (head,) = (line for line in lines if line.startswith("wheel front-right:"))
    assert head == (
        "wheel front-right: 1110 of 1180 samples can be used, 20.0 Hz over 60.0 s, 5.69 m, "
        "3 stretches, largest gap 1.05 s"
    )
    assert "sinkage 0.0047 … 0.02214 m 30 /front_right/sinkage data in m (rover.toml)" in lines
    assert "slip derived from angular velocity and velocity" in lines
    assert "set aside: 40 · wheel stands (ω = 0, slip undefined)" in lines
    assert "set aside: 30 · no sinkage" in lines
    assert "missing for an estimate:" not in lines


@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.csv", "run.parquet"])
def test_what_it_counts_is_what_is_read(rover, name):
    document = inspect(str(SAMPLE / name), rover)
    samples = read(str(SAMPLE / name), rover)
    assert [wheel["wheel"] for wheel in document["wheels"]] == [s.wheel for s in samples]
    for wheel, own in zip(document["wheels"], samples, strict=True):
        assert (wheel["samples"], wheel["used"]) == (len(own), len(own.usable))
        assert wheel["set_aside"] == own.reasons()
        assert wheel["stretches"] == len(np.unique(own.stretch[own.usable]))
        assert wheel["distance_m"] == own.distance[-1]
        low, high = wheel["channels"]["load"]["range"]
        assert (low, high) == (own.channels["load"].min(), own.channels["load"].max())
    assert document["rover_toml"] == ""


@pytest.mark.parametrize("name", ["run.bag", "run.mcap"])
def test_a_bag_is_read_once(rover, name, monkeypatch):
    passes = []
    plain = BagSource.read_together
    monkeypatch.setattr(
        BagSource,
        "read_together",
        lambda self, fields, *rest: passes.append(fields) or plain(self, fields, *rest),
    )
    inspect(str(SAMPLE / name), rover)
    assert len(passes) == 1


def test_json(run):
    code, out, err = run(SAMPLE / "run.mcap", SAMPLE / "run.csv", "--json")
    assert (code, err) == (0, "")
    document = json.loads(out)
    assert document["format"] == "terrain-est/inspection/1"
    bag, table = document["inputs"]
    assert (bag["kind"], table["kind"]) == ("mcap", "csv")
    joints = bag["streams"][0]
    assert (joints["topic"], joints["records"]) == ("/joint_states", 1180)
    assert joints["rate_Hz"] == pytest.approx(20.0)
    assert {
        "name": "effort",
        "kind": "numbers",
        "elements": ["front_left_wheel", "front_right_wheel"],
    } in joints["fields"]
    assert table["streams"][0]["records"] == 2360
    assert table["wheels"][0]["channels"]["load"]["unit"] == "N"


def test_every_field_of_a_topic_on_demand(run):
    _, out, _ = run(SAMPLE / "run.bag", "--verbose")
    assert "/joint_states: " in out
    assert "effort[front_left_wheel, front_right_wheel]" in out


def test_one_wheel(run):
    code, out, _ = run(SAMPLE / "run.bag", "--wheel", "front-left")
    assert code == 0
    assert "wheel front-left" in out
    assert "wheel front-right" not in out
    code, _, err = run(SAMPLE / "run.bag", "--wheel", "rear")
    assert code == 65
    assert "there is no wheel rear" in err


def test_without_rover_toml_it_says_what_to_write(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(SAMPLE / "run.bag", tmp_path)
    code, out, err = run("run.bag")
    assert (code, err) == (0, "")
    lines = squeezed(out)
    start = lines.index("missing for an estimate:")
    assert lines[start + 1 : start + 4] == [
        "torque not measured, and there is no motor current",
        "geometry the radius and width of the wheel",
        "shear modulus the shear modulus of the soil",
    ]
    assert "write into a file rover.toml beside the log, and fill in each …:" in lines
    # Written and filled in, that is all it takes.
    toml = out[out.index("    [wheel]\n") : out.index("\ndraft a rover.toml: ")].replace("\n    ", "\n")
    for name, value in {"radius": 0.125, "width": 0.1, "shear_modulus": 0.018}.items():
        toml = toml.replace(f"{name} = …", f"{name} = {value}")
    (tmp_path / "rover.toml").write_text(toml, encoding="utf-8")
    code, out, _ = run("run.bag")
    assert code == 0
    assert "missing for an estimate" not in out
    assert out.count("can be used") == 2


def test_what_is_missing_of_one_wheel_only(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("T_l,T_r,W,z,slip\n1,,80,0.01,0.2\n2,,80,0.01,0.3\n")
    wheels = '[wheels.l.channels]\ntorque = "T_l"\n[wheels.r]\n'
    (tmp_path / "rover.toml").write_text(GEOMETRY + wheels)
    document = inspect(str(path), rovers.load(tmp_path / "rover.toml"))
    assert [wheel["missing"] for wheel in document["wheels"]] == [
        [],
        [{"what": "torque", "because": "not measured, and there is no motor current"}],
    ]
    assert document["rover_toml"].startswith('[wheels.r.channels]\ntorque = { column = "…", unit = "N m" }')
    assert "torque  not measured, and there is no motor current (wheel r)" in text(document)


def test_sources_none_of_which_can_be_preferred(tmp_path, rover_file):
    columns = "load,torque,sinkage,slip,time,omega,angular_speed\n"
    path = tmp_path / "run.csv"
    path.write_text(columns + "80,3,0.01,0.2,0,1,1\n")
    document = inspect(str(path), rover_file)
    assert "columns 'omega' and 'angular_speed' can all be angular_velocity" in document["problem"]["error"]
    assert document["problem"]["exit_code"] == 65
    # What there is comes first.
    assert "columns: load, torque, sinkage, slip, time, omega, angular_speed" in text(document)


@pytest.fixture
def rover_file(tmp_path):
    path = tmp_path / "rover.toml"
    path.write_text(GEOMETRY)
    return rovers.load(path)


def test_topics_none_of_which_can_be_preferred(tmp_path, rover_file):
    """Two wheels' topics, and a torque that does not say whose it is."""
    drive = Drive(
        [Track("a", [(DRY_SAND, 2.0)]), Track("b", [(DRY_SAND, 2.0)])], clocks={"load": Clock(10.0)}
    )
    write_ros1(simulate(drive), tmp_path / "run.bag")
    entry = '[channels]\ntorque = { topic = "/joint_states", field = "effort", index = 0, unit = "N m" }\n'
    with (tmp_path / "rover.toml").open("a") as file:
        file.write(entry)
    document = inspect(str(tmp_path / "run.bag"), rovers.load(tmp_path / "rover.toml"))
    (wheel,) = document["wheels"]
    assert wheel["undecided"]["load"] == ["/a/force wrench.force.z", "/b/force wrench.force.z"]
    assert {
        "what": "load",
        "because": "load could be any of /a/force wrench.force.z, /b/force wrench.force.z",
    } in wheel["missing"]
    lines = document["rover_toml"].splitlines()
    a, b = (f'topic = "/{wheel}/force", field = "wrench.force.z"' for wheel in "ab")
    assert f"load = {{ {a} }}  # or {b}" in lines
    shown = text(document)
    assert "not used: drawbar_pull, which could be any of /a/force wrench.force.x" in shown
    assert "not used: load" not in shown


def test_lines_for_rover_toml_come_in_the_order_of_the_wheels(tmp_path):
    """A sinkage in cm, of four wheels."""
    wheels = ["rr", "fl", "ml", "fr"]
    path = tmp_path / "run.csv"
    rows = [f"{k},{wheel},80,3,{2 + k % 2},0.3" for wheel in wheels for k in range(20)]
    path.write_text("\n".join(["time,wheel,load,torque,sinkage,slip", *rows]) + "\n")
    (tmp_path / "rover.toml").write_text(GEOMETRY + "".join(f"[wheels.{wheel}]\n" for wheel in wheels))
    document = inspect(str(path), rovers.load(tmp_path / "rover.toml"))
    sinkage = 'sinkage = { column = "sinkage", unit = "cm" }'
    shown = [wheel["wheel"] for wheel in document["wheels"]]
    assert document["rover_toml"].splitlines() == [
        line for wheel in shown for line in (f"[wheels.{wheel}.channels]", sinkage)
    ]


def test_a_clock_in_milliseconds_is_told(tmp_path, rover_file):
    path = tmp_path / "run.csv"
    rows = [f"{20 * k},80,3,0.01,1,0.1" for k in range(50)]
    path.write_text("\n".join(["time,load,torque,sinkage,angular_velocity,velocity", *rows]) + "\n")
    document = inspect(str(path), rover_file)
    (lack,) = document["wheels"][0]["missing"]
    assert lack["what"] == "time"
    assert "samples are 20 apart, which can hardly be seconds" in lack["because"]
    assert 'time = { column = "time", unit = "ms" }' in document["rover_toml"]


def test_a_table_that_means_nothing_is_still_described(run, tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("when,what\n1,a\n2,b\n3,c\n")
    code, out, _ = run(path)
    assert code == 0
    assert "run.csv: text table, 3 rows" in out
    assert "columns: when, what (text)" in out
    assert (
        "slip           not measured, and there is no angular_velocity or velocity to derive it from" in out
    )


def test_rows_passed_over_are_counted(run, tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("load,torque\n80,3\n80,3,9\n80,3\n")
    _, out, _ = run(path)
    assert "text table, 2 rows and 1 that do not fit its header" in out
    assert "row 3 has 3 fields where the header names 2: set aside" in out


@pytest.mark.parametrize("column", ["Fx_tractive_N", "tractive_force_kN", "pull [N]"])
def test_a_column_that_may_be_the_drawbar_pull_is_pointed_out(run, tmp_path, column):
    path = tmp_path / "run.csv"
    path.write_text(f"load,slip,{column},Fx_std,Fz_std_N\n80,0.1,7,1,1\n")
    _, out, _ = run(path)
    unit = "kN" if "kN" in column else "N"
    assert (
        f'if {column} is one, write into rover.toml: [channels] drawbar_pull = {{ column = "{column}"' in out
    )
    assert f'unit = "{unit}" }}' in out
    path.write_text(f"load,slip,drawbar_pull,{column}\n80,0.1,7,1\n")
    assert "no drawbar pull" not in run(path)[1]


JOINT = 'topic = "/fake_joints_state", field = "effort", name = "joint_5"'


@measured
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("cmu-smooth-wheel.csv", "text table, 189 rows"),
        ("cmu-smooth-wheel.csv", "wheel smooth: 189 samples"),
        ("cmu-smooth-wheel.csv", "no drawbar pull is read; if Fx_tractive_N is one, write into rover.toml:"),
        ("cmu-smooth-wheel.csv", "torque not measured, and there is no motor current"),
        ("digitised-smooth-wheels.csv", "torque 0 … 5.3 N m meas_torque_nm in N m"),
        ("digitised-smooth-wheels.csv", "geometry the radius and width of the wheel"),
        ("borealtc-mixed-pro_00.csv", "terrain FLOORING, ASPHALT, SNOW 4436 terrain"),
        ("borealtc-mixed-pro_00.csv", "further columns, kept as they are: curL, curR, velL, velR"),
        ("bags/robot_localization_test1.bag", "/imu/data sensor_msgs/msg/Imu 11865 30.0 Hz 0.03 s"),
        ("bags/robot_localization_test1.bag", "rad/s /imu/data angular_velocity.z in rad/s"),
        (
            "bags/robot_localization_test1.bag",
            "slip not measured, and there is no angular_velocity to derive it from",
        ),
        (
            "bags/plotjuggler_fake_joint_state.bag",
            "/fake_joints_state sensor_msgs/msg/JointState 2725 1000.1 Hz",
        ),
        ("bags/plotjuggler_fake_joint_state.bag", "wheel joint_5: 2725 samples, 1000.0 Hz over 2.7 s"),
        ("bags/plotjuggler_fake_joint_state.bag", f'# motor_current = {{ {JOINT}, unit = "A" }} # instead'),
    ],
)
def test_measured_data(name, says):
    assert any(says in line for line in described(name))


@cache
def described(name):
    """Say what is in measured data, of whose rover nothing is known."""
    return squeezed(text(inspect(str(DATA / name), rovers.Rover())))


DING = "[wheel]\nradius = 0.15735\nwidth = 0.165\n[soil]\nshear_modulus = 0.011\n"


@pytest.fixture
def estimate(capsys, tmp_path):
    """Return a function that runs estimate with the rover of Ding's wheel."""
    (tmp_path / "ding.toml").write_text(DING)

    def estimate(name, *args):
        with pytest.raises(SystemExit) as end:
            main(["estimate", str(DATA / name), "--rover", str(tmp_path / "ding.toml"), *args])
        return end.value.code, *capsys.readouterr()

    return estimate


@measured
def test_one_load_does_not_separate_the_parameters_of_a_measured_soil(estimate):
    code, out, err = estimate(
        "digitised-smooth-wheels.csv", "--where", "source == 'ding2011'", "--min-samples", "3"
    )
    assert code == 0
    header, row = (line.split(",") for line in out.splitlines())
    table = dict(zip(header, row, strict=True))
    # Nearly dry sand: cohesion is nothing that this tells from 0, on either side.
    assert (table["n_samples"], table["n_rejected"]) == ("6", "0")
    assert table["status"] in {"not-separable", "out-of-range"}
    assert abs(float(table["c_kPa"])) < float(table["c_se_kPa"])
    # τ = T/(r² b θ1) with T = 5 N m and θ1 = 0.4 rad is 3 kPa; Ding gives about 5 kPa at full slip.
    assert 2.0 < float(table["strength_kPa"]) < 8.0
    assert float(table["strength_se_kPa"]) < 0.2 * float(table["strength_kPa"])
    assert float(table["corr_c_phi"]) < -0.95
    assert f"{table['status']}: " in err


@measured
@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("cmu-smooth-wheel.csv", "c and φ cannot be estimated: torque is neither measured nor derived\n"),
        ("borealtc-mixed-pro_00.csv", "load, torque, sinkage and slip are neither measured nor derived\n"),
        (
            "bags/robot_localization_test1.bag",
            "load, torque, sinkage and slip are neither measured nor derived\n",
        ),
    ],
)
def test_measured_data_that_cannot_give_an_estimate(estimate, name, says):
    code, out, err = estimate(name)
    assert (code, out) == (65, "")
    assert says in err
    assert "torque = { " in err


def test_a_torque_that_no_soil_takes_is_doubted(run, tmp_path):
    rows = ["load,torque,sinkage,slip", *["80,3700,0.02,0.2"] * 5]
    (tmp_path / "run.csv").write_text("\n".join(rows), "utf-8")
    (tmp_path / "rover.toml").write_text(GEOMETRY, "utf-8")
    _, out, _ = run(tmp_path / "run.csv")
    # 3700 / (0.125 · 80); the lines to add are those of the error that an estimate ends with.
    assert "torque is 370 times load times wheel radius, more than any soil can resist" in out
    assert '    torque = { column = "torque", unit = "N mm" }' in out
    (tmp_path / "run.csv").write_text("\n".join(rows).replace("torque", "torque [N mm]"), "utf-8")
    assert "more than any soil can resist" not in run(tmp_path / "run.csv")[1]


def test_a_bag_without_topics(run, tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "empty.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        writer.finish()
    code, out, _ = run(path)
    assert code == 0
    assert out.startswith(f"{path}: MCAP, no topics\n")
