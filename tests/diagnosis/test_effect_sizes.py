from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import Kind, Rover, sized, windows_of
from simulator import Wheel

from terrain_cli import effects
from terrain_cli.diagnosis import diagnose, effect_sizes, verdict
from terrain_cli.diagnosis.diagnosis_outcome import Size
from terrain_cli.models import ModelFile


def test_wheels_that_differ_by_more_than_their_errors_make_the_mean_less_sure():
    alike = [(0.31, 0.02), (0.29, 0.02), (0.30, 0.02), (0.30, 0.02)]
    assert effect_sizes.pooled(alike) == pytest.approx((0.30, 0.01))
    assert effect_sizes.pooled(alike[:1]) == pytest.approx((0.31, 0.02))
    mean, se = effect_sizes.pooled([(0.0, 0.002), (0.3, 0.002), (0.0, 0.002), (0.0, 0.002)])
    # The standard error of four numbers.
    assert (mean, se) == pytest.approx((0.075, np.std([0.0, 0.3, 0.0, 0.0], ddof=1) / 2.0))


def test_wheels_are_told_apart_where_their_errors_do_not_explain_the_difference():
    front, rear = effect_sizes.differing({"front": [(1.5, 0.05)], "rear": [(0.06, 0.06)]})
    assert (front[0], rear[0]) == ("front", "rear")
    assert (*front[1:], *rear[1:]) == pytest.approx((1.5, 0.05, 0.06, 0.06))
    assert effect_sizes.differing({"front": [(1.5, 0.05)], "rear": [(1.4, 0.06)]}) == []
    assert effect_sizes.differing({"front": [(1.5, 0.05)], "rear": []}) == []


def said(doubt="", **sizes):
    return verdict.sizes_text(SimpleNamespace(sizes=sizes, doubt=doubt), " = ")


def test_a_parameter_at_its_bound_is_marked_unless_the_whole_effect_is():
    sizes = {"loss": Size(0.51, 0.01, "1"), "length": Size(0.003, 0.0002, "m", bounded=True)}
    assert said(**sizes) == "loss = 0.51 ± 0.01, length = 0.003 ± 0.0002 m at its bound"
    assert said("physically impossible", **sizes) == "loss = 0.51 ± 0.01, length = 0.003 ± 0.0002 m"


def test_a_mean_that_no_wheel_has_is_not_told():
    each = (("front", 1.52, 0.046), ("rear", 0.056, 0.056))
    told = said(Tc=Size(0.878, 0.75, "N m", each), Bv=Size(-0.01, 0.037, "N m s/rad"))
    front_and_rear = "front 1.52 ± 0.046 and rear 0.056 ± 0.056 N m"
    assert told == f"Tc differs between wheels: {front_and_rear}, Bv = -0.01 ± 0.037 N m s/rad"


def test_parameters_that_the_data_leave_open_are_named():
    assert said(c1=Size(np.nan, np.nan, "1"), c2=Size(np.nan, np.nan, "1")) == "c1 and c2 not determined"
    assert said(c1=Size(0.4, 0.1, "1"), c2=Size(np.nan, np.nan, "1")) == "c1 = 0.4 ± 0.1"
    assert said() == ""


def test_the_friction_of_a_heavy_wheel_is_of_its_own_size():
    """A hundred times what is typical of a small rover: a bias of the drawbar pull used to stand for it."""
    rover = Rover(wheel=Wheel(radius=0.5, width=0.3), load=9000.0, speed=0.5)
    hidden = sized("drivetrain-friction", rover=rover)
    drive = windows_of(79_873_101, Kind(hidden, seconds=64.0, rover=rover))
    among = [effects.find(name) for name in ("drivetrain-friction", "drawbar-bias", "gear-efficiency")]
    found = diagnose(drive, ModelFile(), effects=among)
    assert (found.verdict, found.effect) == ("effect", "drivetrain-friction")
    dry = found.candidates[0].sizes["Tc"]
    assert (
        abs(dry.value - sized("drivetrain-friction", rover=rover)["drivetrain-friction"]["Tc"]) < 4.0 * dry.se
    )


@pytest.mark.parametrize(
    ("effect", "name", "size"),
    [
        ("drawbar-bias", "offset", 1200.0),
        ("drivetrain-friction", "Bv", 1300.0),
        ("acceleration-torque", "J", 2500.0),
    ],
)
def test_bounds_are_those_of_the_wheel(effect, name, size):
    """Of 40 kN on a radius of 0.9 m: no rover of 98 N has as much, and searches ended at its bounds."""
    rover = Rover(wheel=Wheel(radius=0.9, width=0.75), load=40_000.0, speed=0.5)
    drive = windows_of(79_882_501, Kind({effect: {name: size}}, seconds=64.0, rover=rover))
    among = [effects.find(other) for other in ("drivetrain-friction", "drawbar-bias", "acceleration-torque")]
    found = diagnose(drive, ModelFile(), effects=among)
    best = found.candidates[0]
    assert (best.effect, best.doubt) == (effect, "")
    assert abs(best.sizes[name].value - size) < 3.0 * best.sizes[name].se


@pytest.mark.parametrize(
    ("gain", "needs", "changes", "settles"),
    [
        (1.4, ("motor_temperature",), "torque", True),
        # What is left is as odd as before.
        (1.05, ("motor_temperature",), "torque", False),
        # A factor that is always the same may be that of a unit.
        (1.4, (), "torque", False),
        # A soil can be fitted to a wrong unit too.
        (1.4, ("slip",), "sinkage_exponent", False),
    ],
)
def test_only_an_effect_that_follows_something_settles_that_torque_and_pull_differ(
    monkeypatch, gain, needs, changes, settles
):
    """A warm motor shows too little torque, as if it were in pounds and feet."""
    rng = np.random.default_rng(5)
    load, rim = 80.0 + 20.0 * rng.random(800), 20.0 * rng.random(800)
    torque, pull = 0.125 * rim / 1.4, 0.95 * rim - 0.1 * load
    wheel = SimpleNamespace(
        measured={"torque": torque, "drawbar_pull": pull},
        predicted={"torque": torque, "drawbar_pull": pull},
        channels={"load": load},
        geometry=Wheel(radius=0.125, width=0.1),
    )
    without = {"torque": gain * torque, "drawbar_pull": pull}
    monkeypatch.setattr(effect_sizes, "_without", lambda *_: without)
    one = SimpleNamespace(effects=[SimpleNamespace(needs=needs, laws={changes: ""})])
    assert effect_sizes.settles_pull([wheel], one) is settles
