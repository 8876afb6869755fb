"""A stream to its table: that of the log read whole, in bounded memory."""

from __future__ import annotations

import itertools
import tracemalloc

import numpy as np
import pytest
from streams import ROVER, Told, followed, lines, text

from formats.text import arriving_rows
from terrain_cli.errors import InputError
from terrain_cli.run import one_log
from terrain_cli.run.settings import Settings
from terrain_cli.stream import follow, followed_wheel
from terrain_cli.stream.follow import Follow
from terrain_cli.windows import online_cuts

#: What holds for any estimator of a segment.
ENDS = ("wheel", "segment", "t_start_s", "t_end_s", "n_samples", "n_rejected", "terrain")
NUMBERS = ("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg", "strength_kPa", "k_mm", "torque_rmse_Nm")


def offline(some, folder, **settings):
    path = folder / "run.csv"
    path.write_bytes(text(some))
    return one_log.run(str(path), ROVER, Settings(**settings)).table


def by_wheel(table):
    order = np.lexsort((table["segment"], table["wheel"]))
    return {name: np.array(column, dtype=object)[order] for name, column in table.items()}


@pytest.mark.parametrize("wheels", [("wheel",), ("left", "right")])
def test_the_table_is_that_of_the_log(wheels, tmp_path):
    some = lines((60.0, 60.0), wheels)
    told = followed(text(some), method="recursive")
    online, whole = by_wheel(told.table), by_wheel(offline(some, tmp_path, method="recursive"))
    assert len(online["wheel"]) == len(whole["wheel"]) == 2 * len(wheels)
    assert online["wheel"].tolist() == whole["wheel"].tolist()
    assert np.abs((online["t_end_s"] - whole["t_end_s"]).astype(float)).max() <= 1.0
    assert told.remarks[-1] == f"rows: {len(some) - 1}, late: 0, repeated: 0; segments: {2 * len(wheels)}"


def test_a_segment_that_closes_has_the_estimate_of_its_samples(tmp_path):
    """Of the full model too, and whatever number of rows comes at once."""
    some = lines((60.0, 60.0))
    # The row of the first segment comes while the second goes on.
    told = followed(text(some[: 60 * 20 + 20 * 25]), block=1500)
    assert told.table["method"] == ["wong-reece", "wong-reece"]
    count = int(told.table["n_samples"][0])
    expected = offline(some[: count + 1], tmp_path, segments="none")
    for name in ENDS:
        assert told.rows[0][name][0] == expected[name][0], name
    for name in NUMBERS:
        np.testing.assert_allclose(told.rows[0][name][0], expected[name][0], rtol=1e-6)


@pytest.mark.parametrize("block", [700, 1 << 20])
def test_it_does_not_matter_how_rows_come(block):
    some = lines((60.0, 60.0))
    usual, other = (followed(text(some), block=size, method="recursive").table for size in (4096, block))
    assert other.keys() == usual.keys()
    for name in (*ENDS, "c_kPa", "phi_deg"):
        assert list(other[name]) == list(usual[name]), name


def test_a_gap_ends_a_segment(tmp_path):
    some = lines((60.0, 60.0))
    some = [*some[:401], *some[501:801]]
    told = followed(text(some), method="recursive")
    whole = offline(some, tmp_path, method="recursive")
    assert list(told.table["n_samples"]) == list(whole["n_samples"]) == [400, 300]
    assert list(told.table["t_start_s"]) == list(whole["t_start_s"])


