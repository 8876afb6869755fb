"""A long log of which some is read ahead: the same table as one part after another, however that ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from child_processes import peak
from test_long_log import LENGTHS, ROVER, SHORT, assert_same, dirty, drive

from formats import DamagedError, Labels
from terrain_cli import rover
from terrain_cli.errors import InputError
from terrain_cli.run import long_log, one_log
from terrain_cli.run.settings import Settings
from terrain_cli.telemetry import long_logs
from terrain_cli.telemetry.wheel_samples import Geometry, Samples


@pytest.fixture
def long(monkeypatch, tmp_path):
    """Return a function that reads a table as a long log, of many parts."""
    monkeypatch.setattr(long_log, "MOST_ROWS", 1000)
    monkeypatch.setattr(long_logs, "ROWS", 700)
    monkeypatch.setattr(long_logs, "BESIDE", 300)
    (tmp_path / "rover.toml").write_text(ROVER)
    path = tmp_path / "run.parquet"
    dirty(drive(LENGTHS)).to_parquet(path, index=False)

    def run(**settings):
        given = rover.load(tmp_path / "rover.toml"), Settings(**settings)
        return [one_log.run(str(path), *given, ahead=ahead) for ahead in (True, False)]

    return run


def lean_parts(count=12):
    """Parts of a log, as they come from a file."""
    table = dirty(drive(LENGTHS))
    size = len(table) // count
    samples = long_log.lean(whole(table))
    return [samples.taken(slice(k * size, (k + 1) * size)) for k in range(count)]


def whole(table):
    table = table.dropna()
    table = table[table["load"] > 0.0]
    n = len(table)
    return Samples(
        source="run",
        wheel="wheel",
        geometry=Geometry(0.125, 0.1, 0.018),
        origin=0.0,
        time=table["time"].to_numpy(),
        channels={name: table[name].to_numpy() for name in ("load", "torque", "sinkage", "slip")},
        labels={},
        stretch=np.zeros(n, dtype=np.intp),
        distance=None,
        set_aside=Labels(np.full(n, -1, dtype=np.int32), ()),
    )


def assert_equal(found, expected):
    assert found.keys() == expected.keys()
    for name, wheel in found.items():
        assert len(wheel) == len(expected[name])
        assert wheel.account([]) == expected[name].account([])
        for column, values in wheel.table.items():
            np.testing.assert_array_equal(values, expected[name].table[column], err_msg=column)


@pytest.mark.parametrize("settings", [{}, {"segments": "terrain"}, {"method": "ridge", "where": "load > 60"}])
def test_read_ahead_makes_the_same_table(long, settings):
    found, within = long(**settings)
    assert_same(found, within)
    assert len(found.table["segment"]) > 3


def test_parts_come_as_they_were():
    # More than can wait.
    given = lean_parts()
    assert len(given) > 2 * long_log._AHEAD
    assert_equal(long_log.work(long_log.read_ahead(given), Settings()), long_log.work(given, Settings()))


def test_an_error_of_the_work_ends_the_reading():
    def endless():
        while True:
            yield from lean_parts(2)

    with pytest.raises(InputError, match="there is no terrain label") as error:
        long_log.work(long_log.read_ahead(endless()), Settings(segments="terrain"))
    assert "its column, or its topic and field" in error.value.hint
    assert "--segments auto" in error.value.hint


def test_an_error_of_reading_is_told():
    def cut_off():
        yield from lean_parts(2)
        raise DamagedError("run.parquet", "is corrupt")

    with pytest.raises(DamagedError, match="is corrupt"):
        long_log.work(long_log.read_ahead(cut_off()), Settings())


@pytest.mark.skipif(sys.platform != "linux", reason="reads memory from /proc")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_of_a_command_that_is_ended(tmp_path, ending):
    (tmp_path / "rover.toml").write_text(ROVER)
    (tmp_path / "short.py").write_text(SHORT)
    drive((15_000,) * 80).to_parquet(tmp_path / "long.parquet", index=False, row_group_size=20_000)
    with subprocess.Popen(
        [sys.executable, "short.py", "estimate", "long.parquet", "-o", "soil.csv"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        # Its memory shows that it is past the imports, and at the log.
        while process.poll() is None and peak(process.pid) < 120_000:
            time.sleep(0.01)
        time.sleep(0.3)
        assert process.poll() is None
        os.kill(process.pid, ending)
        said = process.communicate(timeout=60)[1]
    assert process.returncode in {130, -ending, 128 + ending}
    assert "Traceback" not in said
    assert not (tmp_path / "soil.csv").exists()
