"""Windows of one line: found where the soil changes, and joined where a driver explains the change."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples
from soil_drives import Kind, clean, drive, mixed

from terrain_cli.windows import change_points as cuts
from terrain_cli.windows.change_points import PENALTY, Means, change_points, needed

CALM = ("dry sand", "upland sandy loam", "clayey soil", "wet clayey soil")
N = 3000
NONE = np.array([], dtype=np.intp)


def changes_of(one, **options):
    return change_points(one.x, one.y, distance=one.distance, **options)


@pytest.mark.parametrize("model", ["linear", "wong-reece"])
@pytest.mark.parametrize(
    ("load", "slip"),
    [("constant", "constant"), ("steps", "constant"), ("waves", "waves"), ("white", "waves")],
)
def test_one_soil_is_one_window(model, load, slip):
    """No more than 1 run in 100 may split; these 30 have none."""
    kind = Kind(load, slip, model)
    assert [len(changes_of(clean(seed, kind))) for seed in range(30)] == [2] * 30


@pytest.mark.parametrize(
    "kind",
    [
        Kind("steps", share=0.10),
        Kind("steps", "constant", noise="correlated"),
        Kind("waves", noise="interpolated"),
        Kind("steps", "constant", rolling=0.03),
        Kind("waves", shear_modulus=0.012),
        Kind("steps", "constant", shear_modulus=0.027),
    ],
    ids=["10 %", "correlated", "interpolated", "rolling", "k too small", "k too large"],
)
def test_neither_poor_sensors_nor_a_wrong_k_split_a_soil(kind):
    assert sum(len(changes_of(clean(seed, kind, longest=2000))) > 2 for seed in range(20)) == 0


@pytest.mark.parametrize("load", ["waves", "white"])
def test_changes_of_soil_are_found(load):
    hits, changes, false, bounds = sum(
        one.score(changes_of(one)) for one in (mixed(s, Kind(load)) for s in range(25))
    )
    assert changes > 80
    assert hits >= 0.95 * changes
    assert false <= 0.05 * bounds


def test_changes_are_found_to_the_sample():
    rng = np.random.default_rng(0)
    one = drive(rng, Kind(), ["dry sand", "clayey soil", "upland sandy loam"], [511, 433, 287], 20)
    np.testing.assert_allclose(changes_of(one), [0, 511, 944, 1231], atol=2)


def test_constant_load_and_slip_break_nothing():
    """Every window is a cloud that determines no line, and the change is found all the same."""
    rng = np.random.default_rng(1)
    one = drive(rng, Kind("constant", "constant"), ["upland sandy loam", "wet clayey soil"], [400, 400], 20)
    np.testing.assert_allclose(changes_of(one), [0, 400, 800], atol=2)


def test_constant_x_breaks_nothing():
    y = 7e3 * (1.0 + 0.03 * np.random.default_rng(2).standard_normal(600))
    assert change_points(np.full(600, 1e4), y).tolist() == [0, 600]
    y[250:] *= 1.2
    np.testing.assert_allclose(change_points(np.full(600, 1e4), y), [0, 250, 600], atol=2)


@pytest.mark.parametrize("value", [0.0, 1e4])
def test_samples_that_never_change_are_one_window(value):
    assert change_points(np.full(100, value), np.full(100, value)).tolist() == [0, 100]


def test_without_noise_every_change_is_exact_and_a_sweep_is_none():
    x = np.linspace(6e3, 1.6e4, 500)
    one = 1000.0 + 0.55 * x
    assert change_points(x, one).tolist() == [0, 500]
    assert change_points(x, np.where(np.arange(500) < 222, one, one + 1500.0)).tolist() == [0, 222, 500]


def test_wild_samples_are_no_soil():
    for seed in range(10):
        one = clean(seed, Kind("steps", "constant"))
        rng = np.random.default_rng(seed)
        wild = rng.random(len(one.x)) < 0.01
        x, y = np.where(wild, 3.0 * one.x, one.x), np.where(wild, 0.3 * one.y, one.y)
        assert change_points(x, y, distance=one.distance).tolist() == [0, len(x)]


@examples(30)
@given(st.integers(0, 50), st.lists(st.integers(0, 600), max_size=3))
def test_what_lies_between_breaks_is_searched_by_itself(seed, breaks):
    one = mixed(seed, Kind())
    x, y, distance = one.x[:600], one.y[:600], one.distance[:600]
    n = len(x)
    breaks = [b for b in breaks if b <= n]
    bounds = change_points(x, y, breaks=breaks, distance=distance)
    parts = sorted({0, n, *breaks})
    alone = [0]
    for a, b in pairwise(parts):
        alone += (a + change_points(x[a:b], y[a:b], distance=distance[a:b])[1:]).tolist()
    assert bounds.tolist() == alone
    assert set(breaks) <= set(bounds.tolist())


@examples(30)
@given(st.integers(0, 50), st.integers(1, 120), st.floats(0.0, 1.0))
def test_no_window_is_too_short(seed, least, metres):
    one = mixed(seed, Kind(load="white"))
    n = len(one.x)
    bounds = changes_of(one, min_samples=least, min_distance=metres)
    assert bounds.dtype == np.intp
    assert bounds[0] == 0
    assert bounds[-1] == n
    if len(bounds) > 2:
        assert np.diff(bounds).min() >= least
        driven = np.append(one.distance, one.distance[-1])[bounds]
        assert np.diff(driven).min() >= metres - 1e-9


def test_a_stretch_shorter_than_the_least_window_is_one():
    one = mixed(0, Kind())
    bounds = change_points(one.x, one.y, breaks=[7, 12], min_samples=50)
    assert bounds[:3].tolist() == [0, 7, 12]
    assert change_points([1.0], [1.0]).tolist() == [0, 1]
    assert change_points([], []).tolist() == [0]


@examples(10)
@given(st.integers(0, 50), st.integers(-20, 20))
def test_the_unit_does_not_matter(seed, power):
    one = mixed(seed, Kind())
    scale = 2.0**power
    np.testing.assert_array_equal(change_points(scale * one.x, scale * one.y), change_points(one.x, one.y))


def test_the_same_data_give_the_same_windows_and_stay_as_they_are():
    one = mixed(3, Kind())
    x, y = one.x.copy(), one.y.copy()
    x.flags.writeable = y.flags.writeable = False
    first = change_points(x, y)
    np.testing.assert_array_equal(first, change_points(list(one.x), list(one.y)))
    np.testing.assert_array_equal(x, one.x)


def test_a_higher_penalty_keeps_the_plainest_changes_only():
    one = mixed(5, Kind())
    counts = [len(changes_of(one, penalty=penalty)) for penalty in (5.0, 25.0, 1e3, 1e7)]
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 2


def test_a_long_drive_over_many_soils():
    rng = np.random.default_rng(6)
    one = drive(rng, Kind(), np.resize(CALM, 100), [1000] * 100, 50)
    hits, changes, false, _ = one.score(changes_of(one))
    assert hits >= 0.95 * changes
    assert false == 0


@pytest.mark.parametrize(
    ("x", "y", "options", "says"),
    [
        ([1.0, 2.0], [1.0, 2.0], {"min_samples": 0}, "positive"),
        ([1.0, 2.0], [1.0, 2.0], {"min_distance": -1.0}, "positive"),
        ([1.0, 2.0], [1.0, 2.0], {"penalty": 0.0}, "positive"),
    ],
)
def test_what_makes_no_sense_is_refused(x, y, options, says):
    with pytest.raises(ValueError, match=says):
        change_points(x, y, **options)


def driven(seed, *, follows=0.0, soils=1, noise=150.0):
    """Return x, y and slip; y rises with slip squared, and two soils may take turns every 500 samples."""
    rng = np.random.default_rng(seed)
    time = np.arange(N)
    slip = 0.3 + 0.2 * np.sin(2.0 * np.pi * time / 390.0)
    x = 8e3 + 2e3 * np.sin(2.0 * np.pi * time / 170.0 + 1.0)
    second = (time // 500 % 2 == 1) & (soils == 2)
    cohesion, tan_phi = np.where(second, 3000.0, 1000.0), np.where(second, 0.5, 0.6)
    y = cohesion + x * tan_phi + follows * slip**2 + noise * rng.standard_normal(N)
    return x, y, slip


@pytest.mark.parametrize("seed", range(5))
def test_one_soil_whose_line_follows_slip_is_one(seed):
    x, y, slip = driven(seed, follows=8000.0)
    found = change_points(x, y)
    assert len(found) > 8
    assert needed(x, y, [slip], found, NONE).tolist() == [0, N]


@pytest.mark.parametrize("seed", range(5))
def test_true_changes_stay(seed):
    x, y, slip = driven(seed, follows=5000.0, soils=2)
    found = change_points(x, y)
    assert len(found) > 8
    left = needed(x, y, [np.sqrt(slip), slip], found, NONE)
    assert len(left) <= 8
    known = [true for true in range(500, N, 500) if np.abs(found - true).min() <= 40]
    assert len(known) >= 3
    assert all(np.abs(left - true).min() <= 40 for true in known)


@pytest.mark.parametrize("seed", range(5))
def test_a_driver_may_do_another_thing_on_each_soil(seed):
    x, y, slip = driven(seed, soils=2)
    y = y + np.where(np.arange(N) // 500 % 2 == 1, 16e3, 4e3) * slip**2
    found = change_points(x, y)
    assert len(found) > 9
    left = needed(x, y, [slip], found, NONE)
    assert len(left) == 7
    assert np.abs(left[1:-1] - np.arange(500, N, 500)).max() <= 40


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("soils", [1, 2])
def test_means_of_neighbours_tell_as_much(monkeypatch, seed, soils):
    x, y, slip = driven(seed, follows=5000.0, soils=soils)
    found = change_points(x, y)
    monkeypatch.setattr(cuts, "_ENOUGH", N // 6)
    means = Means(found)
    assert (means.step, means.of(np.stack([x, y])).shape) == (6, (2, len(means.edges) - 1))
    assert means.of(x)[:2] == pytest.approx([x[:6].mean(), x[6:12].mean()])
    places = needed(*map(means.of, (x, y)), [means.of(slip)], means.places(found), NONE)
    np.testing.assert_array_equal(means.edges[places], needed(x, y, [slip], found, NONE))
    few = Means(np.array([0, 9, N // 6]))
    assert few.of(x) is x
    np.testing.assert_array_equal(few.edges, np.arange(N // 6 + 1))


def test_what_nothing_explains_stays():
    x, y, slip = driven(7, soils=2)
    found = change_points(x, y)
    assert len(found) == 7
    unknown, still = np.full(N, np.nan), np.ones(N)
    np.testing.assert_array_equal(needed(x, y, [slip, unknown, still], found, NONE), found)


@pytest.mark.parametrize("seed", range(5))
def test_one_cut_that_is_explained_better_goes(seed):
    x, y, slip = driven(seed, follows=8000.0)
    assert needed(x, y, [slip], np.array([0, 1100, N]), NONE).tolist() == [0, N]


def test_breaks_stay():
    x, y, slip = driven(3, follows=8000.0)
    breaks = np.array([1200])
    found = change_points(x, y, breaks=breaks)
    assert needed(x, y, [slip], found, breaks).tolist() == [0, 1200, N]


def test_a_constant_load_is_no_trouble():
    _, y, slip = driven(3, follows=8000.0)
    found = np.array([0, 1000, 2000, N])
    np.testing.assert_array_equal(needed(np.full(N, 8e3), y, [slip], found, NONE), found)
    x = np.repeat([7e3, 8e3, 9e3], 1000)
    assert needed(x, 1e3 + 0.5 * x + 8e3 * slip**2, [slip], found, NONE)[-1] == N


def test_each_bound_that_stays_pays_in_a_dense_solution():
    x, y, slip = driven(5, follows=20_000.0, soils=2)
    found = change_points(x, y)
    left = needed(x, y, [slip], found, NONE)
    assert 2 < len(left) < len(found)

    def sum_of_squares(bounds):
        scaled, d = (x - x.mean()) / x.std(), (slip - slip.mean()) / slip.std()
        inside = [(np.arange(N) >= a) & (np.arange(N) < b) for a, b in pairwise(bounds)]
        columns = [part * one for part in inside for one in (np.ones(N), scaled)]
        columns += [d, d**2, d * scaled]
        return np.linalg.lstsq(np.column_stack(columns), y, rcond=None)[1][0]

    variance = sum_of_squares(found) / N
    for place in range(1, len(left) - 1):
        gain = sum_of_squares(np.delete(left, place)) - sum_of_squares(left)
        assert gain / variance > 0.9 * PENALTY


@pytest.mark.parametrize("turns", [0.25, 1.5, 3.0, 12.0])
@pytest.mark.parametrize("soils", [1, 2])
def test_one_soil_whose_line_follows_the_turn_of_the_wheel_is_one(turns, soils):
    """Two soils stay two however often the wheel turns meanwhile."""
    x, y, _ = driven(4, soils=soils)
    angle = 2.0 * np.pi * turns * np.arange(N) / N + 1.0
    turn = np.stack([np.sin(angle), np.cos(angle)])
    found = change_points(x, y + 1500.0 * turn[0])
    left = needed(x, y + 1500.0 * turn[0], [turn], found, NONE)
    true = np.arange(500, N, 500) if soils == 2 else np.array([])
    known = [place for place in true if np.abs(found - place).min() <= 40]
    assert len(known) >= 0.8 * len(true)
    assert all(np.abs(left - place).min() <= 40 for place in known)
    if soils == 1:
        assert left.tolist() == [0, N]
        assert turns < 3.0 or len(found) > 8
