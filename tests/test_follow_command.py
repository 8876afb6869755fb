"""`estimate --follow` as users run it: pipes, files that grow, signals, and a terminal."""

from __future__ import annotations

import csv
import fcntl
import io
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Thread

import pytest
from child_processes import peak
from terminals import on_terminal

from formats.output.whole_files import first_columns
from terrain_cli.presentation.segment_table import COLUMNS

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data"
ROVER = ["--rover", str(SAMPLE / "rover.toml")]
FAST = ["--method", "recursive", "--segments", "fixed", "--window-samples", "100"]


@pytest.fixture(scope="module")
def lines():
    """Return a header and 600 rows, of several wheels."""
    return (SAMPLE / "run.csv").read_text().splitlines(keepends=True)[:601]


def rows_of(text):
    return list(csv.DictReader(io.StringIO(text)))


def of_all(rows):
    """Count the rows that are in segments, used or set aside."""
    return sum(int(row["n_samples"]) + int(row["n_rejected"]) for row in rows)


def offline(terrain_est_here, lines, folder, *args):
    (folder / "whole.csv").write_text("".join(lines))
    done = terrain_est_here("estimate", folder / "whole.csv", "--csv", *args, *ROVER)
    return rows_of(done.stdout)


def test_rows_come_while_the_writer_goes_on(start, lines, tmp_path, terrain_est_here):
    process = start("-", *FAST)
    process.stdin.write("".join(lines[:551]))
    process.stdin.flush()
    early = [process.line() for _ in range(2)]
    assert early[0] == ",".join(COLUMNS) + "\n"
    assert early[1].startswith("-,front-left,1,")
    out, said = process.communicate("".join(lines[551:]), timeout=60)
    assert process.returncode == 0
    assert said == f"rows: 600, late: 0, repeated: 0; segments: {len(rows_of(''.join(early) + out))}\n"
    whole = offline(terrain_est_here, lines, tmp_path, *FAST)
    key = ("wheel", "segment", "t_start_s", "t_end_s", "n_samples", "status")
    found = sorted(tuple(row[name] for name in key) for row in rows_of("".join(early) + out))
    assert found == sorted(tuple(row[name] for name in key) for row in whole)


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_ends_it_with_all_that_had_come(name, start, lines):
    process = start("-", *FAST)
    process.stdin.write("".join(lines))
    process.stdin.flush()
    # The first row shows that it reads.
    head = process.line() + process.line()
    process.send_signal(getattr(signal, name))
    out, said = process.communicate(timeout=60)
    assert process.returncode == 0
    assert of_all(rows_of(head + out)) == 600
    assert "rows: 600" in said


def test_a_file_that_grows_into_one_that_grows(start, lines, tmp_path):
    log, soil = tmp_path / "run.csv", tmp_path / "soil.geojsons"
    log.write_text("".join(lines[:301]))
    process = start(log, "-o", soil, *FAST, "--idle-timeout", "2s")
    deadline = time.monotonic() + 60
    while not (soil.exists() and soil.read_text().endswith("\n")):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    # What is there so far can be read.
    assert json.loads(soil.read_text().split("\x1e")[1])["type"] == "Feature"
    assert first_columns(str(soil))[0][:3] == ["source", "wheel", "segment"]
    with log.open("a") as file:
        file.write("".join(lines[301:]))
    out, _ = process.communicate(timeout=60)
    features = [json.loads(line)["properties"] for line in soil.read_text().split("\x1e")[1:]]
    assert (process.returncode, out) == (0, "")
    assert of_all(features) == 600
    # Started anew, it begins the table anew.
    again = start(log, "-o", soil, *FAST, "--idle-timeout", "100ms")
    again.communicate(timeout=60)
    assert again.returncode == 0
    assert soil.read_text().count("\x1e") == len(features)


def test_killed_and_started_again_while_the_file_grows(start, lines, tmp_path):
    """The table is that of one that was never killed."""
    log, soil, whole = tmp_path / "run.csv", tmp_path / "soil.csv", tmp_path / "whole.csv"
    log.write_text("".join(lines[:301]))
    killed = start(log, "-o", soil, *FAST)
    deadline = time.monotonic() + 60
    while not (soil.exists() and soil.read_text().count("\n") > 1):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    with log.open("a") as file:
        # Within a row, and within a segment.
        file.write("".join(lines[301:450]) + lines[450][:20])
    killed.kill()
    killed.wait()
    with log.open("a") as file:
        file.write(lines[450][20:] + "".join(lines[451:]))
    for table in (soil, whole):
        process = start(log, "-o", table, *FAST, "--idle-timeout", "200ms")
        process.communicate(timeout=60)
        assert process.returncode == 0
    assert soil.read_bytes() == whole.read_bytes()
    assert of_all(rows_of(soil.read_text())) == 600


