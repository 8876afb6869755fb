"""Tables of text and Parquet through the whole of `telemetry.read`."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from profiles import examples
from simulator import DRY_SAND, UPLAND_SANDY_LOAM, Clock, Drive, Track, simulate
from simulator.logs import write_csv, write_parquet, write_ros1, write_ros2

from terrain_cli import telemetry
from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.telemetry import Condition

NAN = float("nan")
GEOMETRY = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
N = 40
TIME = np.arange(N) * 0.05
GOOD = {"load": 80.0, "torque": 3.0, "sinkage": 0.01, "angular_velocity": 1.0, "velocity": 0.1}


@pytest.fixture
def rover(rover_of):
    return rover_of(GEOMETRY)


@pytest.fixture
def write(tmp_path):
    """Return a function that writes the text of a table."""

    def write(text, name="run.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


def lines(*rows):
    return "\n".join(",".join(map(str, row)) for row in rows) + "\n"


def good(n=N, **columns):
    """Columns of good samples, 0.05 s apart; None leaves one out."""
    table = {"time": TIME[:n], **{name: np.full(n, value) for name, value in GOOD.items()}}
    table |= {
        name: column if column is None else np.broadcast_to(column, n) for name, column in columns.items()
    }
    return {name: column for name, column in table.items() if column is not None}


def csv(table):
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    return lines(table, *(["" if cell != cell else cell for cell in row] for row in rows))  # noqa: PLR0124 - NaN


def one(path, rover, **options):
    (samples,) = telemetry.read(path, rover, **options)
    return samples


def test_steady_test_points_have_no_clock(write, rover):
    rows = [
        ("load", "torque", "sinkage", "slip"),
        (80, 3, 0.01, 0.2),
        (100, 4, 0.012, 0.4),
        (60, 2, 0.008, 0.1),
    ]
    samples = one(write(lines(*rows)), rover)
    assert samples.time is None
    assert samples.distance is None
    assert samples.stretch.tolist() == [0, 0, 0]
    np.testing.assert_array_equal(samples.channels["torque"], [3.0, 4.0, 2.0])
    assert len(samples.usable) == 3


def test_units_stand_in_the_header(write, rover):
    table = {
        "time [ms]": TIME * 1e3,
        "W (kN)": np.full(N, 0.08),
        "torque_Ncm": np.full(N, 300.0),
        "sinkage [mm]": np.full(N, 10.0),
        "omega_rpm": np.full(N, 60.0 / (2 * np.pi)),
        "V [cm/s]": np.full(N, 10.0),
    }
    samples = one(write(csv(table)), rover)
    for name, value in GOOD.items():
        np.testing.assert_allclose(samples.channels[name], value, rtol=1e-12)
    np.testing.assert_allclose(samples.time, TIME, atol=1e-12)
    assert samples.origins["torque"] == "torque_Ncm in N cm (converted)"


def test_a_decimal_comma(write, rover):
    text = csv(good()).replace(",", ";").replace(".", ",")
    samples = one(write(text), rover)
    np.testing.assert_array_equal(samples.time, TIME)
    assert len(samples.usable) == N


EPOCH = 1_754_000_000
NANOSECONDS = EPOCH * 10**9 + np.arange(N) * 50_000_001


@pytest.mark.parametrize(
    ("header", "values"),
    [
        ("time_ns", NANOSECONDS),
        ("time", NANOSECONDS.astype("datetime64[ns]").astype(str)),
        ("time", [f"{stamp}Z" for stamp in NANOSECONDS.astype("datetime64[ns]").astype(str)]),
        ("timestamp", NANOSECONDS / 1e9),
        ("time_us", NANOSECONDS / 1e3),
        ("time (UTC)", NANOSECONDS.astype("datetime64[ns]").astype(str)),
    ],
)
def test_times_since_1970(write, rover, header, values):
    table = {header: np.asarray(values), **good(time=None)}
    samples = one(write(csv(table)), rover)
    assert samples.origin == EPOCH
    np.testing.assert_allclose(samples.time, np.round(np.arange(N) * 0.050000001, 6), rtol=0, atol=1e-12)


def test_nanoseconds_are_exact_in_parquet(tmp_path, rover):
    pq.write_table(pa.table({"time_ns": NANOSECONDS, **good(time=None)}), tmp_path / "run.parquet")
    samples = one(str(tmp_path / "run.parquet"), rover)
    np.testing.assert_array_equal(samples.time, np.round(np.arange(N) * 50_000_001 * 1e-9, 6))


def test_a_time_that_is_a_text(write, rover):
    with pytest.raises(InputError, match="column 'time' holds texts that are no times, such as 'noon'"):
        one(write(csv(good(time=np.array(["noon"] * N)))), rover)


def test_milliseconds_are_refused_and_then_taken(write, rover_of):
    path = write(csv(good(time=TIME * 1e3)))
    with pytest.raises(InputError, match="can hardly be seconds") as error:
        one(path, rover_of(GEOMETRY))
    samples = one(path, rover_of(GEOMETRY + error.value.hint.partition("\n")[2]))
    np.testing.assert_allclose(samples.time, TIME, atol=1e-12)


def test_rover_toml_may_scale_a_clock(write, rover_of):
    path = write(csv({"tick": np.arange(N), **good(time=None)}))
    text = '[channels]\ntime = { column = "tick", unit = "s", scale = 0.05, offset = 2.0 }\n'
    np.testing.assert_allclose(one(path, rover_of(GEOMETRY + text)).time, TIME + 2.0, atol=1e-12)


def test_wheels_in_rows(write, rover):
    wheels = np.array(["fr", "fl", "fl", "fr"] * (N // 4))
    table = good(time=np.repeat(TIME[: N // 2], 2), wheel=wheels, torque=np.where(wheels == "fl", 3.0, 4.0))
    left, right = telemetry.read(write(csv(table)), rover)
    assert (left.wheel, right.wheel) == ("fl", "fr")
    for samples, torque in ((left, 3.0), (right, 4.0)):
        np.testing.assert_array_equal(samples.channels["torque"], np.full(N // 2, torque))
        np.testing.assert_array_equal(samples.time, TIME[: N // 2])
        assert not samples.reasons()


def test_numbers_name_wheels(write, rover_of):
    table = good(time=np.repeat(TIME[: N // 2], 2), wheel_id=np.tile([2.0, 10.0], N // 2))
    rover = rover_of(GEOMETRY + '[wheels.2]\n[wheels."10"]\nradius = 0.2\n')
    assert [s.wheel for s in telemetry.read(write(csv(table)), rover)] == ["10", "2"]
    assert telemetry.read(write(csv(table)), rover)[0].geometry.radius == 0.2


def test_a_wheel_that_rover_toml_does_not_know(write, rover_of):
    table = good(time=np.repeat(TIME[: N // 2], 2), wheel=np.tile(["fl", "fr"], N // 2))
    rover = rover_of(GEOMETRY + "[wheels.fl]\n")
    with pytest.raises(ConfigurationError, match=r"no \[wheels.fr\] for wheel 'fr' of the data"):
        telemetry.read(write(csv(table)), rover)
    assert one(write(csv(table)), rover, wheels=["fl"]).wheel == "fl"


def test_rows_without_a_wheel_are_told(write, rover):
    wheels = np.array(["fl", "fr"] * (N // 2), dtype=object)
    wheels[4] = ""
    left, right = telemetry.read(write(csv(good(time=np.repeat(TIME[: N // 2], 2), wheel=wheels))), rover)
    assert (len(left), len(right)) == (N // 2 - 1, N // 2)
    assert "1 rows name no wheel in wheel and are passed over" in left.remarks
    with pytest.raises(InputError, match="the column of wheels is empty"):
        one(write(csv(good(wheel=NAN))), rover)


def test_a_wide_table(write, rover_of):
    table = good(load=None, torque=None, T_l=3.0, T_r=4.0, W=80.0, W_r=90.0)
    rover = rover_of(
        GEOMETRY
        + """
        [wheels.left.channels]
        torque = { column = "T_l", unit = "N m" }
        [wheels.right.channels]
        torque = { column = "T_r", unit = "N m" }
        load = { column = "W_r", unit = "N" }
        """
    )
    left, right = telemetry.read(write(csv(table)), rover)
    assert (left.channels["torque"][0], left.channels["load"][0]) == (3.0, 80.0)
    assert (right.channels["torque"][0], right.channels["load"][0]) == (4.0, 90.0)


def test_a_table_of_one_wheel_for_a_rover_of_several(write, rover_of):
    rover = rover_of(GEOMETRY + "[wheels.left]\n[wheels.right]\nradius = 0.1\n")
    with pytest.raises(ConfigurationError, match="torque is given once for 2 wheels: left, right"):
        one(write(csv(good())), rover)
    assert one(write(csv(good())), rover, wheels=["right"]).geometry.radius == 0.1


def test_rover_toml_names_the_only_wheel(write, rover_of):
    assert one(write(csv(good())), rover_of(GEOMETRY)).wheel == "wheel"
    assert one(write(csv(good())), rover_of(GEOMETRY + "[wheels.left]\n")).wheel == "left"
    text = '[channels]\nwheel = { constant = "middle" }\nterrain = { constant = "dune" }\n'
    samples = one(write(csv(good())), rover_of(GEOMETRY + text))
    assert samples.wheel == "middle"
    assert samples.labels["terrain"].names == ("dune",)


def test_runs_and_gaps_part_stretches(write, rover):
    runs = np.repeat(["a", "b"], N // 2)
    assert one(write(csv(good(run=runs))), rover).stretch.tolist() == [0] * (N // 2) + [1] * (N // 2)
    days = np.repeat(["2026-11-20", "2026-11-21"], N // 2)
    samples = one(write(csv(good(run=days))), rover)
    assert samples.labels["run"].names == ("2026-11-20", "2026-11-21")
    assert samples.stretch.max() == 1
    # Each run has a clock of its own.
    restarted = one(write(csv(good(time=np.tile(TIME[: N // 2], 2)))), rover)
    assert restarted.stretch.tolist() == [0] * (N // 2) + [1] * (N // 2)
    assert not restarted.reasons()
    assert restarted.distance[-1] == pytest.approx(2 * 0.1 * TIME[N // 2 - 1])


def test_a_condition_keeps_rows(write, rover):
    table = good(slip_angle_deg=np.tile([0.0, 15.0], N // 2), terrain=np.repeat(["sand", "rock"], N // 2))
    path = write(csv(table))
    samples = one(path, rover, where=Condition("slip_angle_deg == 0 and terrain != 'rock'"))
    np.testing.assert_array_equal(samples.time, TIME[: N // 2 : 2])
    assert samples.labels["terrain"].codes.tolist() == [0] * (N // 4)
    assert len(one(path, rover, where=Condition("0.5 <= time < 1.0"))) == 10
    # Also what is only derived.
    assert len(one(path, rover, where=Condition("slip > 0.1 and load < 100"))) == N
    with pytest.raises(InputError, match="there are no samples where load > 100"):
        one(path, rover, where=Condition("load > 100"))
    with pytest.raises(InputError, match="no column slip_angel; did you mean slip_angle"):
        one(path, rover, where=Condition("slip_angel == 0"))


def test_a_condition_on_an_iso_time(write, rover):
    stamps = (np.datetime64(EPOCH * 1000, "ms") + np.arange(N) * 50).astype(str)
    path = write(csv(good(time=stamps)))
    moment = str(stamps[10])
    assert len(one(path, rover, where=Condition(f"time >= '{moment}Z'"))) == N - 10


def test_distance_without_velocity(write, rover):
    # i = 0.2 of a rim at 0.125 m/s; then V is (1 − i) rω, and rω/(1 + i) when it skids.
    slip = np.where(TIME < 1.0, 0.2, -0.2)
    samples = one(write(csv(good(velocity=None, slip=slip))), rover)
    speed = np.where(TIME < 1.0, 0.1, 0.125 / 0.8)
    assert samples.distance[-1] == pytest.approx(np.sum(0.5 * (speed[1:] + speed[:-1]) * 0.05))
    samples = one(
        write(csv(good(velocity=None, angular_velocity=None, slip=0.2, x=3 * TIME, y=4 * TIME))), rover
    )
    assert samples.distance[-1] == pytest.approx(5 * TIME[-1])


def test_an_entry_angle(write, rover):
    # z = r (1 − cos 30°); an angle of the wrong sign is no sinkage.
    angle = np.where(TIME < 1.0, np.pi / 6, -np.pi / 6)
    samples = one(write(csv(good(sinkage=None, theta1=angle))), rover)
    assert samples.channels["sinkage"][0] == pytest.approx(0.125 * (1 - np.cos(np.pi / 6)))
    assert samples.reasons() == {"sinkage not positive": N // 2}
    assert samples.origins["sinkage"] == "derived from entry angle"


def test_columns_that_mean_nothing(write, rover):
    with pytest.raises(InputError) as error:
        one(write(lines(("a", "b"), (1, 2), (3, 4))), rover)
    assert str(error.value).endswith(
        "c and φ cannot be estimated: load, torque, sinkage and slip are neither measured nor derived"
    )
    assert error.value.hint.endswith("# the columns that are left: a, b")


def test_fitting_columns_are_offered(write, rover):
    with pytest.raises(InputError) as error:
        one(write(csv(good(load=None, Fx_N=1.0, Fy_kN=2.0, other=3.0))), rover)
    assert '\nload = { column = "…" }  # one of: Fx_N, Fy_kN\n' in error.value.hint


def test_a_fitting_column_is_offered_in_the_unit_of_its_header(write, rover):
    """A unit that rover.toml gives stands above that of the header."""
    with pytest.raises(InputError) as error:
        one(write(csv(good(torque=None, motor_tq_mNm=3e3))), rover)
    assert '\ntorque = { column = "…", unit = "mN m" }  # one of: motor_tq_mNm\n' in error.value.hint


def test_cells_that_are_missing_here_and_there_are_missing(write, rover):
    sinkage = np.where(np.arange(N) % 3 == 0, NAN, 0.01)
    torque = np.where(np.arange(N) % 5 == 1, NAN, 3.0)
    samples = one(write(csv(good(sinkage=sinkage, torque=torque))), rover)
    assert len(samples) == N
    assert samples.reasons() == {"no torque": 8, "no sinkage": np.sum(np.isnan(sinkage) & ~np.isnan(torque))}


cell = st.sampled_from([NAN, float("inf"), -1.0, 0.0, 0.5, 3.0, 80.0])


@examples(150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.tuples(*[cell] * 6), min_size=1, max_size=30))
def test_whatever_the_cells_every_row_is_used_or_counted(write, rover, rows):
    # With the unit, for no clock of such steps would be believed to be in seconds.
    names = ("time_s", *GOOD)
    table = {name: np.array([row[j] for row in rows]) for j, name in enumerate(names)}
    try:
        samples = one(write(csv(table)), rover)
    except InputError:
        # Refused as a whole: values so far out of nature are in another unit, or contradict one another.
        return
    assert len(samples.usable) + sum(samples.reasons().values()) == len(samples)
    told = " ".join(map(str, samples.remarks))
    assert len(samples) == len(rows) or "of their own" in told or "of its own" in told
    assert np.all(np.diff(samples.stretch) >= 0)
    assert np.all(np.diff(samples.distance) >= 0)


@pytest.fixture(scope="module")
def drive():
    """Return a drive of two wheels whose topics run at unequal rates, slowest the torque's, with a gap."""
    soils = [(DRY_SAND, 4.0), (UPLAND_SANDY_LOAM, 4.0)]
    return simulate(
        Drive(
            tracks=[Track("front-left", soils), Track("front-right", soils)],
            clocks={
                "joints": Clock(10.0),
                "load": Clock(50.0, phase=0.003, gaps=((2.0, 4.2),)),
                "sinkage": Clock(20.0),
                "front-right/sinkage": Clock(25.0, jitter=0.002),
                "odometry": Clock(30.0, phase=0.01),
            },
            start=float(EPOCH),
        )
    )


