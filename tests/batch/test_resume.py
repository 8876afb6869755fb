"""What a batch does again, and what it does not; what it makes of names, copies and changes."""

from __future__ import annotations

import csv
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import missions
import pyarrow.parquet as pq
import pytest

import terrain_cli
from terrain_cli import models
from terrain_cli.app import main
from terrain_cli.batch import worker_tasks
from terrain_cli.presentation import segment_table
from terrain_cli.run import one_log
from terrain_cli.run.settings import Settings

ROOT = Path(__file__).resolve().parent.parent.parent


def test_every_input_has_its_line_and_result(batch, source):
    tally, _ = batch()
    assert dict(tally.counts) == {"ok": 3, "duplicate": 1, "failed": 1}
    lines = missions.by_path()
    assert {path: line["status"] for path, line in lines.items()} == {
        "in/b.csv": "ok",
        "in/copy.csv": "ok",
        "in/day1/a.csv": "duplicate",
        "in/day2/a.csv": "ok",
        "in/empty.csv": "failed",
    }
    ok, bad = lines["in/b.csv"], lines["in/empty.csv"]
    assert (ok["size"], ok["exit_code"], ok["samples"], ok["set_aside"]) == (
        (source / "b.csv").stat().st_size,
        0,
        60,
        0,
    )
    assert ok["versions"]["terrain-est"] == terrain_cli.__version__
    assert ok["seconds"] > 0
    assert len(ok["sha256"]) == 64
    assert (bad["error_class"], bad["error"], bad["exit_code"]) == (
        "FormatError",
        "in/empty.csv: is empty",
        65,
    )
    assert (bad["result"], bad["samples"]) == (None, None)
    assert lines["in/day1/a.csv"]["duplicate_of"] == "in/copy.csv"
    made = sorted(str(path.relative_to("out")) for path in Path("out/results").iterdir())
    assert made == sorted(line["result"] for line in lines.values() if line["result"])
    document = json.loads(Path("out/configurations", f"{ok['configuration']}.json").read_text())
    assert document["rover"] == (source / "rover.toml").read_text()


@pytest.mark.parametrize("kind", ["parquet", "csv"])
def test_a_result_is_what_estimate_writes(batch, kind):
    batch(kind=kind)
    with pytest.raises(SystemExit):
        main(["estimate", "in/b.csv", "-q", "-o", f"b.{kind}"])
    written = Path("out", missions.by_path()["in/b.csv"]["result"])
    assert written.read_bytes() == Path(f"b.{kind}").read_bytes()


def test_the_table_is_that_of_estimate_over_all(batch):
    batch()
    with pytest.raises(SystemExit):
        main(
            [
                "estimate",
                "in/b.csv",
                "in/copy.csv",
                "in/day2/a.csv",
                "-q",
                "-o",
                "all.parquet",
                "--summary",
                "all.json",
            ]
        )
    # In the order of the names, the copy under the first of its names.
    assert missions.sources() == ["in/b.csv", "in/copy.csv", "in/day2/a.csv"]
    assert pq.read_table("out/segments.parquet").equals(pq.read_table("all.parquet"))
    document, whole = (
        json.loads(Path("out/summary.json").read_text()),
        json.loads(Path("all.json").read_text()),
    )
    assert {key: document[key] for key in whole} == whole
    assert document["batch"]["status"] == {"duplicate": 1, "failed": 1, "ok": 3}
    assert [entry["path"] for entry in document["batch"]["failed"]] == ["in/empty.csv"]


def test_nothing_is_done_twice(batch):
    batch()
    before, lines = missions.files("out"), missions.manifest("out")
    tally, did = batch()
    assert did == []
    assert dict(tally.counts) == {"as before": 4, "failed before": 1}
    assert [entry.path for entry in tally.failures.values()] == ["in/empty.csv"]
    assert (missions.files("out"), missions.manifest("out")) == (before, lines)


