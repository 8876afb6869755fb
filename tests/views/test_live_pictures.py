"""Pictures that are drawn anew while rows come."""

from __future__ import annotations

import numpy as np

from terrain_cli.views import plots
from terrain_cli.views.figures import drive_figures
from terrain_cli.views.plots import LivePictures


def row(samples, segment=1, wheel="left"):
    error = 9.0 / np.sqrt(samples)
    columns = {"c_kPa": 1.0 + error, "c_se_kPa": error, "phi_deg": 30.0 + error, "phi_se_deg": 2.0 * error}
    return {
        name: [value]
        for name, value in {
            "source": "-",
            "wheel": wheel,
            "segment": segment,
            "n_samples": samples,
            "status": "ok",
            **columns,
        }.items()
    }


def test_they_are_drawn_at_times_and_at_the_end(tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(plots, "_convergence", lambda traces: traces)
    monkeypatch.setattr(plots, "_write", lambda *given: drawn.append(given))
    pictures = LivePictures(str(tmp_path))
    pictures.draw()
    assert not drawn
    # A drawing takes 1 s, and 4 s are left to the rows.
    clock = iter([0.0, 1.0, 2.0, 4.9, 5.1, 6.1, 6.2, 7.0])
    monkeypatch.setattr(plots.time, "monotonic", lambda: next(clock))
    counts = []
    for samples in (10, 20, 30, 40):
        pictures.add(row(samples))
        pictures.draw()
        counts.append(len(drawn))
    assert counts == [1, 1, 1, 2]
    pictures.draw(last=True)
    ((trace,), folder) = drawn[-1]
    assert (len(drawn), folder) == (3, str(tmp_path))
    assert trace["sample"] == [10, 20, 30, 40]


def test_no_more_rows_are_held_than_a_line_needs(monkeypatch):
    monkeypatch.setattr(plots, "_MOST_ROWS", 10)
    pictures = LivePictures("none")
    for samples in range(1, 200):
        pictures.add(row(samples))
    rows = [one["sample"] for one in pictures._rows["left"]]
    assert len(rows) <= 10
    assert rows == sorted(rows)
    assert (rows[0], rows[-1]) == (1, 199)


def test_segments_stay_in_their_places_when_rows_are_dropped(monkeypatch):
    monkeypatch.setattr(plots, "_MOST_ROWS", 6)
    pictures = LivePictures("none")
    for segment in (1, 2, 3):
        for samples in range(10, 101, 10):
            pictures.add(row(samples, segment))
    rows = pictures._rows["left"]
    assert {one["segment"]: one["before"] for one in rows}[3] == 200
    assert all(one["before"] == 100 * (one["segment"] - 1) for one in rows)


def test_wheels_and_all_segments_are_drawn(tmp_path):
    pictures = LivePictures(str(tmp_path))
    for segment in (1, 2):
        for samples in (10, 50, 200):
            pictures.add(row(samples, segment))
    pictures.draw(last=True)
    names = {"convergence", "convergence-of-all"}
    assert {path.name for path in tmp_path.iterdir()} == {f"{n}.{e}" for n in names for e in ("png", "svg")}


def test_segments_follow_each_other_by_their_samples():
    rows = [(1, 10), (1, 300), (2, 20), (2, 100)]
    names = ("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg")
    trace = {"source": ["-"] * 4, "wheel": ["left"] * 4, **{name: np.ones(4) for name in names}}
    trace |= {"segment": [segment for segment, _ in rows], "sample": [samples for _, samples in rows]}
    trace["before"] = [0, 0, 300, 300]
    upper, _ = drive_figures.convergence(trace).axes
    np.testing.assert_equal(upper.lines[0].get_xdata(), [10, 300, np.nan, 320, 400])
    upper, _ = drive_figures.convergence_of_all([trace]).axes
    assert [line.get_xdata().tolist() for line in upper.lines[:2]] == [[10, 300], [20, 100]]
