"""A long log worked through in a second process: the same as in this one, however that ends."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from child_processes import alive, children
from test_long_log import LENGTHS, ROVER, SHORT, assert_same, dirty, drive

from formats import DamagedError, Labels
from terrain_cli import rover
from terrain_cli.errors import InputError, TerrainError
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
        return [one_log.run(str(path), *given, beside=other) for other in (True, False)]

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
def test_another_process_makes_the_same_table(long, settings):
    found, within = long(**settings)
    assert_same(found, within)
    assert len(found.table["segment"]) > 3


def test_parts_arrive_bit_by_bit_as_they_were():
    # More than can wait.
    given = lean_parts()
    assert len(given) > 2 * long_log._AHEAD
    assert_equal(long_log.work_beside(given, Settings()), long_log.work(given, Settings()))


def test_where_no_process_can_be_started(monkeypatch):
    def refuse(*_):
        raise BlockingIOError(11, "Resource temporarily unavailable")

    monkeypatch.setattr("multiprocessing.context.SpawnProcess.start", refuse)
    given = lean_parts(3)
    assert_equal(long_log.work_beside(given, Settings()), long_log.work(given, Settings()))


def test_an_error_of_the_other_process_is_told_here():
    with pytest.raises(InputError, match="there is no terrain label") as error:
        long_log.work_beside(lean_parts(), Settings(segments="terrain"))
    assert "--segments auto" in error.value.hint
    assert not multiprocessing.active_children()


def test_an_error_of_reading_ends_the_other_process():
    def cut_off():
        yield from lean_parts(2)
        raise DamagedError("run.parquet", "is corrupt")

    with pytest.raises(DamagedError, match="is corrupt"):
        long_log.work_beside(cut_off(), Settings())
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("after", [1, 11])
def test_a_process_that_is_killed(after):
    def killed():
        for number, part in enumerate(lean_parts()):
            yield part
            if number == after:
                (other,) = multiprocessing.active_children()
                other.kill()
                other.join()

    with pytest.raises(TerrainError, match="was killed; out of memory") as error:
        long_log.work_beside(killed(), Settings())
    assert "\n" not in str(error.value)


@pytest.mark.skipif(sys.platform != "linux", reason="asks /proc who is alive")
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
        others = []
        while process.poll() is None and len(others) < 2:
            # Of the two, one watches over what they share.
            others = children(process.pid)
            time.sleep(0.01)
        time.sleep(0.3)
        assert process.poll() is None
        # As Ctrl-C does, the first goes to all of them.
        (os.killpg if ending == signal.SIGINT else os.kill)(process.pid, ending)
        said = process.communicate(timeout=60)[1]
    assert process.returncode in {130, -ending, 128 + ending}
    assert "Traceback" not in said
    assert not (tmp_path / "soil.csv").exists()
    deadline = time.monotonic() + 30.0
    while any(alive(pid) for pid in others) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not [pid for pid in others if alive(pid)]