def test_the_order_of_answers_does_not_matter(batch):
    batch()
    for jobs in (1, 5):
        batch(output=f"out{jobs}", jobs=jobs)
        assert missions.files(f"out{jobs}") == missions.files("out")


def test_only_what_is_new_or_changed_is_done(batch, source):
    batch()
    (source / "new.csv").write_text(missions.drive(0.3))
    (source / "b.csv").write_text(missions.drive(0.4))
    assert batch()[1] == [("Estimate", "in/b.csv"), ("Estimate", "in/new.csv")]
    shutil.rmtree("out")
    after = missions.by_path
    batch()
    fresh = missions.files("out")
    assert after()["in/b.csv"]["status"] == "ok"
    assert missions.sources() == ["in/b.csv", "in/copy.csv", "in/day2/a.csv", "in/new.csv"]
    assert batch()[1] == []
    assert missions.files("out") == fresh


def test_a_change_that_keeps_size_and_time_is_seen(batch, source):
    batch()
    file = source / "b.csv"
    status, content = file.stat(), file.read_text()
    file.write_text(content.replace("2.", "3."))
    os.utime(file, ns=(status.st_atime_ns, status.st_mtime_ns))
    assert file.stat().st_size == status.st_size
    assert batch()[1] == [("Estimate", "in/b.csv")]


def test_a_file_that_is_only_touched_is_not_done_again(batch, source):
    batch()
    before = missions.files("out")
    os.utime(source / "b.csv")
    tally, did = batch()
    assert (did, tally.counts["restored"]) == ([("Restore", "in/b.csv")], 1)
    assert batch()[1] == []
    assert missions.files("out") == before


@pytest.mark.parametrize("change", ["rover", "options", "version", "model", "effect"])
def test_what_decides_on_the_numbers_is_watched(batch, source, monkeypatch, change):
    Path("effect.toml").write_text(
        'id = "brake"\ntitle = "A brake"\nchanges = "torque"\nlaw = "torque + b"\nneeds = ["load"]\n'
        '[parameters.b]\nunit = "N m"\nnull = 0.0\nscale = 0.1\nreference = "own"\n'
    )
    models.save(models.build("linear", ["effect.toml"]), Path("model.toml"))
    whole = change in {"model", "effect"}
    settings = Settings(model="model.toml") if whole else Settings(method=missions.METHOD)
    assert len(batch(settings=settings)[1]) == 4
    assert batch(settings=settings)[1] == []
    if change == "rover":
        (source / "rover.toml").write_text((source / "rover.toml").read_text().replace("0.018", "0.019"))
    elif change == "options":
        settings = replace(settings, method="ridge")
    elif change == "version":
        monkeypatch.setattr(worker_tasks, "__version__", "99.0")
    elif change == "model":
        models.save(models.build("linear", ["effect.toml"], {"shear_modulus": 0.02}), Path("model.toml"))
    else:
        Path("effect.toml").write_text(Path("effect.toml").read_text().replace("scale = 0.1", "scale = 0.2"))
    tally, did = batch(settings=settings)
    assert [path for kind, path in did if kind == "Estimate"] == [
        *("in/b.csv", "in/copy.csv", "in/day2/a.csv", "in/empty.csv")
    ]
    assert tally.counts["duplicate"] == 1


def test_a_model_file_that_changes_in_a_batch_changes_nothing_of_it(batch, monkeypatch):
    models.save(models.build("wong-reece"), Path("model.toml"))
    seen, own = [], one_log.run

    def spy(path, rover, settings, **options):
        Path("model.toml").write_text("nonsense")
        seen.append(settings.model.text)
        return own(path, rover, settings, **options)

    monkeypatch.setattr(one_log, "run", spy)
    tally, _ = batch(settings=Settings(model="model.toml"))
    assert tally.counts["ok"] == 3
    assert len(set(seen)) == 1
    assert "wong-reece" in seen[0]


