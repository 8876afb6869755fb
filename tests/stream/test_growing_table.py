"""A table that grows: the bytes of one that is written whole, row after row."""

from __future__ import annotations

import contextlib
import os

import numpy as np
import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import NonSeekingReader, make_reader
from mcap_ros2.decoder import DecoderFactory
from streams import followed, lines, text

import formats
from terrain_cli.errors import UsageError
from terrain_cli.presentation import segment_files
from terrain_cli.presentation.segment_files import GrowingTable, readable


@pytest.fixture(scope="module")
def rows():
    return followed(
        text(lines((60.0, 60.0))[:401]), method="recursive", segments="fixed", window_samples=150
    ).rows


def joined(rows):
    return {name: [row[name][0] for row in rows] for name in rows[0]}


@pytest.mark.parametrize("kind", ["csv", "geojsonl", "geojsons"])
def test_the_bytes_are_those_of_a_whole_one(kind, rows, tmp_path):
    grown, whole = tmp_path / f"grown.{kind}", tmp_path / f"whole.{kind}"
    with GrowingTable(str(grown), None) as table:
        for count, row in enumerate(rows, 1):
            table.add(row)
            formats.write_table(joined(rows[:count]), str(whole))
            assert grown.read_bytes() == whole.read_bytes()
    assert len(rows) == 3


def messages(path):
    """Return what a reader without an index finds: topic, time and content."""
    found = []
    with path.open("rb") as file, contextlib.suppress(EndOfFile):
        reader = NonSeekingReader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, content in reader.iter_decoded_messages(log_time_order=False):
            fields = {name: getattr(content, name) for name in content.__slots__ if name != "header"}
            found.append((channel.topic, message.log_time, repr(fields)))
    return found


def test_messages_are_those_of_a_whole_bag_while_it_grows(rows, tmp_path):
    grown, whole = tmp_path / "grown.MCAP", tmp_path / "whole.mcap"
    grown.write_text("of yesterday")
    named = [{**row, "wheel": [name]} for row, name in zip(rows, ("a-b", "a b", "a-b"), strict=True)]
    with GrowingTable(str(grown), None) as table:
        for count, row in enumerate(named, 1):
            table.add(row)
            assert len(messages(grown)) == 2 * count
    segment_files.write(joined(named), str(whole), None)
    assert sorted(messages(grown)) == sorted(messages(whole))
    with grown.open("rb") as one, whole.open("rb") as other:
        summary, expected = (make_reader(file).get_summary() for file in (one, other))
    assert list(summary.schemas.values()) == list(expected.schemas.values())
    assert summary.statistics.message_count == 2 * len(rows)
    assert {path.name for path in tmp_path.iterdir()} == {"grown.MCAP", "whole.mcap"}


def test_a_bag_says_which_rows_are_open(rows, tmp_path):
    path = tmp_path / "soil.mcap"
    with GrowingTable(str(path), None, ["open"]) as table:
        table.add(rows[0], "open")
        table.add(rows[0])
    assert ["'open': 'true'" in said for *_, said in messages(path)] == [True, True, False, False]


def test_a_bag_that_grows_is_a_file(rows, tmp_path):
    os.mkfifo(tmp_path / "soil.mcap")
    with (
        pytest.raises(formats.CannotWriteError, match="is no file"),
        GrowingTable(str(tmp_path / "soil.mcap"), None) as table,
    ):
        table.add(rows[0])


def test_open_rows_are_told_from_closed_ones(rows, tmp_path):
    path = tmp_path / "soil.csv"
    with GrowingTable(str(path), None, ["open"]) as table:
        table.add(rows[0], "open")
        table.add(rows[0])
    header, first, second = path.read_text().splitlines()
    assert header.endswith(",WKT,open")
    assert first.endswith(",true")
    assert second == first.removesuffix("true") + "false"


@pytest.mark.parametrize("name", ["soil.parquet", "soil.gpkg", "soil.json", "soil.geojson"])
def test_what_cannot_be_read_while_it_grows_is_refused(name):
    with pytest.raises(UsageError, match="a table that grows cannot be"):
        GrowingTable(name, None)


def test_nothing_is_written_where_nothing_can_be(tmp_path, rows):
    with (
        pytest.raises(formats.CannotWriteError, match="no such folder"),
        GrowingTable(str(tmp_path / "none" / "soil.csv"), None) as table,
    ):
        table.add(rows[0])


def test_a_line_for_reading_says_what_is_not_known(rows):
    row = {**rows[0], "c_kPa": np.array([np.nan]), "phi_deg": np.array([30.04])}
    said = readable(row)
    assert said.startswith("wheel  segment 1  ")
    assert "c – ± " in said
    assert "φ 30.0 ± " in said
