"""What an effect leaves on held-out blocks, as `compare` has it."""

import numpy as np
import pytest
from hidden_drives import Kind, windows_of

from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import refits
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.mechanics.wheel_model import Model


@pytest.fixture(scope="module")
def wheel():
    (windows,) = windows_of(9_600_001, Kind(seconds=32.0), "none")
    return FittedWheel(windows, Model(), FitSettings({"shear_modulus": 0.018}, {}, (), None))


def test_a_right_model_leaves_the_noise_also_of_a_channel_of_which_no_level_is_known(wheel):
    block = np.arange(len(wheel)) * 8 // len(wheel)
    levels = {name: wheel.noise[name].deviation for name in ("torque", "drawbar_pull")}
    found = refits.held_out_errors([wheel], [block], levels)
    assert found.keys() == wheel.measured.keys() > levels.keys()
    for name, error in found.items():
        assert error == pytest.approx(wheel.noise[name].deviation, rel=0.1)
