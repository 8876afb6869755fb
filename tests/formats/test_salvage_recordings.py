"""Recordings of ROS 2 of which a file, the metadata or something packed is damaged, or was never closed."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import suppress

import pytest
from salvage_cases import START, N, opened, samples, told, write

from formats.errors import DamagedError


@pytest.mark.parametrize("ending", ["-wal", "-journal"])
def test_a_db3_that_was_never_closed(tmp_path, ending):
    """What stands in the log beside it is read; the file itself stays as it is."""
    path = write(tmp_path, "db3")
    copy = tmp_path / "copy.db3"
    with sqlite3.connect(path, isolation_level=None) as database:
        database.execute(f"PRAGMA journal_mode={'WAL' if ending == '-wal' else 'DELETE'}")
        database.execute("PRAGMA cache_size=1")
        database.execute("BEGIN")
        database.execute("UPDATE messages SET timestamp = timestamp + 7")
        if ending == "-wal":
            database.execute("COMMIT")
        shutil.copy(path, copy)
        shutil.copy(f"{path}{ending}", f"{copy}{ending}")
    database.close()
    before = copy.read_bytes()
    source = opened(copy, "db3")
    times = {time for _, time in samples(source)}
    assert min(times) == START + 7 * (ending == "-wal")
    assert len(times) == 2 * N
    assert f"messages were left in copy.db3{ending}" in told(source)
    assert copy.read_bytes() == before


def recording(folder, kind, compression="none"):
    """Write a recording in two files, and return its folder and all samples."""
    path = write(folder, kind, compression)
    second = path.with_name(path.name.replace("run.", "run_1."))
    shutil.copy(path, second)
    metadata = path.parent / "metadata.yaml"
    text = metadata.read_text()
    lines = [line for line in text.splitlines() if line.strip() == f"- {path.name}"]
    assert len(lines) == 1
    metadata.write_text(text.replace(lines[0], lines[0] + "\n" + lines[0].replace(path.name, second.name)))
    return path.parent, path, second


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_one_file_of_a_recording_is_damaged(tmp_path, kind):
    folder, first, second = recording(tmp_path, kind)
    data = second.read_bytes()
    second.write_bytes(data[: len(data) * 3 // 4])
    with pytest.raises(DamagedError, match="cut off") as caught:
        opened(folder, kind, salvage=False)
    assert "--salvage" in caught.value.hint
    source = opened(folder, kind)
    assert 2 * N < source.recovery.read < 4 * N
    assert "cut off at byte" in told(source)
    # The other way round the loss ends where the next file begins.
    second.write_bytes(data)
    first.write_bytes(data[: len(data) * 3 // 4])
    recovery = opened(folder, kind).recovery
    ((start, end),) = recovery.lost
    assert end == max(start, START)
    assert recovery.lost_s is not None


@pytest.mark.parametrize("kind", ["mcap", "db3"])
@pytest.mark.parametrize("gone", ["missing", "hopeless"])
def test_one_file_of_a_recording_is_lost(tmp_path, kind, gone):
    folder, _, second = recording(tmp_path, kind)
    second.unlink() if gone == "missing" else second.write_bytes(second.read_bytes()[:50])
    source = opened(folder, kind)
    assert len(samples(source)) == source.recovery.read == 2 * N
    text = told(source)
    assert second.name in text
    assert "lost: what is missing; how much that was cannot be known" in text


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_metadata_tell_how_much_there_was(tmp_path, kind):
    path = write(tmp_path, kind)
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    source = opened(path.parent, kind)
    recovery = source.recovery
    assert recovery.expected == 2 * N
    assert recovery.fraction == recovery.read / (2 * N)
    first, last = min(t for _, t in samples(source)), max(t for _, t in samples(source))
    assert first == START
    assert recovery.lost_s == pytest.approx((START + (N - 1) * 10**8 + 1 - last) / 1e9, abs=1e-6)
    assert f"{recovery.lost_s:.3f} s" in told(source)


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_metadata_that_are_damaged(tmp_path, kind):
    path = write(tmp_path, kind)
    (path.parent / "metadata.yaml").write_text("a: [")
    source = opened(path.parent, kind)
    assert len(samples(source)) == 2 * N
    assert "metadata.yaml is damaged" in told(source)


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_packed_file_that_is_cut_off(tmp_path, kind):
    path = write(tmp_path, kind, "file")
    data = path.read_bytes()
    path.write_bytes(data[:-9])
    with pytest.raises(DamagedError):
        opened(path.parent, kind, salvage=False)
    with suppress(DamagedError):
        # One block may hold all of so small a file.
        assert "zstd data are cut off" in told(opened(path.parent, kind))


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_packed_messages_of_which_one_is_damaged(tmp_path, kind):
    path = write(tmp_path, kind, "message")
    data = bytearray(path.read_bytes())
    at = data.rindex(b"\x28\xb5\x2f\xfd")
    data[at : at + 4] = bytes(4)
    path.write_bytes(data)
    assert len(samples(opened(path.parent, kind))) == 2 * N - 1
