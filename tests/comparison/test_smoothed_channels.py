"""What a channel answers to, where it answers to nothing."""

import numpy as np
import pytest

from terrain_cli.comparison import smoothed_channels


@pytest.mark.parametrize("torque", [0.1, 0.3, 1.0, 7.7])
@pytest.mark.parametrize("slip", [0.0, 0.1, 0.3])
def test_a_constant_channel_answers_to_no_load(torque, slip):
    load = np.linspace(50.0, 150.0, 40)
    columns = {"load": load, "torque": np.full(40, torque), "slip": np.full(40, slip)}
    record = smoothed_channels.RecordedWheel(columns, np.zeros(40, dtype=np.intp), None)
    answered = smoothed_channels._answered(record, "torque", 1.0)
    assert answered == pytest.approx(0.0, abs=1e-9)