@pytest.mark.parametrize(
    "settings",
    [
        {"segments": "fixed", "window_samples": 130},
        {"segments": "terrain"},
        {"segments": "none"},
    ],
)
def test_other_segments_are_those_of_the_log(settings, tmp_path):
    some = lines((60.0, 60.0))[:701]
    some = [some[0] + ",terrain", *(f"{line},{'ab'[n // 170 % 2]}" for n, line in enumerate(some[1:]))]
    told = followed(text(some), block=777, method="recursive", **settings)
    whole = offline(some, tmp_path, method="recursive", **settings)
    for name in ENDS:
        assert list(told.table[name]) == list(whole[name]), name
    np.testing.assert_allclose(told.table["c_kPa"], whole["c_kPa"], rtol=1e-9)
    mixed = (
        "the wheel: segments hold samples of more than one terrain (a+b); --segments terrain keeps them apart"
    )
    assert told.remarks.count(mixed) == (settings["segments"] != "terrain")


def test_open_segments_are_told_as_the_recursive_estimator_has_them(tmp_path, monkeypatch):
    # However long a row takes, the next one may follow.
    clock = itertools.count()
    monkeypatch.setattr(follow.time, "monotonic", lambda: next(clock))
    some = lines((60.0, 60.0))[:601]
    told = followed(text(some), block=6000, every=1e-9, method="recursive")
    assert len(told.opened) > 5
    last = told.opened[-1][0]
    assert last["method"] == ["recursive"]
    counts = [int(rows[0]["n_samples"][0]) for rows in told.opened]
    assert counts == sorted(set(counts))
    expected = offline(some[: counts[-1] + 1], tmp_path, method="recursive", segments="none")
    for name in (*ENDS, "c_kPa", "phi_deg", "strength_kPa"):
        np.testing.assert_array_equal(last[name][0], expected[name][0], name)
    # What is assumed is found anew only now and then.
    assert last["c_se_kPa"][0] == pytest.approx(expected["c_se_kPa"][0], rel=0.3)
    assert "wheel: c " in told.states[-1]


def test_a_soil_that_goes_on_is_cut_and_that_is_said(monkeypatch):
    monkeypatch.setattr(followed_wheel, "LONGEST", 500)
    told = followed(text(lines((60.0,))), method="recursive")
    assert list(told.table["n_samples"]) == [500, 500, 200]
    assert told.remarks[-1] == "a soil that went on was cut every 500 samples (2 times)"


class Silent(Told):
    """Who keeps nothing but the number of rows."""

    count = 0

    def closed(self, row):
        self.count += len(row["wheel"])

    def now(self, state):
        del state


def test_memory_is_constant(monkeypatch):
    """More rows take no more: of a soil that never changes, and rows that come twice."""
    monkeypatch.setattr(followed_wheel, "LONGEST", 300)
    monkeypatch.setattr(online_cuts, "HORIZON", 128)
    monkeypatch.setattr(arriving_rows, "_KNOWN", 64)
    some = lines((60.0,))[:121]
    place = some[0].split(",").index("time")
    cells = [line.split(",") for line in some[1:]]

    def stream(laps):
        yield text(some[:1])
        for lap in range(laps):
            rows = [",".join([*c[:place], repr(float(c[place]) + 6.0 * lap), *c[place + 1 :]]) for c in cells]
            yield text([*rows, *rows[-20:]])

    def peak(laps):
        told = Silent()
        tracemalloc.start()
        Follow(ROVER, Settings(method="recursive"), told, every=None).run(stream(laps), "-")
        size = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert told.count >= laps * len(cells) // 300
        return size

    peak(1)
    assert peak(16) < 1.1 * peak(6)


def test_what_cannot_be_used_is_told_as_for_a_log():
    some = lines((60.0,))[:101]
    place = some[0].split(",").index("load")
    cells = [line.split(",") for line in some[1:]]
    for row in cells:
        row[place] = "-1.0"
    with pytest.raises(InputError, match="none of 100 samples can be used"):
        followed(text([some[0], *map(",".join, cells)]))


def test_a_condition_that_no_row_satisfies():
    with pytest.raises(InputError, match="there are no samples where load > 1000"):
        followed(text(lines((60.0,))[:101]), where="load > 1000")


def test_nothing_came():
    with pytest.raises(InputError, match="no row came"):
        followed(b"")