def paced(process, rows, speed):
    """Write rows so many times as fast as they were driven, with two stalls."""
    began, first = time.monotonic(), float(rows[0].partition(",")[0])
    for number, row in enumerate(rows):
        due = (float(row.partition(",")[0]) - first) / speed if speed else 0.0
        time.sleep(max(began + due - time.monotonic(), 0.3 if speed and number in {40, 90} else 0.0))
        process.stdin.write(row)
        if speed:
            process.stdin.flush()
    process.stdin.close()


def test_the_pace_of_the_rows_is_no_matter(start, lines):
    """At the speed of the drive, 50 times as fast and all at once: rows twice, and rows that are late."""
    rows = lines[1:141]
    rows[30:30] = rows[20:30]
    rows[60], rows[65] = rows[65], rows[60]
    options = ["--segments", "fixed", "--window-samples", "20", "--method", "recursive", "--every", "200ms"]
    writers, processes = [], []
    for speed in (1.0, 50.0, None):
        processes.append(start("-", *options))
        processes[-1].stdin.write(lines[0])
        writers.append(Thread(target=paced, args=(processes[-1], rows, speed)))
        writers[-1].start()
    told = [process.stdout.read().splitlines() for process in processes]
    for writer in writers:
        writer.join()
    # Which of two wheels comes first hangs on how many rows came at once.
    closed = [sorted(line for line in out if line.endswith(",false")) for out in told]
    assert len(closed[0]) == 8
    assert closed[0] == closed[1] == closed[2]
    assert len(told[0]) > len(told[2])
    assert {process.stderr.read() for process in processes} == {
        "rows: 140, late: 3, repeated: 10; segments: 8\n"
    }


def test_a_reader_that_goes_ends_it(start, lines):
    process = start("-", *FAST)
    process.stdin.write("".join(lines[:551]))
    process.stdin.flush()
    process.line()
    process.stdout.close()
    for line in lines[551:]:
        try:
            process.stdin.write(line)
            process.stdin.flush()
        except BrokenPipeError:
            break
    process.stdin.close()
    assert process.wait(timeout=60) == 0
    assert process.stderr.read() in {"", "rows: 600, late: 0, repeated: 0; segments: 6\n"}


def test_open_segments_stand_in_a_last_column(start, lines):
    process = start("-", "--method", "recursive", "--every", "1ms")
    process.stdin.write("".join(lines[:301]))
    process.stdin.flush()
    head = [process.line() for _ in range(2)]
    assert head[0] == ",".join([*COLUMNS, "open"]) + "\n"
    out, _ = process.communicate("".join(lines[301:]), timeout=60)
    rows = rows_of("".join(head) + out)
    assert rows[0]["open"] == "true"
    assert rows[0]["method"] == "recursive"
    closed = [row for row in rows if row["open"] == "false"]
    assert {row["wheel"] for row in closed} == {row["wheel"] for row in rows}
    # Closed segments come last, and are not opened again.
    for last in closed:
        same = [row for row in rows if (row["wheel"], row["segment"]) == (last["wheel"], last["segment"])]
        assert same[-1] is last


def test_rows_told_again_stand_at_the_end(lines, tmp_path, terrain_est_here):
    (tmp_path / "run.csv").write_text("".join(lines))
    cut = ["--segments", "fixed", "--window-samples", "100"]
    done = terrain_est_here(
        "estimate", "--follow", "run.csv", "--again", "--idle-timeout", "1s", *cut, *ROVER, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    rows = rows_of(done.stdout)
    assert list(rows[0]) == [*COLUMNS, "again"]
    first, second = ([row for row in rows if row["again"] == text] for text in ("false", "true"))
    assert rows == [*first, *second]
    whole = {(row["wheel"], row["segment"]): row for row in offline(terrain_est_here, lines, tmp_path, *cut)}
    assert len(second) == len(first) == len(whole)
    for row in second:
        expected = whole[row["wheel"], row["segment"]]
        assert row["status"] == expected["status"]
        assert float(row["c_kPa"]) == pytest.approx(float(expected["c_kPa"]), rel=1e-5)


def test_pictures_are_there_while_rows_still_come(start, lines, tmp_path):
    process = start("-", "--method", "recursive", "--every", "1ms", "--plot", "live")
    process.stdin.write("".join(lines[:400]))
    rest = iter(lines[400:])
    while len(list((tmp_path / "live").glob("convergence*.svg"))) < 3:
        process.stdin.write(next(rest))
        process.stdin.flush()
        time.sleep(0.1)
    process.communicate("".join(rest), timeout=60)
    assert process.returncode == 0
    names = ["convergence-1-front-left", "convergence-2-front-right", "convergence-of-all"]
    assert sorted(path.stem for path in (tmp_path / "live").glob("*.png")) == names


def test_on_a_terminal_rows_are_for_reading_and_one_line_is_redrawn(lines, tmp_path):
    log = tmp_path / "run.csv"
    log.write_text("".join(lines))
    command = [sys.executable, "-m", "terrain_cli", "estimate", "--follow", log, *ROVER, *FAST]
    shown = on_terminal([*command, "--idle-timeout", "300ms"], code=0, PYTHONPATH=str(ROOT))
    assert "front-left  segment 1  " in shown
    assert "\rfront-left: c " in shown
    assert ",segment," not in shown
    assert shown.rstrip().endswith("segments: 6")


def test_a_reader_that_stalls_holds_up_the_writer_and_no_memory_grows(start, lines):
    process = start("-", "--method", "recursive", "--every", "1ms")
    writer, header, wheel = process.stdin.fileno(), lines[0], lines[1].split(",")
    for pipe in (process.stdin, process.stdout):
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, 4096)
    os.set_blocking(writer, False)
    data = header.encode()
    sizes, sent, blocked = [], 0, 0
    # Rows a quarter of a second apart, until the pipe has been full for a while.
    while blocked < 20 and sent < 100_000:
        if not data:
            wheel[0] = repr(1754000000.0 + 0.25 * sent)
            data, sent = ",".join(wheel).encode(), sent + 1
        try:
            data, blocked = data[os.write(writer, data) :], 0
        except BlockingIOError:
            time.sleep(0.1)
            blocked += 1
            sizes.append(peak(process.pid))
    assert blocked == 20
    assert sizes[-1] - sizes[-15] < 2_000
    os.set_blocking(writer, True)
    out, _ = process.communicate(data.decode(), timeout=60)
    assert process.returncode == 0
    assert sum(int(r["n_samples"]) for r in rows_of(out) if r["open"] == "false") == sent


