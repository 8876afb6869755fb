"""The manifest after a kill, after an editor, and after a later version."""

from __future__ import annotations

import json
import os
from contextlib import closing

import pytest

from formats.errors import CannotWriteError
from terrain_cli.batch.batch_folder import Folder
from terrain_cli.batch.manifest import GrowingFile, ManifestEntry, entries_of, parse


def entry(number=0, **more):
    values = {
        "size": number,
        "stamp": "1-2",
        "sha256": "ab",
        "configuration": "cd",
        "versions": {},
        "status": "ok",
    }
    return ManifestEntry(
        **{"path": f"in/größe-{number}.bag", "location": f"/in/{number}.bag", **values, **more}
    )


def test_what_is_written_is_read(tmp_path):
    written = [
        entry(0),
        entry(1, record=(5, 7, "ef")),
        entry(2, status="failed", error="2.bag: line 1\nline 2\r\x00"),
    ]
    manifest = GrowingFile(tmp_path / "manifest.jsonl", 0)
    for one in written:
        manifest.append(one.line())
    manifest.close()
    assert len((tmp_path / "manifest.jsonl").read_text("utf-8").splitlines()) == 3
    assert entries_of(tmp_path / "manifest.jsonl")[0] == written


def test_a_name_that_is_no_text():
    odd = entry(location="/in/\udcff.bag")
    assert parse(odd.line()) == odd
    odd.line().decode("ascii")


def test_cut_anywhere(tmp_path, monkeypatch):
    monkeypatch.setattr(os, "fsync", lambda _: None)
    path = tmp_path / "manifest.jsonl"
    content = entry(0).line() + entry(1).line()
    first = len(entry(0).line())
    for cut in range(len(content) + 1):
        path.write_bytes(content[:cut])
        entries, size = entries_of(path)
        whole = [entry(0)] * (cut >= first) + [entry(1)] * (cut == len(content))
        assert entries == whole
        manifest = GrowingFile(path, size)
        manifest.append(entry(2).line())
        manifest.close()
        assert entries_of(path)[0] == [*whole, entry(2)]


def test_to_look_changes_nothing(tmp_path):
    path = tmp_path / "manifest.jsonl"
    path.write_bytes(entry(0).line() + b'{"path": "in/')
    with closing(Folder(str(tmp_path), writable=False)) as folder:
        assert list(folder.latest.values()) == [entry(0)]
    assert path.read_bytes().endswith(b'{"path": "in/')


@pytest.mark.parametrize(
    "line", [b"nonsense", b"[1, 2]", b'{"path": "a"}', b"\x00\x00", b"\xff", b"", b"NaN"]
)
def test_a_line_that_says_nothing(tmp_path, line):
    path = tmp_path / "manifest.jsonl"
    path.write_bytes(entry(0).line() + line + b"\n" + entry(1).line())
    assert entries_of(path)[0] == [entry(0), entry(1)]


def test_keys_of_a_later_version():
    assert parse(json.dumps({**json.loads(entry(3).line()), "colour": "red"}).encode()) == entry(3)


def test_a_link_is_not_followed(tmp_path):
    (tmp_path / "victim").write_text("mine")
    (tmp_path / "manifest.jsonl").symlink_to(tmp_path / "victim")
    with pytest.raises(CannotWriteError):
        Folder(str(tmp_path))
    assert (tmp_path / "victim").read_text() == "mine"