def test_options_that_come_back_cost_nothing(batch):
    batch()
    before = missions.files("out")
    batch(settings=Settings(method="ridge"))
    assert missions.files("out") != before
    assert [kind for kind, path in batch()[1] if path != "in/empty.csv"] == ["Restore"] * 3
    assert missions.files("out") == before


def test_inputs_done_with_other_options_are_told(batch):
    batch()
    batch("in/b.csv", settings=Settings(method="ridge"))
    document = json.loads(Path("out/summary.json").read_text())
    assert sorted(document["batch"]["configurations"].values()) == [1, 2]
    table = pq.read_table("out/segments.parquet").to_pylist()
    assert {row["source"]: row["method"] for row in table}["in/b.csv"] == "ridge"


def test_force_and_retry(batch, source):
    batch()
    before = missions.files("out")
    assert batch(retry_failed=True)[1] == [("Estimate", "in/empty.csv")]
    assert len(batch(force=True)[1]) == 4
    assert missions.files("out") == before
    (source / "empty.csv").write_text(missions.drive(0.5))
    tally, did = batch()
    assert did == [("Estimate", "in/empty.csv")]
    assert not tally.failures


def test_fail_fast(batch):
    tally, did = batch(jobs=1, fail_fast=True)
    assert list(tally.failures)
    assert ("Estimate", "in/day2/a.csv") not in did
    # The rest next time.
    assert batch()[0].counts["ok"] >= 1
    assert missions.sources() == ["in/b.csv", "in/copy.csv", "in/day2/a.csv"]


def test_a_copy_that_comes_later_or_leaves_first(batch, source):
    batch("in/b.csv")
    shutil.copy(source / "b.csv", source / "a-copy.csv")
    tally, did = batch("in/b.csv", "in/a-copy.csv")
    assert (did, tally.counts["duplicate"]) == ([], 1)
    assert missions.by_path()["in/a-copy.csv"]["duplicate_of"] == "in/b.csv"
    # The table counts it once, under the first name.
    assert missions.sources() == ["in/a-copy.csv"]
    # What the copy holds now stands for itself, and is known.
    (source / "b.csv").write_text(missions.drive(0.7))
    assert batch("in/b.csv", "in/a-copy.csv")[1] == [("Estimate", "in/b.csv"), ("Restore", "in/a-copy.csv")]
    assert missions.sources() == ["in/a-copy.csv", "in/b.csv"]
    other = missions.files("out")
    shutil.rmtree("out")
    batch("in/b.csv", "in/a-copy.csv")
    assert missions.files("out") == other


def test_a_moved_file_is_known(batch, source):
    batch("in/b.csv")
    (source / "b.csv").rename(source / "archive.csv")
    tally, did = batch("in/archive.csv")
    assert (did, tally.counts["duplicate"]) == ([], 1)
    assert len(pq.read_table("out/segments.parquet")) > 0


def test_what_was_taken_away_stays_in_the_table(batch, source):
    batch()
    before = Path("out/segments.parquet").read_bytes()
    (source / "b.csv").unlink()
    batch()
    assert Path("out/segments.parquet").read_bytes() == before
    # Asked for by name, it is missed; what was made of it is not thrown away.
    tally, _ = batch("in/b.csv", "in/copy.csv")
    assert [entry.exit_code for entry in tally.failures.values()] == [66]
    assert Path("out/segments.parquet").read_bytes() == before


def test_a_result_that_is_missing_or_cut_is_written_again(batch):
    batch()
    before = missions.files("out")
    for name in (missions.by_path()["in/b.csv"]["result"], missions.by_path()["in/copy.csv"]["result"]):
        os.truncate(Path("out", name), 100)
        assert [kind for kind, _ in batch()[1]] == ["Restore"]
    Path("out/segments.parquet").unlink()
    os.truncate("out/summary.json", 5)
    assert batch()[1] == []
    assert missions.files("out") == before