BLOCKS = re.findall(r"^```sh\n(.*?)^```", (ROOT / "docs/follow.md").read_text(), re.MULTILINE | re.DOTALL)
EXAMPLES = [block for block in BLOCKS if "ros2" in block or "mosquitto_sub" in block]


@pytest.mark.parametrize("example", EXAMPLES, ids=["ros2", "mosquitto_sub"])
def test_the_pipes_of_the_page_work(example, bin_folder, tmp_path, lines):
    """With stand-ins that write what the programs do."""
    table = rows_of("".join(lines))
    names = ["load", "torque", "sinkage", "angular_velocity", "velocity"]
    own = [row for row in table if row["wheel"] == table[0]["wheel"]]
    values = "\n".join(
        f"{row['time'].partition('.')[0]},{round(float('0.' + row['time'].partition('.')[2]) * 1e9)},base,"
        + ",".join(row[name] for name in names)
        for row in own
    )
    objects = "\n".join(
        json.dumps(
            {name: row[name] if name == "wheel" else float(row[name]) for name in ("time", "wheel", *names)}
        )
        for row in table
    )
    for name, shown in (("ros2", values), ("mosquitto_sub", objects)):
        (tmp_path / name).write_text(f"#!/bin/sh\ncat <<'END'\n{shown}\nEND\n")
        (tmp_path / name).chmod(0o755)
    (tmp_path / "rover.toml").write_text(
        "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
    )
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail\n{example}"],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={
            **os.environ,
            "PATH": f"{tmp_path}:{bin_folder}:{os.environ['PATH']}",
            "TERRAIN_EST_METHOD": "recursive",
        },
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    count = len(own) if "ros2" in example else len(table)
    assert f"rows: {count}, late: 0, repeated: 0" in done.stderr
    assert (
        done.stdout.startswith("source,wheel") or (tmp_path / "soil.geojsons").read_text().count("\x1e") >= 2
    )


@pytest.mark.parametrize(
    ("args", "code", "said"),
    [
        (["a.csv", "b.csv"], 2, "--follow takes one input, not 2"),
        (["."], 2, "last written to was b.csv"),
        (["a.csv", "-o", "soil.gpkg"], 2, "-o soil.gpkg: a table that grows cannot be .gpkg"),
        (["a.csv", "--trace", "steps.csv"], 2, "--trace needs the whole log"),
        (["a.csv", "--summary", "soil.json"], 2, "--summary needs the whole log"),
        (["a.csv", "--segments", "fixed", "--window-distance", "2"], 2, "counts fixed segments in samples"),
        (["a.csv", "--again", "--method", "ridge"], 2, "--again is for the full model"),
        (["a.csv", "--every", "1x"], 2, "1x is no time, such as 500ms, 1s or 10min"),
        (["a.csv", "--every", "0s"], 2, "0.0 is not in the range"),
        ([str(SAMPLE / "run.parquet")], 65, "holds Parquet, and only CSV, JSON Lines and bags can be"),
        (["none.csv"], 66, "none.csv: no such file"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(args, code, said, tmp_path, terrain_est_here):
    for name in ("a.csv", "b.csv"):
        (tmp_path / name).write_text("time,load\n0,1\n")
    done = terrain_est_here("estimate", "--follow", *args, *ROVER, cwd=tmp_path)
    assert done.returncode == code
    assert said in done.stderr
    assert done.stdout == ""


@pytest.mark.parametrize("option", [["--every", "1s"], ["--again"], ["--idle-timeout", "1s"]])
def test_its_options_need_it(option, tmp_path, terrain_est_here):
    done = terrain_est_here("estimate", SAMPLE / "run.csv", *option)
    assert done.returncode == 2
    assert f"{option[0]} needs --follow" in done.stderr
