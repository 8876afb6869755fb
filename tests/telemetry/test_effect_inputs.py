"""What the effects of a model need is read, derived, or asked for by name."""

from __future__ import annotations

import numpy as np
import pytest
from simulator import Clock, Drive, Track, simulate
from simulator.logs import write_csv, write_parquet, write_ros1, write_ros2
from simulator.soils import DRY_SAND

from terrain_cli import telemetry
from terrain_cli.effects import Effect, Parameter
from terrain_cli.errors import ConfigurationError, InputError
from terrain_cli.telemetry import effect_inputs

GEOMETRY = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
N = 40
TIME = np.arange(N) * 0.05


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a good table with further columns."""

    def write(**columns):
        table = {
            "time": TIME,
            "load": np.full(N, 80.0),
            "torque": 3.0 + 0.5 * TIME,
            "sinkage": np.full(N, 0.01),
            "angular_velocity": np.full(N, 1.0),
            "velocity": np.full(N, 0.1),
            **columns,
        }
        table = {name: np.broadcast_to(c, N) for name, c in table.items() if c is not None}
        rows = [",".join(table), *(",".join(map(str, row)) for row in zip(*table.values(), strict=True))]
        path = tmp_path / "run.csv"
        path.write_text("\n".join(rows).replace("nan", "") + "\n", encoding="utf-8")
        return str(path)

    return write


def effect(*names, any_of=(), further=()):
    own = tuple(Parameter(f"p{k}", "1", 0.0, 1.0, needs=(name,)) for k, name in enumerate(further))
    return Effect(
        id="some-effect",
        title="Some effect",
        kind="force",
        parameters=own,
        laws={},
        needs=names,
        any_of=any_of,
    )


def read(path, rover, *names, **further):
    (samples,) = telemetry.read(path, rover, effects=[effect(*names, **further)])
    return samples


def test_channels_are_in_si_units_and_columns_as_they_are(write, rover_of):
    path = write(slip_angle_deg=np.linspace(0.0, 10.0, N), tether_tension=np.arange(N))
    samples = read(path, rover_of(GEOMETRY), "slip_angle", "tether_tension", "sinkage", "time")
    np.testing.assert_allclose(samples.drivers["slip_angle"], np.radians(np.linspace(0.0, 10.0, N)))
    np.testing.assert_array_equal(samples.drivers["tether_tension"], np.arange(N))
    np.testing.assert_array_equal(samples.drivers["sinkage"], samples.channels["sinkage"])
    np.testing.assert_allclose(samples.drivers["time"], TIME)


def test_rates_and_the_angle_of_the_wheel_are_derived(write, rover_of):
    path = write(tether_tension=TIME**2, yaw_rate=0.3)
    names = ("torque_rate", "tether_tension_rate", "wheel_angle", "yaw_rate")
    drivers = read(path, rover_of(GEOMETRY), *names).drivers
    np.testing.assert_allclose(drivers["torque_rate"], 0.5)
    np.testing.assert_allclose(drivers["tether_tension_rate"][2:-2], 2.0 * TIME[2:-2], atol=1e-9)
    np.testing.assert_allclose(drivers["wheel_angle"], TIME)
    # A channel that is called a rate is no derivative of one.
    np.testing.assert_array_equal(drivers["yaw_rate"], np.full(N, 0.3))


def test_samples_without_what_is_needed_are_set_aside(write, rover_of):
    pitch = np.where(np.arange(N) < 3, np.nan, 0.1)
    samples = read(write(pitch=pitch), rover_of(GEOMETRY), "pitch")
    assert samples.reasons() == {"no pitch": 3}
    assert np.isfinite(samples.drivers["pitch"][samples.usable]).all()
    (plain,) = telemetry.read(write(pitch=pitch), rover_of(GEOMETRY))
    assert not plain.reasons()
    assert not plain.drivers


def test_one_of_several_is_enough(write, rover_of):
    some = {"any_of": ("drawbar_pull", "acceleration_rate", "pitch")}
    drivers = read(write(pitch=0.1, drawbar_pull=np.nan), rover_of(GEOMETRY), **some).drivers
    assert set(drivers) == {"pitch"}
    with pytest.raises(InputError, match="needs one of drawbar_pull, acceleration_rate, pitch"):
        read(write(), rover_of(GEOMETRY), **some)


def test_velocity_follows_from_slip(write, rover_of):
    path = write(velocity=None, slip=0.2)
    samples = read(path, rover_of(GEOMETRY), "velocity")
    np.testing.assert_allclose(samples.drivers["velocity"], 0.1)
    assert samples.origins["velocity"] == "derived from angular velocity and slip"


def test_wheel_speed_follows_from_slip(write, rover_of):
    slip = np.linspace(-0.3, 0.8, N)
    samples = read(write(angular_velocity=None, slip=slip), rover_of(GEOMETRY), "angular_velocity")
    rim = 0.125 * samples.drivers["angular_velocity"]
    np.testing.assert_allclose(np.where(slip < 0.0, rim / 0.1 - 1.0, 1.0 - 0.1 / rim), slip, atol=1e-12)
    assert samples.origins["angular_velocity"] == "derived from velocity and slip"


def test_what_a_parameter_needs_may_be_missing(write, rover_of):
    further = {"further": ("pitch", "torque_rate")}
    assert set(read(write(), rover_of(GEOMETRY), **further).drivers) == {"torque_rate"}
    assert not read(write(time=None), rover_of(GEOMETRY), **further).drivers


def test_the_drawbar_pull_is_read_for_a_model_only(write, rover_of):
    path = write(drawbar_pull=12.0)
    assert "drawbar_pull" in read(path, rover_of(GEOMETRY)).channels
    (plain,) = telemetry.read(path, rover_of(GEOMETRY))
    assert "drawbar_pull" not in plain.channels


def test_a_channel_that_is_not_there(write, rover_of):
    with pytest.raises(InputError) as error:
        read(write(tilt=0.1), rover_of(GEOMETRY), "pitch")
    assert str(error.value).endswith(
        "run.csv: effect some-effect needs pitch, which is neither measured nor derived"
    )
    assert '[channels]\npitch = { column = "…", unit = "rad" }' in error.value.hint
    assert "tilt" in error.value.hint


def test_a_column_that_is_not_there(write, rover_of):
    with pytest.raises(InputError) as error:
        read(write(tether_tensoin=0.1), rover_of(GEOMETRY), "tether_tension_rate")
    assert "effect some-effect needs tether_tension (for tether_tension_rate)" in str(error.value)
    assert "tether_tension: no channel, but a numeric column" in error.value.hint
    assert "tether_tensoin" in error.value.hint


def test_a_rate_of_steady_test_points(write, rover_of):
    with pytest.raises(
        InputError, match=r"needs time \(for torque_rate\), which is neither measured nor derived"
    ):
        read(write(time=None), rover_of(GEOMETRY), "torque_rate")


def test_grousers_are_of_rover_toml(write, rover_of):
    with pytest.raises(ConfigurationError, match="effect some-effect needs grouser_count") as error:
        read(write(), rover_of(GEOMETRY), "grouser_count", "grouser_height", "gravity")
    assert "[wheel]\ngrouser_count = …\ngrouser_height = …" in error.value.hint
    text = "[wheel]\nradius = 0.125\nwidth = 0.1\ngrouser_count = 12\ngrouser_height = 0.01\n"
    vehicle = "[vehicle]\nmass = 40\ncentre_of_mass = [0, 0, 0]\ngravity = 3.71\n"
    rover = rover_of(text + "[soil]\nshear_modulus = 0.018\n" + vehicle)
    samples = read(write(), rover, "grouser_count", "grouser_height", "gravity")
    assert samples.geometry.wheel == (0.125, 0.1, 0.01, 12, 3.71)
    assert not samples.drivers


def test_noise_of_the_sensors_is_carried_along(write, rover_of):
    text = '[noise]\ntorque = { relative = 0.02 }\nsinkage = { absolute = 0.5, unit = "mm" }\n'
    samples = read(write(), rover_of(GEOMETRY + text))
    assert (samples.noise["torque"].relative, samples.noise["sinkage"].absolute) == (0.02, 0.0005)


@pytest.mark.parametrize(
    ("write_log", "name"),
    [(write_csv, "r.csv"), (write_parquet, "r.parquet"), (write_ros1, "r.bag"), (write_ros2, "r.mcap")],
)
def test_every_format_gives_the_same(write_log, name, tmp_path, rover_of):
    drive = Drive([Track("wheel", [(DRY_SAND, 4.0)])], clocks={"joints": Clock(20.0)}, rate=20.0)
    write_log(simulate(drive), tmp_path / name)
    text = """[channels]
        torque = { topic = "/joint_states", field = "effort", unit = "N m" }
        sinkage = { topic = "/wheel/sinkage", field = "data", unit = "m" }
        """
    samples = read(str(tmp_path / name), rover_of(GEOMETRY + text), "angular_velocity", "slip_rate")
    assert set(samples.drivers) == {"angular_velocity", "slip_rate"}
    assert len(samples.usable) == len(samples) == 80


def test_the_slope_of_the_rut_begins_anew_after_a_gap(write, rover_of):
    late = np.arange(N) >= N // 2
    depth = np.where(late, 0.05 - 0.002 * TIME, 0.01 + 0.002 * TIME)
    path = write(time=TIME + 60.0 * late, sinkage=depth, yaw_rate=0.0)
    drivers = read(path, rover_of(GEOMETRY), "rut_slope").drivers
    assert set(drivers) >= {"rut_slope"}
    # 2 mm/s at 0.1 m/s.
    np.testing.assert_allclose(drivers["rut_slope"], np.where(late, -0.02, 0.02), atol=1e-9)


@pytest.mark.parametrize(
    ("lost", "message"),
    [("time", r"needs time \(for rut_slope\)"), ("velocity", r"needs velocity \(for rut_slope\)")],
)
def test_the_slope_of_the_rut_needs_a_way(lost, message, write, rover_of):
    further = {"slip": 0.2, "angular_velocity": None} if lost == "velocity" else {}
    with pytest.raises(InputError, match=message):
        read(write(**{lost: None, **further}), rover_of(GEOMETRY), "rut_slope")


def test_where_a_need_comes_from():
    assert effect_inputs.sources("yaw_rate") == ("yaw_rate",)
    assert effect_inputs.sources("yaw_rate_rate") == ("yaw_rate", "time")
    assert effect_inputs.sources("wheel_angle") == ("angular_velocity", "time")
    assert effect_inputs.sources("rut_slope") == ("sinkage", "velocity", "time")
    assert effect_inputs.sources("grouser_height") == ()
    assert effect_inputs.read([effect("slip_rate", any_of=("tether",), further=("wheel_angle",))]) == (
        {"slip", "time", "angular_velocity"}, {"tether"},
    )  # fmt: skip
