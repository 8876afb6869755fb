"""Changes of soil that show in the sinkage alone."""

from __future__ import annotations

import numpy as np
import pytest

from terrain_cli.windows import online_cuts
from terrain_cli.windows.online_cuts import OnlineCuts
from terrain_cli.windows.sinkage_changes import placed, sinkage_changes

N, RATE = 3000, 20.0
HALF = N // 2
LIMITS = {"distance": None, "min_samples": 10, "min_distance": 0.1}
WHOLE = np.array([0, N])


def drive(seed, *, stiffer=1.0, digging=0.0, steps=False):
    """Return load, sinkage and slip; the second half of the soil is so many times stiffer."""
    rng = np.random.default_rng(seed)
    time = np.arange(N) / RATE
    load = np.where(time % 24.0 < 12.0, 70.0, 95.0) if steps else 80.0 * (1.0 + 0.2 * np.sin(time / 3.0))
    slip = 0.3 + 0.25 * np.sin(time / 7.0 + seed)
    stiffness = np.where(np.arange(N) < HALF, 1.0, stiffer)
    sinkage = 0.02 * (load / 80.0 / stiffness) ** 0.7 * (1.0 + digging * slip)
    noise = 1.0 + 0.03 * rng.normal(size=(3, N))
    return tuple(column * own for column, own in zip((load, sinkage, slip), noise, strict=True))


def cut(load, sinkage, slip, bounds=WHOLE, drivers=(), **limits):
    return sinkage_changes(load, sinkage, slip, drivers, bounds, **LIMITS | limits)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("steps", [False, True])
def test_a_stiffer_soil_is_another(seed, steps):
    _, found, _ = cut(*drive(seed, stiffer=2.0, steps=steps))
    assert found == pytest.approx(HALF, abs=RATE)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("steps", [False, True])
def test_load_and_slip_are_no_soil(seed, steps):
    load, sinkage, slip = drive(seed, digging=2.0, steps=steps)
    assert cut(load, sinkage, slip, drivers=[slip]).tolist() == WHOLE.tolist()


def test_uneven_ground_is_hardly_a_soil():
    """Four waves of the ground: were a soil as short as a window may be, eight changes."""
    load, sinkage, slip = drive(0)
    driven = 0.0005 * np.arange(N)
    uneven = sinkage * (1.0 + 0.42 * np.sin(2.0 * np.pi * driven / 0.35))
    assert len(cut(load, uneven, slip, distance=driven)) <= len(WHOLE) + 1


def test_a_soil_hardly_stiffer_is_the_same():
    assert cut(*drive(0, stiffer=1.1)).tolist() == WHOLE.tolist()


def test_what_is_cut_already_stays_so():
    bounds = np.array([0, 1000, HALF, N])
    assert cut(*drive(0, stiffer=2.0), bounds=bounds).tolist() == bounds.tolist()


@pytest.mark.parametrize("place", range(3))
def test_nothing_is_cut_where_something_is_not_known(place):
    columns = drive(0, stiffer=2.0)
    columns[place][7] = np.nan
    assert cut(*columns).tolist() == WHOLE.tolist()


def test_a_sinkage_that_is_a_constant_tells_nothing():
    load, _, slip = drive(0)
    assert cut(load, np.full(N, 0.02), slip).tolist() == WHOLE.tolist()


def test_as_samples_arrive():
    """One line of strength all along: only the sinkage shows the change."""
    load, sinkage, slip = drive(1, stiffer=2.0)
    x = 100.0 * load
    y = (1e3 + 0.6 * x) * (1.0 + 0.02 * np.random.default_rng(2).normal(size=N))
    columns = np.array([np.arange(N), np.arange(N) / RATE, x, y, np.full(N, np.nan), load, sinkage, slip])
    cuts, found = OnlineCuts(), []
    for first in range(0, N, 50):
        found += cuts.add(columns[:, first : first + 50])
    (bound,) = [*found, *cuts.end()]
    assert bound == pytest.approx(HALF, abs=RATE)
    assert len(found) == 1
    columns[online_cuts.SINKAGE] = np.nan
    cuts = OnlineCuts()
    assert [*cuts.add(columns), *cuts.end()] == []


def lines(seed, load, cohesion):
    """Return x and y of soils of some cohesion, one for each half."""
    noise = np.random.default_rng(seed).normal(size=(2, N))
    x = 100.0 * load * (1.0 + 0.03 * noise[0])
    return x, np.where(np.arange(N) < HALF, *cohesion) + 0.6 * 100.0 * load * (1.0 + 0.1 * noise[1])


def place(bounds, seed, *, cohesion=(500.0, 900.0), fixed=(), stiffer=2.0, digging=0.0, **limits):
    load, sinkage, slip = drive(seed, stiffer=stiffer, digging=digging)
    line = lines(seed, load, cohesion)
    bounds, fixed = (np.array(places, dtype=np.intp) for places in (bounds, fixed))
    return placed(line, (load, sinkage, slip), bounds, fixed, **LIMITS | limits).tolist()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("off", [-90, 12, 75])
def test_a_bound_moves_to_where_the_wheel_begins_to_sink_otherwise(seed, off):
    begun, found, end = place([0, HALF + off, N], seed)
    assert (begun, end) == (0, N)
    assert found == pytest.approx(HALF, abs=1)


def test_what_is_given_stays():
    """A break of the log is no place that the soil chose."""
    assert place([0, HALF + 40, N], 0, fixed=[HALF + 40]) == [0, HALF + 40, N]
    # Nor is a window made shorter than it may be.
    driven = np.linspace(0.0, 30.0, N)
    near = [0, HALF - 30, HALF + 40, N]
    assert place(near, 0, distance=driven, min_distance=0.5)[2] - HALF + 30 >= 50


@pytest.mark.parametrize("seed", range(5))
def test_where_the_sinkage_goes_on_a_bound_stays_where_the_line_has_it(seed):
    cohesion = (500.0, 3000.0)
    assert place([0, HALF, N], seed, cohesion=cohesion, stiffer=1.0, digging=2.0) == [0, HALF, N]


def test_a_sinkage_that_is_not_known_everywhere_moves_nothing():
    load, sinkage, slip = drive(0, stiffer=2.0)
    sinkage[5] = np.nan
    bounds = np.array([0, HALF + 40, N])
    line = lines(0, load, (500.0, 900.0))
    assert placed(line, (load, sinkage, slip), bounds, bounds[:0], **LIMITS) is bounds
