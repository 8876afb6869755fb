"""What is said of a parameter beside its value, and estimates that another process makes meanwhile."""

import pytest
from changed_models import write_all

from terrain_cli import effects, models, rover, telemetry
from terrain_cli.estimation import estimators
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
