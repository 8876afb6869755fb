"""What a diagnosis says of the soil that its base was fitted with."""

from types import SimpleNamespace

import numpy as np
import pytest

from terrain_cli.diagnosis.diagnosed_log import impossible_soil


class Fit(SimpleNamespace):
    def __len__(self):
        return len(self.values["cohesion"])


def wheel(c, error, bounded=(False, False)):
    fit = Fit(
        values={"cohesion": np.array(c)},
        errors={"cohesion": np.array(error)},
        bounded={"tan_phi": np.array(bounded)},
    )
    return SimpleNamespace(fit=fit, windows=SimpleNamespace(samples=SimpleNamespace(wheel="fl")))


def test_a_cohesion_below_zero_by_more_than_its_error_is_said():
    told = impossible_soil(wheel([800.0, -9600.0], [100.0, 400.0]))
    assert told.startswith("wheel fl: 1 of 2 fitted soils cannot exist:")
    assert "its cohesion is −9.6 ± 0.4 kPa" in told
    assert "An effect is missing, or a channel has an offset or a wrong unit" in told


@pytest.mark.parametrize("c", [[800.0, -300.0], [800.0, np.nan]])
def test_noise_is_no_impossible_soil(c):
    assert impossible_soil(wheel(c, [100.0, 400.0])) == ""


def test_a_friction_angle_at_its_bound_is_said_too():
    told = impossible_soil(wheel([800.0, 700.0], [100.0, 400.0], (True, True)))
    assert "2 of 2 fitted soils cannot exist: its friction angle runs to the end of what soils have" in told
