"""A series that is shown late: against step-by-step integration, in any order and in any part."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from terrain_cli.mechanics.dual import seed, slopes, value
from terrain_cli.mechanics.past import along

RNG = np.random.default_rng(3)
STRETCH = np.repeat([4, 7], [220, 180])
#: Steps that are not even, and a clock that does not go on where the second stretch begins.
TIME = np.concatenate([np.cumsum(RNG.uniform(0.02, 0.08, n)) + at for n, at in ((220, 50.0), (180, 10.0))])
TRUE = RNG.normal(size=400)
SPEED = RNG.uniform(0.05, 0.15, 400)


def curve(clock, true):
    """Return the cubic through all samples whose slope is that of the parabola through the neighbours."""
    return CubicHermiteSpline(clock, true, np.gradient(true, clock))


def delayed(clock, true, delay):
    return curve(clock, true)(np.clip(clock - delay, clock[0], clock[-1]))


def filtered(clock, true, constant):
    """Solve constant · dy/dt = true − y, in small steps on which that is straight."""
    many = 200
    fine = np.append(
        np.repeat(clock[:-1], many) + np.outer(np.diff(clock), np.arange(many) / many).ravel(), clock[-1]
    )
    x = curve(clock, true)(fine)
    step = np.diff(fine)
    kept = np.exp(-step / constant)
    y = [x[0]]
    for keep, slope, before, after in zip(kept, np.diff(x) / step, x[:-1], x[1:], strict=True):
        # A solution is y = x − constant · slope; what is off it decays.
        y.append(after - constant * slope + (y[-1] - before + constant * slope) * keep)
    return np.array(y)[::many]


def each(function):
    """Apply a function of clock and true to each stretch."""
    return np.concatenate([function(TIME[k == STRETCH], TRUE[k == STRETCH]) for k in (4, 7)])


def past(velocity=SPEED, true=TRUE):
    return along(TIME, STRETCH, velocity, {"torque": true})["torque_past"]


@pytest.mark.parametrize("constant", [0.004, 0.3, 2.5])
def test_a_filter(constant):
    shown = each(lambda clock, true: filtered(clock, true, constant))
    np.testing.assert_allclose(
        past().change(0.0, constant), shown - TRUE, atol=1e-4 if constant < 0.01 else 1e-5
    )
    ahead = each(lambda clock, true: filtered(clock[-1] - clock[::-1], true[::-1], constant)[::-1])
    np.testing.assert_allclose(
        past().change(0.0, -constant), ahead - TRUE, atol=1e-4 if constant < 0.01 else 1e-5
    )


@pytest.mark.parametrize("delay", [0.013, 0.37, -0.2])
def test_a_delay_ends_with_its_stretch(delay):
    shown = each(lambda clock, true: delayed(clock, true, delay))
    np.testing.assert_allclose(past().change(delay, 0.0), shown - TRUE, atol=1e-12)


def test_a_delay_and_then_a_filter():
    shown = each(lambda clock, true: filtered(clock, delayed(clock, true, 0.1), 0.2))
    np.testing.assert_allclose(past().change(0.1, 0.2), shown - TRUE, atol=1e-5)


def test_over_the_way_whatever_the_speed():
    slow = past(np.full(400, 0.1))
    np.testing.assert_allclose(slow.change(0.0, 0.03, "way"), slow.change(0.0, 0.3), atol=1e-12)
    assert np.max(np.abs(past().change(0.0, 0.03, "way") - slow.change(0.0, 0.3))) > 0.05
    standing = past(np.zeros(400)).change(0.0, 0.03, "way") + TRUE
    np.testing.assert_allclose(standing, TRUE[np.where(STRETCH == 4, 0, 220)])
    assert past(None).change(0.0, 0.03, "way") == 0.0


@pytest.mark.parametrize(("delay", "constant"), [(0.33, 0.0), (0.0, 0.3), (0.11, 0.2), (-0.15, -0.25)])
def test_derivatives(delay, constant):
    series, step = past(), 1e-6
    found = slopes(series.change(seed(delay, "delay"), seed(constant, "constant")))
    by_delay = series.change(delay + step, constant) - series.change(delay - step, constant)
    # Where a delay ends at a sample the series has a corner.
    off = found["delay"] - by_delay / (2.0 * step)
    assert np.sqrt(np.mean(off**2)) < 0.05 * np.sqrt(np.mean(found["delay"] ** 2))
    if constant:
        by_constant = series.change(delay, constant + step) - series.change(delay, constant - step)
        np.testing.assert_allclose(found["constant"], by_constant / (2.0 * step), rtol=1e-4, atol=1e-4)


def test_where_nothing_is_late_the_derivative_is_the_rate():
    smooth = past(true=np.sin(TIME))
    found = smooth.change(seed(0.0, "delay"), seed(0.0, "constant"))
    inner = np.r_[1:219, 221:399]
    for slope in slopes(found).values():
        np.testing.assert_allclose(slope[inner], -np.cos(TIME[inner]), atol=0.05)
    np.testing.assert_array_equal(found.value, 0.0)


def test_some_samples_in_another_order_and_lags_of_their_own():
    order = RNG.permutation(400)
    mixed = along(TIME[order], STRETCH[order], SPEED[order], {"torque": TRUE[order]})["torque_past"]
    np.testing.assert_allclose(mixed.change(0.1, 0.2), past().change(0.1, 0.2)[order], atol=1e-12)
    some = past()[::3][5:]
    np.testing.assert_array_equal(some.change(0.1, 0.2), past().change(0.1, 0.2)[::3][5:])
    lags = np.where(np.arange(400) < 100, 0.1, 0.3)
    both = np.where(lags < 0.2, past().change(0.0, 0.1), past().change(0.0, 0.3))
    np.testing.assert_array_equal(past().change(0.0, lags), both)


def test_what_is_not_predicted_is_taken_from_its_neighbours():
    holes = np.where(np.arange(400) % 50 == 30, np.nan, np.sin(TIME))
    whole = past(true=np.sin(TIME)).change(0.0, 0.3)
    known = np.isfinite(holes)
    np.testing.assert_allclose(past(true=holes).change(0.0, 0.3)[known], whole[known], atol=2e-3)
    assert np.all(past(true=np.full(400, np.nan)).change(0.1, 0.3) == 0.0)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_lag_beyond_all_numbers_shows_nothing_and_takes_no_time(number):
    late = past()
    for lag in (number, seed(number, "lag"), np.full(len(TIME), number)):
        assert np.isnan(value(late.change(0.0, lag))).all()
    # NaN is no other NaN: each sample once had a series of its own.
    assert not late.series.kept
    assert not late.series.reach
