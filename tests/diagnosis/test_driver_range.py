"""How a driver is distributed, as far as drafted laws ask."""

import numpy as np
import pytest

from terrain_cli.diagnosis import driver_range


def test_a_driver_that_is_on_or_off_has_one_form():
    flag, both = np.repeat([0.0, 1.0, np.nan], 40), np.repeat([0.0, 1.0, 2.0], 40)
    assert driver_range.on_or_off(flag)
    assert not driver_range.on_or_off(both)
    assert not driver_range.on_or_off(np.zeros(40))


@pytest.mark.parametrize(
    ("low", "high", "typical"),
    [(0.153, 0.352, 0.25), (20.0, 58.6, 39.0), (-0.35, -0.15, -0.25), (-0.2, 0.3, 0.0), (0.0, 0.2, 0.1)],
)
def test_a_plain_number_stands_for_the_middle_unless_zero_lies_within(low, high, typical):
    assert driver_range.typical(np.linspace(low, high, 201)) == pytest.approx(typical, abs=1e-9)
