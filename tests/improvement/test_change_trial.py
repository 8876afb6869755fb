"""What is said of a parameter beside its value, and estimates that another process makes meanwhile."""

from types import SimpleNamespace

import pytest
from changed_models import write_all

from terrain_cli import effects, models, rover, telemetry
from terrain_cli.comparison.blocks import Interval
from terrain_cli.estimation import estimators
from terrain_cli.improvement import change_trial
from terrain_cli.improvement.change_trial import remark, tried
from terrain_cli.windows import cut_windows


@pytest.mark.parametrize(
    ("effect", "name", "value", "determined", "told"),
    [
        ("wheel-radius", "relative_error", 0.207, True, "7 times its usual size"),
        ("wheel-radius", "relative_error", 0.05, True, ""),
        ("wheel-radius", "relative_error", 0.05, False, "left open by the data"),
        ("wheel-radius", "relative_error", 0.4, True, "at its bound"),
        # An error of 0.13 beside "left open by the data" would be a riddle.
        ("slip-sinkage", "bend", 2.0, False, "at its bound"),
    ],
)
def test_a_value_to_be_doubted_is_remarked(effect, name, value, determined, told):
    (own,) = (one for one in effects.catalogue()[effect].parameters if one.name == name)
    assert remark(own, value, determined=determined) == told


def test_a_heavy_wheel_has_more_friction():
    own = effects.catalogue()["drivetrain-friction"].parameters[0]
    assert remark(own, 39.0, determined=True) == "78 times its usual size"
    assert remark(own.under(2000.0, 0.4), 39.0, determined=True) == ""


def test_a_drafted_law_has_no_usual_size():
    """Its scale is a tenth of what was measured, for the search alone."""
    own = effects.catalogue()["drivetrain-friction"].parameters[0]
    assert remark(own, 39.0, determined=True, has_usual_size=False) == ""
    assert remark(own, 39.0, determined=False, has_usual_size=False) == "left open by the data"


def test_of_the_soil_only_what_the_data_leave_open_is_remarked():
    assert remark(None, 0.02, determined=True) == ""
    assert remark(None, 0.02, determined=False) == "left open by the data"


def test_another_process_estimates_the_segments_of_both_models(tmp_path, monkeypatch):
    write_all(tmp_path)
    (samples,) = telemetry.read(str(tmp_path / "sinks.csv"), rover.load(tmp_path / "rover.toml"), effects=[])
    before = models.resolve("wong-reece")
    after = models.added(before, ["slip-sinkage"], samples.geometry.shear_modulus).file
    estimate, made = estimators.estimate, []
    monkeypatch.setattr(
        estimators, "estimate", lambda *given, **options: made.append(1) or estimate(*given, **options)
    )
    change = [cut_windows.cut(samples, "none")], "add", ["slip-sinkage"], before, after
    elsewhere = tried(*change, beside=True)
    assert not made
    here = tried(*change)
    assert len(made) == 2
    assert elsewhere.shifts == here.shifts
    assert here.shifts[0].largest > 0.0


@pytest.mark.parametrize(
    ("action", "ratio", "enough"),
    [
        ("add", (0.994, 0.990, 0.999), True),  # Sure, and too little to count
        ("add", (0.9, 0.88, 0.92), False),
        ("remove", (1.006, 1.001, 1.010), True),
        ("remove", (1.1, 1.08, 1.12), False),
    ],
)
def test_what_hardly_gains_beside_several_soils_is_weighed_on_those_that_it_needs(
    action, ratio, enough, monkeypatch
):
    """Each model had the soils that it needs: two of them stood for the effect."""
    told = [None, SimpleNamespace(overall=Interval(*ratio))]
    monkeypatch.setattr(change_trial, "weigh", lambda *_: told)
    plain, soil = models.build("wong-reece"), SimpleNamespace(windows=[None])
    file = models.added(plain, ["multi-pass"], 0.02).file
    one = SimpleNamespace(wheels=[soil], soil_count=1)
    two = SimpleNamespace(wheels=[SimpleNamespace(windows=[None, None])], soil_count=2)
    parts = (two, one, one, plain, file) if action == "add" else (one, two, two, file, plain)
    windows, remarks = change_trial._needed_soils(action, *parts)
    assert windows == [soil.windows]
    what = "with multi-pass, 1 soil is enough; both models are compared on 1 soil"
    assert remarks == [what] * enough
