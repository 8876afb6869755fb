"""Packed CSV."""

from __future__ import annotations

import time

import numpy as np
import pytest

from formats import CannotWriteError, open_source, write_table
from formats.output.text_writer import PACKINGS, write_packed

TABLE = {"time": np.arange(1000.0), "wheel": ["left"] * 1000}


@pytest.mark.parametrize("ending", PACKINGS)
class TestPacked:
    def test_holds_what_is_not_packed(self, ending, tmp_path):
        write_table(TABLE, str(tmp_path / "run.csv"))
        path = tmp_path / f"run.csv{ending}"
        write_packed(TABLE, str(path))
        assert path.stat().st_size < (tmp_path / "run.csv").stat().st_size / 3
        (batch,) = open_source(str(path)).read("", ["time"])
        np.testing.assert_array_equal(batch["time"], TABLE["time"])

    def test_does_not_depend_on_name_or_time(self, ending, tmp_path, monkeypatch):
        write_packed(TABLE, str(tmp_path / f"a.csv{ending}"))
        monkeypatch.setattr(time, "time", lambda: 1e9)
        write_packed(TABLE, str(tmp_path / f"b.csv{ending}"))
        assert (tmp_path / f"a.csv{ending}").read_bytes() == (tmp_path / f"b.csv{ending}").read_bytes()

    def test_whole_or_not_at_all(self, ending, tmp_path):
        with pytest.raises(CannotWriteError, match="no such folder"):
            write_packed(TABLE, str(tmp_path / "no" / f"run.csv{ending}"))
        assert list(tmp_path.iterdir()) == []
