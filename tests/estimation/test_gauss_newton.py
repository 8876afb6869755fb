"""Steps of the search for the most probable unknowns."""

import numpy as np
import pytest

from terrain_cli.estimation.wheel_fit.gauss_newton import Normal, _unbounded, newton, without_wild
from terrain_cli.estimation.wheel_fit.unknowns import Unknown, Unknowns

FAR = 1e12


def unknown(name, *, lower=-FAR, step=FAR):
    return Unknown(name=name, logarithm=False, mean=0.0, sd=1.0, lower=lower, upper=FAR, step=step)


@pytest.mark.parametrize("bound", ["own", "shared"])
def test_the_others_step_as_if_what_is_held_were_fixed(bound):
    """Two windows of two unknowns each, and two that they share; one would leave its bound."""
    rng = np.random.default_rng(1)
    # What one tells of the others differs by six digits in size.
    root = rng.standard_normal((2, 4, 12)) + 1e3 * np.array([0.0, 1.0, 1.0, 1.0])[:, None]
    information, score = root @ np.swapaxes(root, 1, 2), 1e3 * rng.standard_normal((2, 4))
    sought = Unknowns(
        (unknown("a"), unknown("b", lower=0.0 if bound == "own" else -FAR)),
        (unknown("c"), unknown("d", lower=0.0 if bound == "shared" else -FAR)),
        {},
    )
    t, common = np.array([[0.1, 0.5], [-0.2, 0.4]]), np.array([0.3, 0.6])
    held = [1, 3] if bound == "own" else [5]
    at = np.concatenate([t.ravel(), common])
    whole, right = np.eye(6), -at
    for window, places in enumerate(([0, 1, 4, 5], [2, 3, 4, 5])):
        whole[np.ix_(places, places)] += information[window]
        right[places] += score[window]
    # Far beyond the bound.
    score[:, 1 if bound == "own" else 3] -= 1e9
    free = [place for place in range(6) if place not in held]
    expected = -at
    expected[free] = np.linalg.solve(
        whole[np.ix_(free, free)], right[free] + whole[np.ix_(free, held)] @ at[held]
    )
    step, shift, _ = newton(Normal(information, score, np.zeros(2)), sought, t, common)
    np.testing.assert_allclose(np.concatenate([step.ravel(), shift]), expected, rtol=1e-6, atol=1e-9)


def test_a_step_where_one_unknown_outweighs_the_others_by_all_digits():
    information = np.zeros((1, 3, 3))
    information[0, 1:, 1:] = 1e20
    normal = Normal(information, np.ones((1, 3)), np.zeros(1))
    step, shift, _ = _unbounded(normal, np.zeros((1, 1)), np.zeros(2))
    assert np.isfinite(step).all()
    assert np.abs(shift).max() < 1e-15


def test_a_window_beyond_all_numbers_goes_back_to_its_prior_and_stops_no_other():
    """Windows that share something go together: one that overflows would lead all of them astray."""
    information = np.stack([np.eye(3), np.full((3, 3), np.inf), 2.0 * np.eye(3)])
    score, t = np.ones((3, 3)), np.full((3, 2), 0.5)
    normal = Normal(information, score, np.array([1.0, np.inf, 1.0]))
    sought = Unknowns((unknown("a"), unknown("b")), (unknown("c"),), {})
    np.testing.assert_array_equal(without_wild(normal), [False, True, False])
    step, shift, _ = newton(normal, sought, t, np.zeros(1))
    np.testing.assert_allclose(step[1], -t[1])
    others = Normal(information[::2], score[::2], normal.misfit[::2])
    expected, expected_shift, _ = newton(others, sought, t[::2], np.zeros(1))
    np.testing.assert_allclose(step[::2], expected)
    np.testing.assert_allclose(shift, expected_shift)
