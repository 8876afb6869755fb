"""The valley of the full model: near the estimate as its errors say, far from it as a fit of its own says."""

from __future__ import annotations

import numpy as np
import pytest
from wheel_samples import WHEEL, free

from terrain_cli.estimation.wheel_fit import Noise, fit
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
TRUTH = free(2, 30, 3)
CHANNELS = TRUTH.measured(0, 0.0)
LOGARITHMIC = {"shear_modulus", "stiffness"}
#: Lines of the grid, of 41 from −4 to 4 standard errors.
LINES = [4, 12, 28, 36]


def run(channels, bounds, noise, **options):
    return fit(Model(), GEOMETRY, channels, bounds, noise=Noise.equal(noise), correlated=False, **options)


def spread(grid):
    weight = grid.probability
    c, tan_phi = np.broadcast_arrays(grid.cohesion, grid.tan_phi[:, None])
    return [np.sqrt(np.cov(axis.ravel(), aweights=weight.ravel(), ddof=0)) for axis in (c, tan_phi)]


def test_what_is_well_known_is_as_the_errors_say():
    found = run(CHANNELS, TRUTH.bounds, 0.02, joint=[1])
    assert list(found.grids) == [1]
    errors = [found.errors[name][1] for name in ("cohesion", "tan_phi")]
    np.testing.assert_allclose(spread(found.grids[1]), errors, rtol=0.02)


@pytest.mark.parametrize("window", [0, 1])
def test_the_valley_is_that_of_fits_with_c_and_phi_held(window):
    found = run(CHANNELS, TRUTH.bounds, 0.05, joint=[window])
    grid = found.grids[window]
    deviance = -2.0 * grid.log_density
    bottom = [(line, int(np.argmin(deviance[line]))) for line in LINES]
    points = [*bottom, np.unravel_index(np.argmin(deviance), deviance.shape)]
    samples = slice(*TRUTH.bounds[window : window + 2])
    n, repeat = len(CHANNELS["load"][samples]), len(points)
    held = {
        "cohesion": np.array([grid.cohesion[point] for point in points]),
        "tan_phi": np.array([grid.tan_phi[line] for line, _ in points]),
    }
    channels = {name: np.tile(column[samples], repeat) for name, column in CHANNELS.items()}
    fitted = run(channels, np.arange(repeat + 1) * n, 0.05, fixed=held)
    lost = fitted.chi2.copy()
    for name, (mean, sd) in found.priors.items():
        value = np.log(fitted.values[name]) if name in LOGARITHMIC else fitted.values[name]
        lost += ((value - mean) / sd) ** 2
    laid = np.array([deviance[point] for point in bottom])
    there = (lost - lost[-1])[:-1]
    np.testing.assert_allclose(laid, there, rtol=0.2)
    # Where the bottom lies, which the prior moves, does nothing to the sum of both sides.
    np.testing.assert_allclose(laid + laid[::-1], there + there[::-1], rtol=0.05)
    # It is steeper towards little friction than towards much: no ellipse.
    assert laid[0] > 1.15 * laid[-1]
    assert there[0] > 1.05 * there[-1]


def test_what_is_held_has_no_valley():
    assert run(CHANNELS, TRUTH.bounds, 0.02, joint=[0], fixed={"tan_phi": 0.6}).grids == {}


def test_what_all_windows_share_has_the_errors_of_the_fit():
    found = run(CHANNELS, TRUTH.bounds, 0.02, joint=[0], shared=["tan_phi"])
    np.testing.assert_allclose(
        spread(found.grids[0]), [found.errors[name][0] for name in ("cohesion", "tan_phi")], rtol=0.02
    )