@pytest.mark.parametrize("harm", ["gone", "cut", "flipped"])
def test_records_that_are_damaged(batch, harm):
    batch()
    before = missions.files("out")
    records = Path("out/.state/records")
    content = bytearray(records.read_bytes())
    if harm == "gone":
        records.unlink()
    elif harm == "cut":
        records.write_bytes(content[: len(content) // 2])
    else:
        content[len(content) // 2] ^= 1
        records.write_bytes(content)
        Path("out/segments.parquet").unlink()
    batch()
    assert missions.files("out") == before


def test_a_damaged_record_of_what_is_not_there_any_more(batch, source):
    batch()
    with Path("out/.state/records").open("r+b") as file:
        file.write(b"?")
    tally, _ = batch("in/copy.csv")
    assert [entry.error for entry in tally.failures.values()] == ["in/b.csv: what was kept of it is damaged"]
    assert missions.sources() == ["in/copy.csv", "in/day2/a.csv"]
    assert batch()[1] == [("Estimate", "in/b.csv")]
    assert missions.sources() == ["in/b.csv", "in/copy.csv", "in/day2/a.csv"]


def test_another_kind_of_result(batch):
    batch()
    assert {kind for kind, path in batch(kind="csv")[1] if path != "in/empty.csv"} == {"Restore"}
    names = [path.name for path in Path("out/results").iterdir()]
    assert len(names) == 3
    assert all(name.endswith(".csv") for name in names)


def test_further_kinds_of_the_table(batch):
    batch(also=("csv", "geojson", "gpkg"))
    with Path("out/segments.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(pq.read_table("out/segments.parquet"))
    assert tuple(rows[0]) == segment_table.COLUMNS
    assert json.loads(Path("out/segments.geojson").read_text())["features"]
    assert Path("out/segments.gpkg").stat().st_size > 0


def test_no_rows_at_all(batch):
    tally, _ = batch("in/empty.csv")
    assert list(tally.failures)
    table = pq.read_table("out/segments.parquet")
    assert len(table) == 0
    assert set(segment_table.COLUMNS) <= set(table.column_names)
    assert json.loads(Path("out/summary.json").read_text())["terrains"] == []


def test_a_folder_is_no_input_of_itself(batch, source):
    tally, _ = batch("in", "in/**/*.*", output="in")
    assert tally.counts["ok"] == 3
    tally, did = batch("in", "in/**/*.*", output="in")
    assert (did, tally.counts["ok"]) == ([], 0)


def test_a_folder_that_is_one_log(batch, source):
    shutil.copytree(source / "day1", "copy")
    parts = Path("parts")
    parts.mkdir()
    table = pq.read_table(ROOT / "sample_data/run.parquet")
    pq.write_table(table.slice(0, 1000), parts / "part-1.parquet")
    pq.write_table(table.slice(1000), parts / "part-2.parquet")
    assert batch("parts")[0].counts["ok"] == 1
    assert batch("parts")[1] == []
    pq.write_table(table.slice(1000, 500), parts / "part-2.parquet")
    assert batch("parts")[1] == [("Estimate", "parts")]


def test_a_file_that_changes_while_it_is_read_is_done_next_time(batch, source, monkeypatch):
    own = one_log.run

    def meddling(path, rover, settings, **options):
        outcome = own(path, rover, settings, **options)
        if path.endswith("b.csv"):
            with Path(path).open("a") as file:
                file.write("9,9\n")
        return outcome

    monkeypatch.setattr(one_log, "run", meddling)
    tally, _ = batch("in/b.csv", "in/copy.csv")
    (entry,) = tally.failures.values()
    assert (entry.passing, entry.error) == (True, "in/b.csv: was written to while it was read")
    monkeypatch.setattr(one_log, "run", own)
    assert not batch("in/b.csv", "in/copy.csv")[0].failures
