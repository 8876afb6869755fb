"""Change points as samples arrive: those of the whole drive, soon after they are passed."""

from __future__ import annotations

import numpy as np
import pytest
from soil_drives import Kind, clean, mixed

from terrain_cli.windows import online_cuts
from terrain_cli.windows.change_points import change_points
from terrain_cli.windows.online_cuts import HORIZON, SETTLED, OnlineCuts

WAVES = Kind("waves", "waves")


def columns_of(one, first=0.0):
    n = len(one.x)
    unknown = np.full((3, n), np.nan)
    return np.array([np.arange(n), first + np.arange(n) / one.rate, one.x, one.y, one.distance, *unknown])


def follow(columns, chunk):
    """Return the bounds, and how many samples behind each had come when it was told."""
    cuts, found, behind = OnlineCuts(), [], []
    for first in range(0, columns.shape[1], chunk):
        told = cuts.add(columns[:, first : first + chunk])
        found += told
        behind += [cuts.count - bound for bound in told]
    return [*found, *cuts.end()], behind


@pytest.mark.parametrize("kind", [WAVES, Kind("steps", "constant"), Kind("white", "waves")])
def test_bounds_are_those_of_the_whole_drive(kind):
    same = of_all = told = 0
    for seed in range(3):
        one = mixed(seed, kind)
        offline = change_points(one.x, one.y, distance=one.distance)[1:-1]
        online, behind = follow(columns_of(one), 50)
        same += sum(np.abs(np.array(online) - bound).min() <= one.rate for bound in offline)
        of_all, told = of_all + len(offline), told + len(online)
        # One search may come too early to find it; the next does, another one again, and so many lie behind.
        most = 2.0 * online_cuts.EVERY_SECONDS + online_cuts.AGAIN_SECONDS
        assert all(count <= SETTLED + most * one.rate + 50 for count in behind)
    assert of_all >= 8
    assert same >= 0.95 * of_all
    assert told <= of_all


def test_one_soil_is_not_cut():
    for seed in range(4):
        one = clean(seed, WAVES, shortest=1000, longest=8000)
        assert follow(columns_of(one), 500)[0] == []


def test_a_bound_that_waits_is_searched_for_again_sooner(monkeypatch):
    times = []
    search = OnlineCuts._search

    def noted(self, *, last):
        times.append(self.count)
        return search(self, last=last)

    monkeypatch.setattr(OnlineCuts, "_search", noted)
    calm = columns_of(clean(0, WAVES, shortest=1000, longest=8000))
    follow(calm, 1)
    rate = 1.0 / (calm[1, 1] - calm[1, 0])
    assert set(np.diff(times[:-1])) == {round(online_cuts.EVERY_SECONDS * rate)}
    times.clear()
    one = mixed(1, WAVES)
    found, _ = follow(columns_of(one), 1)
    assert found
    waits = np.diff(times[:-1]) / one.rate
    assert waits == pytest.approx(np.where(waits < 7.0, online_cuts.AGAIN_SECONDS, online_cuts.EVERY_SECONDS))
    assert 0 < np.sum(waits < 7.0) < len(waits)


def test_it_does_not_matter_how_many_samples_come_at_once():
    columns = columns_of(mixed(1, WAVES))
    first, _ = follow(columns, 1)
    assert first
    for chunk in (7, 333, columns.shape[1]):
        assert follow(columns, chunk)[0] == first


def test_memory_does_not_grow():
    cuts = OnlineCuts()
    one = clean(0, WAVES, shortest=5000, longest=5001)
    columns = np.tile(columns_of(one), 4)
    columns[online_cuts.TIME] = np.arange(columns.shape[1]) / 50
    columns[online_cuts.DRIVEN] = np.nan
    cuts.add(columns)
    assert cuts.count == columns.shape[1]
    assert cuts._recent.shape == (len(columns), HORIZON)


def test_places_are_those_that_were_given():
    columns = columns_of(mixed(1, WAVES))
    plain, _ = follow(columns, 100)
    columns[online_cuts.PLACE] = 3 * columns[online_cuts.PLACE] + 7
    assert follow(columns, 100)[0] == [3 * bound + 7 for bound in plain]


def test_a_distance_that_falls_by_a_digit_is_one_that_stands():
    columns = columns_of(mixed(1, WAVES))
    plain, _ = follow(columns, 50)
    columns[online_cuts.DRIVEN, 50::50] = np.nextafter(columns[online_cuts.DRIVEN, 49:-1:50], 0.0)
    assert follow(columns, 50)[0] == plain


def test_what_is_recorded_may_explain_a_change():
    """One soil whose line follows a driver: cut at each step of it, until there are enough to see why."""
    rng = np.random.default_rng(0)
    n, rate = 9000, 20
    driver = np.repeat(np.tile([0.0, 1.0], 6), n // 12)
    x = 1e4 * (1.0 + 0.2 * np.sin(np.arange(n) / 15.0))
    y = (1e3 + 0.6 * x) * (1.0 + 0.25 * driver)
    x, y = (column * (1.0 + 0.02 * rng.standard_normal(n)) for column in (x, y))
    columns = np.array([np.arange(n), np.arange(n) / rate, x, y, *np.full((4, n), np.nan)])
    without, _ = follow(columns, 100)
    known, _ = follow(np.vstack([columns, driver]), 100)
    assert len(without) == 11
    assert len(known) <= 3
