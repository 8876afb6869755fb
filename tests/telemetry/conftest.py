"""What the tests of telemetry share."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from formats import Source, Stream
from terrain_cli import rover, telemetry
from terrain_cli.telemetry.unit_doubts import Doubt

# The writers of bags stand with the tests of the formats.
sys.path.insert(0, str(Path(__file__).parents[1] / "formats"))


class Streams(Source):
    """A source of which only what is inside is known: a bag that is not read, or a table of no rows."""

    def __init__(self, *streams):
        super().__init__("run", "csv" if streams[0].topic == "" else "mcap")
        self._streams = streams

    def streams(self):
        return self._streams

    def read(self, topic, fields, batch_rows=0):
        if topic:
            raise AssertionError(topic, fields, batch_rows)
        yield from ()


@pytest.fixture
def rover_of(tmp_path):
    """Return a function that reads the text of a rover file."""

    def read(text):
        path = tmp_path / "rover.toml"
        path.write_text(text, encoding="utf-8")
        return rover.load(path)

    return read


@pytest.fixture
def table():
    """Return a function that makes a table of the fields given."""
    return lambda *fields: Streams(Stream(topic="", type="table", fields=fields))


@pytest.fixture
def bag():
    """Return a function that makes a bag: topic=(type, fields)."""

    def make(**topics):
        return Streams(
            *(
                Stream(topic=f"/{t.replace('__', '/')}", type=kind, fields=tuple(f))
                for t, (kind, f) in topics.items()
            )
        )

    return make


@pytest.fixture(params=["ros1", "mcap"])
def write_bag(request, tmp_path):
    """Return a function that writes rows, in the order of their log times, to a bag of either kind."""
    from bags import typestore, write_ros1, write_ros2

    def write(*series, definitions=None):
        ros1 = request.param == "ros1"
        rows = sorted((row for rows in series for row in rows), key=lambda row: row[2])
        store = typestore(definitions, ros1=ros1)
        if ros1:
            return str(write_ros1(tmp_path / "run.bag", rows, store))
        return str(write_ros2(tmp_path / "run", rows, store, "mcap"))

    return write


@pytest.fixture
def judged(tmp_path):
    """Return a function that reads a table and returns the doubts; errors pass."""
    from wheel_bags import GEOMETRY

    def judged(table, text=GEOMETRY, **options):
        table.to_csv(tmp_path / "run.csv", index=False)
        (tmp_path / "rover.toml").write_text(text, encoding="utf-8")
        wheels = telemetry.read(str(tmp_path / "run.csv"), rover.load(tmp_path / "rover.toml"), **options)
        return [remark for one in wheels for remark in one.remarks if isinstance(remark, Doubt)]

    return judged
