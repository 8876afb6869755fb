"""Names, links, pipes and what else lies where inputs and results are looked for."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import missions
import pytest

from formats import CannotWriteError
from terrain_cli.batch.batch_folder import result_name


@pytest.mark.parametrize(
    "name",
    [
        *(
            "with space.csv",
            "new\nline.csv",
            "'quoted\" $(x).csv",
            "-o.csv",
            "…größe.csv",
            "a..csv.csv",
            "%2e%2e.csv",
        ),
        "x" * 251 + ".csv",
    ],
)
def test_any_name_of_a_file(batch, source, name):
    file = source / "day1" / name
    file.write_text(missions.drive(0.9))
    tally, _ = batch("in/day1")
    assert not tally.failures
    (line,) = [line for line in missions.manifest("out") if line["path"] == f"in/day1/{name}"]
    written = Path("out", line["result"])
    assert written.parent == Path("out/results")
    assert written.is_file()
    assert f"in/day1/{name}" in missions.sources()


def test_a_name_that_is_no_text(batch, source):
    file = os.fsencode(source / "day1") + b"/\xff\xfe.csv"
    Path(os.fsdecode(file)).write_text(missions.drive(0.9))
    tally, _ = batch("in/day1")
    assert not tally.failures
    assert r"in/day1/\xff\xfe.csv" in missions.sources()
    assert batch("in/day1")[1] == []


def test_names_of_results_do_not_collide_nor_lead_out():
    names = {
        result_name(location, "csv")
        for location in ("/a/run.bag", "/b/run.bag", "/a/run_bag", "s3://a/run.bag")
    }
    assert len(names) == 4
    for location in ("/a/..", "/", "/a/.hidden", "/a/b\\..\\c", "s3://x/..%2f..", "/a/" + "é" * 300):
        name = result_name(location, "parquet")
        assert name.count("/") == 1
        assert name.isascii()
        assert len(name) < 200
        assert not name.removeprefix("results/").startswith(".")


def test_a_link_in_the_place_of_a_result_is_not_followed(batch):
    batch("in/b.csv")
    written = Path("out", missions.by_path()["in/b.csv"]["result"])
    before = written.read_bytes()
    for link, target in (
        (written, "victim"),
        (Path("out/segments.parquet"), "victim2"),
        (Path("out/.state/new"), "victim3"),
    ):
        Path(target).write_text("mine")
        link.unlink(missing_ok=True)
        link.symlink_to(Path(target).absolute())
    batch("in/b.csv")
    assert [Path(name).read_text() for name in ("victim", "victim2", "victim3")] == ["mine"] * 3
    assert written.read_bytes() == before


@pytest.mark.parametrize("name", ["results", "configurations", ".state"])
def test_a_link_in_the_place_of_a_folder_is_refused(batch, name):
    batch("in/b.csv")
    shutil.move(f"out/{name}", "elsewhere")
    Path("out", name).symlink_to(Path("elsewhere").absolute())
    before = sorted(path.stat().st_mtime_ns for path in Path("elsewhere").rglob("*"))
    with pytest.raises(CannotWriteError, match=f"out/{name}: is a link"):
        batch("in/b.csv", "in/copy.csv")
    assert sorted(path.stat().st_mtime_ns for path in Path("elsewhere").rglob("*")) == before


def test_an_input_may_be_a_link(batch, source):
    Path("archive").mkdir()
    (source / "b.csv").rename("archive/b.csv")
    (source / "b.csv").symlink_to(Path("archive/b.csv").absolute())
    batch("in")
    assert missions.by_path()["in/b.csv"]["status"] == "ok"
    # What it leads to is watched, not the link.
    Path("archive/b.csv").write_text(missions.drive(0.7))
    assert batch("in")[1] == [("Estimate", "in/b.csv")]


def test_a_manifest_that_leads_out_of_the_folder(batch, source):
    batch("in/b.csv")
    Path("mine.csv").write_text("mine")
    manifest = Path("out/manifest.jsonl")
    line = json.loads(manifest.read_text())
    manifest.write_text(json.dumps({**line, "result": "results/../../mine.csv"}) + "\n")
    (source / "b.csv").write_text("")
    batch("in/b.csv")
    assert Path("mine.csv").read_text() == "mine"


def test_a_pipe_and_a_missing_file_do_not_stop_the_rest(batch, source):
    os.mkfifo(source / "pipe.csv")
    (source / "broken.csv").symlink_to("nowhere")
    tally, _ = batch("in", "in/nothing.csv", "in/none*.bag")
    assert tally.counts["ok"] == 2
    assert sorted((entry.path, entry.exit_code) for entry in tally.failures.values()) == [
        ("in/broken.csv", 66),
        ("in/empty.csv", 65),
        ("in/none*.bag", 66),
        ("in/nothing.csv", 66),
        ("in/pipe.csv", 65),
    ]
    lines = len(missions.manifest("out"))
    batch("in", "in/nothing.csv", "in/none*.bag")
    assert len(missions.manifest("out")) == lines