SIMULATED = GEOMETRY + "".join(
    f"""
[wheels.front-{side}.channels]
torque = {{ topic = "/joint_states", field = "effort", name = "front_{side}_wheel", unit = "N m" }}
"""
    for side in ("left", "right")
)


@pytest.mark.parametrize("kind", ["parquet", "bag", "mcap"])
def test_the_same_drive_gives_the_same_samples_in_every_format(drive, kind, tmp_path, rover_of):
    writers = {"parquet": write_parquet, "bag": write_ros1, "mcap": write_ros2}
    write_csv(drive, tmp_path / "run.csv")
    writers[kind](drive, tmp_path / f"run.{kind}")
    rover = rover_of(SIMULATED)
    for table, other in zip(
        telemetry.read(str(tmp_path / "run.csv"), rover),
        telemetry.read(str(tmp_path / f"run.{kind}"), rover),
        strict=True,
    ):
        assert table.wheel == other.wheel
        assert (table.origin, table.reasons()) == (other.origin, other.reasons())
        assert table.reasons()["no load"] > 20
        np.testing.assert_array_equal(table.time, other.time)
        np.testing.assert_array_equal(table.stretch, other.stretch)
        for name in ("load", "torque", "sinkage", "slip", "x", "y"):
            np.testing.assert_allclose(
                table.channels[name], other.channels[name], rtol=1e-9, atol=1e-12, err_msg=name
            )
        np.testing.assert_allclose(table.distance, other.distance, rtol=1e-9, atol=1e-12)
