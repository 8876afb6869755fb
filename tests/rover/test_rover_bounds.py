"""Numbers of rover.toml: absurd ones are refused in one line, and those at the bounds do no harm."""

from __future__ import annotations

import pytest
from wheel_table import ROVER, good, text

from terrain_cli.errors import ConfigurationError
from terrain_cli.rover import load

ABSURD = ("1e300", "-1e300", "nan", "inf", "-inf", "1" + "0" * 400, '"1"', "true", "[1]")
VEHICLE = "[vehicle]\nmass = 10\ncentre_of_mass = [0, 0, 0]\n"
#: Table, line with {} for the number, what is refused besides `ABSURD`, and the least and greatest accepted.
KEYS = [
    (ROVER.replace("radius = 0.125", "radius = {}"), ("0", "-1", "1e-9", "1e9"), ("0.001", "5")),
    (ROVER.replace("width = 0.1\n", "width = {}\n"), ("0", "-1", "1e-9", "1e9"), ("0.001", "5")),
    (
        ROVER.replace("width = 0.1\n", "width = 0.1\ngrouser_count = {}\n"),
        ("-1", "1.5", "1000000000"),
        ("0", "1000"),
    ),
    (ROVER.replace("width = 0.1\n", "width = 0.1\ngrouser_height = {}\n"), ("-1", "1e9"), ("0", "1")),
    (ROVER.replace("0.018", "{}"), ("0", "-1", "1e-9", "1e9"), ("0.0001", "1")),
    (
        ROVER + '[channels]\ntorque = {{ column = "torque", unit = "N m", scale = {} }}\n',
        ("0", "1e-300", "1e16"),
        ("-1e15", "1e-15", "1e15"),
    ),
    (
        ROVER + '[channels]\ntorque = {{ column = "torque", unit = "N m", offset = {} }}\n',
        ("1e21",),
        ("-1e20", "1e20"),
    ),
    (
        ROVER + '[channels]\nload = {{ constant = {}, unit = "kN" }}\n',
        ("1e21",),
        ("-1e20", "0", "1e20"),
    ),
    (ROVER + "[noise]\ntorque = {{ relative = {} }}\n", ("-0.1", "1.1", "1e9"), ("0", "1")),
    (ROVER + '[noise]\nload = {{ absolute = {}, unit = "N" }}\n', ("-1", "1e21"), ("0", "1e20")),
    (ROVER + "[motor]\ntorque_constant = {}\n", ("0", "-1", "1e9"), ("1e-6", "1e4")),
    (ROVER + "[motor]\ntorque_constant = 1\ngear_ratio = {}\n", ("0", "-1", "1e9"), ("1e-4", "1e6")),
    (ROVER + "[motor]\ntorque_constant = 1\nefficiency = {}\n", ("0", "-1", "1e9"), ("0.001", "1")),
    (
        ROVER + "[motor]\ntorque_constant = 1\nreference_temperature = {}\n",
        ("-274", "1e9"),
        ("-273.15", "1000"),
    ),
    (ROVER + "[motor]\ntorque_constant = 1\nno_load_current = {}\n", ("-1", "1e9"), ("0", "1e4")),
    (ROVER + VEHICLE.replace("10", "{}"), ("0", "-1", "1e9"), ("0.001", "1e8")),
    (ROVER + VEHICLE + "gravity = {}\n", ("0", "-1", "1e9"), ("1e-6", "100")),
    (ROVER + VEHICLE.replace("[0, 0", "[{}, 0"), ("501", "1e9"), ("-500", "500")),
    (ROVER + "[sampling]\nmax_gap = {}\n", ("0", "-1", "1e-9", "1e10"), ("1e-6", "1e9")),
    (ROVER + "[estimate]\nmin-samples = {}\n", ("2", "-1", "3.5", "1" + "0" * 13), ("3", "1000000000000")),
    (ROVER + "[estimate]\nwindow-distance = {}\n", ("0", "-1", "1e9"), ("1e-6", "4e7")),
]


@pytest.fixture
def run(tmp_path, terrain_est_here):
    (tmp_path / "t.csv").write_text(text(good()))

    def run(rover, *options):
        (tmp_path / "rover.toml").write_text(rover)
        return terrain_est_here("estimate", "t.csv", *options, cwd=tmp_path)

    return run


@pytest.mark.parametrize(("rover", "refused", "_"), KEYS, ids=range(len(KEYS)))
def test_absurd_numbers_are_refused_in_one_line(run, rover, refused, _):
    for number in (*refused, *ABSURD):
        done = run(rover.format(number))
        assert done.returncode == 78, (number, done.stderr)
        said = done.stderr.splitlines()
        assert said[0].startswith("terrain-est: rover.toml: "), number
        assert len(said) == 1, number
        assert len(said[0]) < 250, number


@pytest.mark.parametrize(("rover", "_", "ends"), KEYS, ids=range(len(KEYS)))
def test_numbers_at_the_bounds_do_no_harm(run, rover, _, ends):
    for number in ends:
        for options in (("recursive",), ("least-squares",), ("ridge", "--segments", "none")):
            done = run(rover.format(number), "--method", *options)
            assert done.returncode in (0, 65), (number, done.stderr)
            assert "Warning" not in done.stderr


def test_the_whole_model_at_the_bounds(run, tmp_path):
    (tmp_path / "t.csv").write_text(text(good()[:40]))
    done = run(ROVER.replace("radius = 0.125", "radius = 5"), "--method", "wong-reece", "--segments", "none")
    assert done.returncode in (0, 65), done.stderr


def test_the_sizes_of_a_wheel_may_be_given_with_their_errors(tmp_path):
    path = tmp_path / "rover.toml"
    path.write_text(
        "[wheel]\nradius = { value = 0.125, error = 0.002 }\nwidth = 0.1\n"
        "[wheels.front]\nwidth = { value = 0.09, error = 0.004 }\n[wheels.rear]\nradius = 0.13\n"
    )
    front, rear = (load(path).wheel(name) for name in ("front", "rear"))
    assert (front.radius, front.radius_error, front.width, front.width_error) == (0.125, 0.002, 0.09, 0.004)
    # What is said of one wheel replaces all that is said of every wheel.
    assert (rear.radius, rear.radius_error, rear.width, rear.width_error) == (0.13, 0.0, 0.1, 0.0)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("{ value = 0.125 }", "wheel.radius: error is missing"),
        ("{ error = 0.002 }", "wheel.radius: value is missing"),
        (
            "{ value = 0, error = 0.002 }",
            "wheel.radius.value: must be a positive length in m, from 0.001 to 5, not 0",
        ),
        ("{ value = 0.125, error = -1 }", "wheel.radius.error: must be a length in m, from 0 to 1, not -1"),
        (
            "{ value = 0.125, error = 0.1 }",
            "wheel.radius.error: must be at most 20% of the value, 0.025 m, not 0.1 m",
        ),
        ("{ value = 0.125, errors = 0.1 }", "wheel.radius.errors: unknown key"),
    ],
)
def test_a_size_with_an_error_that_makes_no_sense_is_refused(tmp_path, wrong, said):
    path = tmp_path / "rover.toml"
    path.write_text(f"[wheel]\nradius = {wrong}\nwidth = 0.1\n")
    with pytest.raises(ConfigurationError) as error:
        load(path)
    assert said in str(error.value)
