"""Bytes as they arrive, and however that ends."""

from __future__ import annotations

import os
import threading
import time

import pytest

from formats import FormatError
from formats.byte_sources import ArrivingBytes
from formats.errors import NotFoundError


@pytest.fixture
def stop():
    """Return what can be read once somebody asks to end, and what asks."""
    reader, writer = os.pipe()
    yield reader, lambda: os.write(writer, b"!")
    os.close(reader)
    os.close(writer)


def test_a_file_is_followed_until_nothing_comes(tmp_path, stop):
    path = tmp_path / "run.csv"
    path.write_bytes(b"one\n")
    arriving = ArrivingBytes(str(path), stop=stop[0], idle=0.5)
    found = b""
    for block in arriving:
        found += block
        if found == b"one\n":
            with path.open("ab") as file:
                file.write(b"two\n")
    assert found == b"one\ntwo\n"
    assert not arriving.stopped


@pytest.mark.parametrize("name", ["run.db3", "run.db3-wal"])
def test_a_database_need_not_become_longer(name, tmp_path, stop):
    """What is written over it, or into the log beside it, came too."""
    path = tmp_path / "run.db3"
    path.write_bytes(b"one\n")
    (tmp_path / name).write_bytes(b"two\n")
    began, looks = time.monotonic(), 0
    for _ in ArrivingBytes(str(path), stop=stop[0], idle=0.5):
        looks += 1
        if time.monotonic() - began < 1.0:
            (tmp_path / name).write_bytes(b"two\n")
    assert time.monotonic() - began >= 1.4
    assert looks > 5


def test_who_asks_to_end_gets_all_that_had_come(tmp_path, stop):
    path = tmp_path / "run.csv"
    path.write_bytes(b"x" * 300_000)
    arriving = ArrivingBytes(str(path), stop=stop[0])
    stop[1]()
    assert sum(map(len, arriving)) == 300_000
    assert arriving.stopped


def test_a_pipe_may_wait_for_its_writer_and_ends_with_it(tmp_path, stop):
    path = tmp_path / "pipe"
    os.mkfifo(path)

    def write():
        time.sleep(0.3)
        with path.open("wb") as file:
            file.write(b"one\n")
            file.flush()
            time.sleep(0.3)
            file.write(b"two\n")

    writer = threading.Thread(target=write)
    writer.start()
    blocks = list(ArrivingBytes(str(path), stop=stop[0]))
    writer.join()
    assert b"".join(blocks) == b"one\ntwo\n"
    # While nothing came there were empty blocks, so that whoever follows can say what is open.
    assert b"" in blocks


def test_a_pipe_can_be_left_while_its_writer_goes_on(tmp_path, stop):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    descriptor = os.open(path, os.O_RDWR)
    os.write(descriptor, b"one\n")
    found = b""
    for block in ArrivingBytes(str(path), stop=stop[0]):
        found += block
        if found == b"one\n":
            os.write(descriptor, b"two\n")
            stop[1]()
    os.close(descriptor)
    assert found == b"one\ntwo\n"


def test_a_file_that_becomes_shorter_is_another(tmp_path, stop):
    path = tmp_path / "run.csv"
    path.write_bytes(b"one\ntwo\n")
    arriving = iter(ArrivingBytes(str(path), stop=stop[0]))
    assert next(arriving) == b"one\ntwo\n"
    path.write_bytes(b"one\n")
    with pytest.raises(FormatError, match="became shorter"):
        for _ in arriving:
            pass


def test_what_cannot_be_followed(tmp_path, stop):
    with pytest.raises(NotFoundError):
        next(iter(ArrivingBytes(str(tmp_path / "none.csv"), stop=stop[0])))
    with pytest.raises(FormatError, match="is a folder"):
        next(iter(ArrivingBytes(str(tmp_path), stop=stop[0])))
    with pytest.raises(FormatError, match="is a device"):
        next(iter(ArrivingBytes("/dev/zero", stop=stop[0])))
