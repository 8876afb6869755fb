"""What is said of a parameter beside its value."""

import pytest

from terrain_cli import effects
from terrain_cli.comparison import Comparison
from terrain_cli.comparison.comparison_outcome import ChannelErrors, EffectScores
from terrain_cli.improvement.change_trial import as_compared, remark


@pytest.mark.parametrize(
    ("effect", "name", "value", "determined", "told"),
    [
        ("wheel-radius", "relative_error", 0.207, True, "7 times its usual size"),
        ("wheel-radius", "relative_error", 0.05, True, ""),
        ("wheel-radius", "relative_error", 0.05, False, "the data leave it open"),
        ("wheel-radius", "relative_error", 0.4, True, "at its bound"),
        # An error of 0.13 beside "the data leave it open" would be a riddle.
        ("slip-sinkage", "bend", 2.0, False, "at its bound"),
    ],
)
def test_a_value_to_be_doubted_is_remarked(effect, name, value, determined, told):
    (own,) = (one for one in effects.catalogue()[effect].parameters if one.name == name)
    assert remark(own, value, determined=determined) == told


def test_a_heavy_wheel_has_more_friction():
    own = effects.catalogue()["drivetrain-friction"].parameters[0]
    assert remark(own, 39.0, determined=True) == "78 times its usual size"
    assert remark(own, 39.0, determined=True, under=(2000.0, 0.4)) == ""


def test_of_the_soil_only_what_the_data_leave_open_is_remarked():
    assert remark(None, 0.02, determined=True) == ""
    assert remark(None, 0.02, determined=False) == "the data leave it open"


def test_what_fails_is_told_as_compare_finds_it_on_shorter_blocks():
    """On the long blocks of a model that misses, what the better one leaves passes for noise."""

    def compared(heldout, noise, *failures, raised):
        same = dict.fromkeys(("rmse", "nrmse", "heldout_low", "heldout_high"), heldout)
        errors = ChannelErrors(
            name="torque", unit="N m", n=100, bias=0.0, noise=noise, heldout_rmse=heldout, **same
        )
        scores = EffectScores(p_value=0.5, raised=raised)
        return Comparison(
            model={},
            wheels=[],
            channels={"torque": errors},
            failures=list(failures),
            warnings=[],
            scores=lambda: scores,
        )

    second = compared(0.12, 0.11, raised=False)
    found = as_compared(second, compared(0.115, 0.08, "it follows speed", raised=True))
    assert (found.channels["torque"].heldout_rmse, found.channels["torque"].noise) == (0.12, 0.08)
    assert found.failures == ["it follows speed"]
    assert found.scores().raised
