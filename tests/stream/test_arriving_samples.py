"""Samples as they arrive: those of the file read whole."""

from __future__ import annotations

import numpy as np
import pytest
from streams import ROVER, begun, lines, text

from terrain_cli import telemetry
from terrain_cli.errors import InputError
from terrain_cli.run.settings import Settings
from terrain_cli.stream.arriving_samples import RowSamples
from terrain_cli.telemetry.long_logs import joined

WHEELS = ("left", "right")


def arrived(some, size):
    """Return the samples of each wheel, and what made them, of rows that come so many at a time."""
    rows = begun(some[:3])
    arriving = RowSamples(rows, ROVER, Settings(), None)
    parts = {}
    for first in (None, *range(3, len(some), size)):
        batch = rows.take(b"" if first is None else text(some[first : first + size]))
        for part in arriving.take(batch) if batch else ():
            parts.setdefault(part.wheel, []).append(part)
    arriving.end()
    return {wheel: joined(found) for wheel, found in parts.items()}, arriving


def whole(some, folder):
    path = folder / "run.csv"
    path.write_bytes(text(some))
    return {samples.wheel: samples for samples in telemetry.read(str(path), ROVER)}


@pytest.mark.parametrize("size", [1, 57])
def test_they_are_those_of_the_file(size, tmp_path):
    some = lines((60.0, 60.0), WHEELS)[:501]
    # A gap of 3 s, and values that are missing.
    some = [*some[:201], *some[321:]]
    cells = [line.split(",") for line in some[1:]]
    for row in cells[100:110]:
        row[some[0].split(",").index("torque")] = ""
    some = [some[0], *map(",".join, cells)]
    found, arriving = arrived(some, size)
    expected = whole(some, tmp_path)
    assert found.keys() == expected.keys() == set(WHEELS)
    for wheel, one in expected.items():
        own = found[wheel]
        assert own.origin == one.origin
        np.testing.assert_array_equal(own.time, one.time)
        np.testing.assert_array_equal(own.stretch, one.stretch)
        np.testing.assert_allclose(own.distance, one.distance, atol=1e-12)
        np.testing.assert_array_equal(own.usable, one.usable)
        for name in ("load", "torque", "sinkage", "slip", "x", "y"):
            np.testing.assert_array_equal(own.channels[name], one.channels[name])
        assert arriving.count[wheel] == len(one)
        assert dict(arriving.reasons[wheel]) == one.reasons()


def test_late_and_repeated_rows_are_set_aside():
    some = lines((60.0, 60.0))[:201]
    late = some[100]
    moved = some[150].split(",")
    moved[-1] = "1.0"
    found, arriving = arrived(
        [*some[:151], ",".join(moved), late.replace("wheel,", "wheel ,", 1), *some[151:]], 1
    )
    assert dict(arriving.reasons["wheel"]) == {"time repeated": 1, "time runs backwards": 1}
    assert len(found["wheel"].usable) == 200
    assert set(found["wheel"].stretch) == {0}


def test_a_clock_that_begins_anew_is_a_new_stretch():
    some = lines((60.0, 60.0))[:201]
    place = some[0].split(",").index("time")
    again = []
    for line in some[1:101]:
        cells = line.split(",")
        cells[place] = repr(float(cells[place]) + 3.0)
        again.append(",".join(cells))
    found, arriving = arrived([*some, *again], 1)
    one = found["wheel"]
    assert set(one.stretch[one.usable]) == {0, 1}
    # It is believed once nine rows stand back.
    assert dict(arriving.reasons["wheel"]) == {"time runs backwards": 9}


def test_a_unit_that_cannot_be_true_is_told_while_it_goes_on():
    some = lines((60.0, 60.0))[:701]
    place = some[0].split(",").index("sinkage")
    cells = [line.split(",") for line in some[1:]]
    for row in cells:
        row[place] = repr(float(row[place]) * 1000.0)
    rows = begun([some[0], ",".join(cells[0])])
    arriving = RowSamples(rows, ROVER, Settings(), None)
    list(arriving.take(rows.take(text(map(",".join, cells[:400])))))
    with pytest.raises(InputError, match=r"sinkage is 24\.\d m in the median"):
        list(arriving.take(rows.take(text(map(",".join, cells[400:])))))


def test_a_clock_that_is_not_in_seconds_is_refused_as_soon_as_it_shows():
    some = lines((60.0, 60.0))[:11]
    place = some[0].split(",").index("time")
    cells = [line.split(",") for line in some[1:]]
    for number, row in enumerate(cells):
        row[place] = str(1_767_225_600_000 + 50 * number)
    rows = begun([some[0], ",".join(cells[0])])
    arriving = RowSamples(rows, ROVER, Settings(), None)
    list(arriving.take(rows.take(text([",".join(cells[1])]))))
    with pytest.raises(InputError, match="is no time in seconds"):
        list(arriving.take(rows.take(text([",".join(cells[2])]))))


def test_columns_on_clocks_of_their_own_are_refused():
    some = lines((60.0, 60.0))[:401]
    place = some[0].split(",").index("sinkage")
    cells = [line.split(",") for line in some[1:]]
    for number, row in enumerate(cells):
        row[place] = "" if number % 4 else row[place]
    with pytest.raises(InputError, match="sinkage is filled in fewer rows"):
        arrived([some[0], *map(",".join, cells)], 50)


def test_without_a_clock_nothing_can_be_followed():
    some = [line.partition(",")[2] for line in lines((60.0, 60.0))[:4]]
    names = some[0].split(",")
    names[names.index("time")] = "temperature"
    with pytest.raises(InputError, match="no column is the time"):
        RowSamples(begun([",".join(names), *some[1:]]), ROVER, Settings(), None)


def test_a_wheel_that_was_asked_for_and_never_came():
    rows = begun(lines((60.0, 60.0))[:4])
    arriving = RowSamples(rows, ROVER, Settings(wheels=("front",)), None)
    assert not list(arriving.take(rows.take()))
    with pytest.raises(InputError, match="there is no wheel front"):
        arriving.end()
