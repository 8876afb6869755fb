from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formats import Labels
from terrain_cli.presentation import segment_table
from terrain_cli.telemetry import Geometry, Samples
from terrain_cli.windows.cut_windows import Windows


def samples(reason: list[int], **channels: list[float]) -> Samples:
    n = len(reason)
    arrays = {name: np.array(values, dtype=float) for name, values in channels.items()}
    for name in ("load", "torque", "sinkage", "slip"):
        arrays.setdefault(name, np.full(n, 0.1))
    return Samples(
        source="run.csv",
        wheel="fl",
        geometry=Geometry(0.1, 0.1, 0.018),
        origin=1_700_000_000.0,
        time=np.arange(n) * 0.1,
        channels=arrays,
        labels={},
        stretch=np.zeros(n, dtype=np.intp),
        distance=np.arange(n) * 0.01,
        set_aside=Labels(np.array(reason, dtype=np.int32), ("no load", "wheel stands")),
    )


def windows(of: Samples, *inner: int) -> Windows:
    rows = of.usable
    bounds = np.array([0, *inner, len(rows)])
    nothing = np.zeros(len(rows))
    return Windows(samples=of, rows=rows, bounds=bounds, x=nothing, y=nothing)


@given(st.lists(st.integers(-1, 1), min_size=1).filter(lambda reasons: -1 in reasons), st.data())
def test_used_and_rejected_samples_add_up_to_those_read(reasons, data):
    of = samples(reasons)
    inner = data.draw(st.lists(st.integers(1, max(1, len(of.usable) - 1)), unique=True, max_size=4))
    cut = windows(of, *sorted(k for k in inner if k < len(of.usable)))
    rejected = segment_table._rejected(cut)
    assert rejected.sum() + np.diff(cut.bounds).sum() == len(of)


def test_a_rejected_sample_counts_with_the_window_before_it():
    cut = windows(samples([0, -1, -1, 1, 1, -1, 0, -1]), 2)
    assert segment_table._rejected(cut).tolist() == [3, 1]


def test_reasons_are_counted_most_frequent_first():
    assert samples([0, 1, 1, -1]).reasons() == {"wheel stands": 2, "no load": 1}


def test_rejects_say_which_sample_and_why():
    table = segment_table.rejects(samples([-1, 0, -1, 1], load=[5.0, np.nan, 7.0, 8.0]))
    assert table["sample"].tolist() == [2, 4]
    assert table["reason"] == ["no load", "wheel stands"]
    assert table["time_s"].tolist() == [1_700_000_000.1, 1_700_000_000.3]
    np.testing.assert_array_equal(table["load_N"], [np.nan, 8.0])


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([], ""),
        ([[1.5, 2.0]], "POINT (1.5 2.0)"),
        ([[1.0, 2.0], [1.0, 2.0]], "POINT (1.0 2.0)"),
        ([[0.0, 0.0], [0.0, 0.0], [1.0, 0.5]], "LINESTRING (0.0 0.0, 1.0 0.5)"),
    ],
)
def test_wkt_of_a_track(points, expected):
    assert segment_table.wkt(np.array(points, dtype=float).reshape(-1, 2)) == expected


def test_a_long_track_keeps_its_ends_and_few_vertices():
    text = segment_table.wkt(np.column_stack([np.arange(10_000.0), np.zeros(10_000)]))
    assert text.startswith("LINESTRING (0.0 0.0,")
    assert text.endswith("9999.0 0.0)")
    assert text.count(",") == segment_table.VERTICES - 1


def test_the_track_is_in_longitude_and_latitude_where_they_are_known():
    site = samples([-1, -1], x=[0.0, 1.0], y=[0.0, 1.0])
    assert segment_table._tracks(windows(site)) == ["LINESTRING (0.0 0.0, 1.0 1.0)"]
    globe = samples([-1, -1], x=[0.0, 1.0], y=[0.0, 1.0], longitude=[137.4, 137.5], latitude=[-4.5, -4.6])
    assert segment_table._tracks(windows(globe)) == ["LINESTRING (137.4 -4.5, 137.5 -4.6)"]


def test_a_site_frame_takes_no_reference_system():
    site = {"longitude_deg": np.array([np.nan])}
    globe = {"longitude_deg": np.array([np.nan, 137.4])}
    assert segment_table.reference_system(site, "IAU_2015:49900") is None
    assert segment_table.reference_system(globe, "IAU_2015:49900") == "IAU_2015:49900"
    assert segment_table.reference_system(globe, None) == "EPSG:4326"


def test_a_window_is_called_by_every_label_that_many_of_its_samples_carry():
    of = samples([-1] * 27)
    codes = np.array([1] * 11 + [0] + [0, 1, 1] + [-1] * 2 + [-1, 0] + [1] * 8, dtype=np.int32)
    of.labels["terrain"] = Labels(codes, ("sand", "rock"))
    cut = windows(of, 12, 15, 17, 19)
    names = segment_table._terrain(cut)
    assert names == ["rock", "sand+rock", "", "sand", "rock"]
    assert segment_table.several_terrains(cut.samples, {"terrain": names}) == {"sand+rock"}
    (told,) = segment_table.mixed_terrain_notes("front", {"sand+rock"})
    assert "(sand+rock); --segments terrain" in told
    assert segment_table.mixed_terrain_notes("front", set()) == []
