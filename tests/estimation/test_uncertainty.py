"""How the parts of an error add up."""

from __future__ import annotations

import numpy as np
import pytest
from drives import GEOMETRY, drive

from terrain_cli.estimation.line.least_squares import fit_line
from terrain_cli.estimation.line.moments import X, Y, of_windows
from terrain_cli.estimation.line.uncertainty import uncertainty
from terrain_cli.mechanics.linear import line_coordinates

AS_LEAST_SQUARES = np.eye(2)[:, :, None]


@pytest.fixture
def window():
    run = drive(1, 80, 1, kind="undulation", share=0.2, noises=0.02)
    x, y = line_coordinates(**run.channels, **GEOMETRY)
    moments = of_windows(np.array([x, y, *run.channels.values()]), run.bounds)
    return moments, fit_line(moments)


def test_least_squares_turns_about_its_mean_point(window):
    moments, line = window
    errors = uncertainty(moments, line, line.cohesion, line.tan_phi, AS_LEAST_SQUARES, correlated=True)
    assert errors.pivot[0] == pytest.approx(moments.mean[X, 0])
    assert errors.strength[0] == pytest.approx(moments.mean[Y, 0])
    tan_se = errors.phi * (1.0 + line.tan_phi**2)
    np.testing.assert_allclose(errors.cohesion, np.hypot(errors.strength_se, moments.mean[X] * tan_se))


def test_a_pull_off_the_mean_is_shown_and_counted(window):
    moments, line = window
    fair, pulled = (
        uncertainty(moments, line, line.cohesion + by, line.tan_phi, AS_LEAST_SQUARES, correlated=True)
        for by in (0.0, 300.0)
    )
    np.testing.assert_allclose(pulled.strength, fair.strength + 300.0)
    np.testing.assert_allclose(pulled.strength_se, np.hypot(fair.strength_se, 300.0))
    np.testing.assert_allclose(pulled.phi, fair.phi)


def test_a_slope_off_the_bounds_is_counted(window):
    moments, line = window
    fair, turned = (
        uncertainty(moments, line, line.cohesion, slope, AS_LEAST_SQUARES, correlated=True)
        for slope in (line.tan_phi, line.tan_phi - 0.3)
    )
    np.testing.assert_allclose(turned.phi_open, fair.phi_open)
    middle = 0.5 * (fair.phi_low + fair.phi_high)
    assert turned.phi[0] > (middle - np.arctan(line.tan_phi - 0.3))[0] > 3.0 * fair.phi_bias[0]
