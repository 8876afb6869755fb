"""Everything that goes wrong with inputs, through the command line.

Each ends in one clear line and its exit code, or in samples set aside and counted by reason; never
in a traceback, never in half an output.
"""

from __future__ import annotations

import csv
import gzip
import os
import shutil
import sqlite3
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from wheel_table import HEADER, ROVER, TIME, N, good, text, write

from terrain_cli.app import main

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder that holds a rover file and nothing else."""
    (tmp_path / "rover.toml").write_text(ROVER)
    monkeypatch.chdir(tmp_path)
    # The quickest: what is refused or set aside is the same for all estimators.
    monkeypatch.setenv("TERRAIN_EST_METHOD", "least-squares")
    return tmp_path


@pytest.fixture
def run(folder, capfd):
    """Return a function that runs the command here and returns exit code, stdout and stderr."""

    def run(*args):
        with pytest.raises(SystemExit) as end:
            main([str(arg) for arg in args])
        captured = capfd.readouterr()
        assert "Traceback" not in captured.err
        return end.value.code, captured.out, captured.err

    return run


@pytest.fixture
def refused(folder, run):
    """Return a function that asserts that estimate refuses an input: one line, a hint, no output.

    The samples set aside are `kept` where there were any to judge.
    """

    def refused(path, code, *says, options=(), kept=()):
        before = sorted(folder.iterdir())
        outputs = ("-o", "soil.gpkg", "--summary", "soil.json", "--rejects", "rejects.csv")
        end, out, err = run("estimate", path, *outputs, *options)
        message, *hint = err.splitlines()
        assert end == code, err
        assert out == ""
        assert message.startswith(f"terrain-est: {path}: ")
        assert all(line.startswith("  ") for line in hint)
        for part in says:
            assert part in err
        assert sorted(folder.iterdir()) == sorted([*before, *(folder / name for name in kept)])
        return err

    return refused


@pytest.fixture
def set_aside(folder, run):
    """Return a function that asserts which samples estimate sets aside, and for which reasons."""

    def set_aside(path, reasons, samples=N, *, says=(), options=()):
        code, out, err = run("estimate", path, "--segments", "none", "--rejects", "rejects.csv", *options)
        assert code == 0, err
        for reason, count in reasons.items():
            assert f"  set aside: {count} · {reason}\n" in err
        for part in says:
            assert part in err
        rows = list(csv.DictReader(out.splitlines()))
        assert sum(int(row["n_samples"]) for row in rows) == samples - sum(reasons.values())
        assert sum(int(row["n_rejected"]) for row in rows) == sum(reasons.values())
        with Path("rejects.csv").open() as file:
            rejects = list(csv.DictReader(file))
        told = [row["reason"] for row in rejects]
        assert {reason: told.count(reason) for reason in told} == reasons
        return rejects

    return set_aside


def test_good_input_is_good(set_aside):
    assert set_aside(write("run.csv", text(good())), {}) == []


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "is empty"),
        ("\n\n", "has no table in it"),
        (text([]), "has a header but no rows"),
        (text(good()).partition("\n")[2], "line 1 holds values where the names of the columns should be"),
        (
            text([["1", "2"]] * 5, ("a", "b")),
            "load, torque, sinkage and slip are neither measured nor derived",
        ),
        (text(good(), ("time", "load_mm", *HEADER[2:])), "'mm' is a unit of length; load takes N"),
        (text(good(), ("time", "load [bananas]", *HEADER[2:])), "'bananas' is not a known unit"),
        (
            text(good(), ("time", "W", "vertical_load", *HEADER[3:])),
            "columns 'W' and 'vertical_load' can all be",
        ),
        (text(good(), ("time", "load", "load", *HEADER[3:])), "two columns are named 'load'"),
        (
            text([["soon", *row[1:]] for row in good()]),
            "column 'time' holds texts that are no times, such as 'soon'",
        ),
        (b"\xff\xd8\xff\xe0" + bytes(range(256)) * 8, "is binary, of a kind that is not read"),
        (text(good()).encode()[:-40] + b"\xe9t\xe9\n", "byte 0xe9 is not UTF-8 text"),
    ],
    ids=lambda value: value[:12] if isinstance(value, str) else "bytes",
)
def test_tables_that_are_none(refused, content, says):
    refused(write("run.csv", content), 65, says)


@pytest.mark.parametrize("scale", [1e3, 1e6, 1e9], ids=["ms", "us", "ns"])
@pytest.mark.parametrize("start", [0, 1_754_000_000])
def test_a_clock_that_is_not_in_seconds(refused, run, folder, scale, start):
    rows = [[str(round((float(row[0]) + start) * scale)), *row[1:]] for row in good()]
    unit = {1e3: "ms", 1e6: "us", 1e9: "ns"}[scale]
    err = refused(write("run.csv", text(rows)), 65, "column 'time'", "seconds", f"(time_{unit})")
    # The lines of the hint are enough.
    with (folder / "rover.toml").open("a") as file:
        file.write("".join(line[2:] + "\n" for line in err.splitlines()[2:]))
    code, out, _ = run("estimate", "run.csv", "--segments", "none")
    assert code == 0
    (row,) = csv.DictReader(out.splitlines())
    assert float(row["t_end_s"]) == pytest.approx(start + TIME[-1], abs=1e-6)
    # As is the unit in the header.
    (folder / "rover.toml").write_text(ROVER)
    write("run.csv", text(rows, (f"time_{unit}", *HEADER[1:])))
    assert run("estimate", "run.csv", "--segments", "none")[:2] == (0, out)


def changed(**cells):
    """Return good rows of which some cells of one column are others."""
    rows = good()
    for name, (places, value) in cells.items():
        for place in places:
            rows[place][HEADER.index(name)] = value
    return rows


@pytest.mark.parametrize(
    ("cells", "reason"),
    [
        ({"torque": (range(5), "")}, "no torque"),
        ({"torque": ([7, 8], "NaN")}, "no torque"),
        ({"sinkage": ([7], "n/a")}, "no sinkage"),
        ({"load": ([0, N - 1], "overload")}, "no load"),
        ({"load": ([3], "inf")}, "load is infinite"),
        ({"torque": ([3], "-Infinity")}, "torque is infinite"),
        ({"velocity": ([3], "inf")}, "velocity is infinite"),
        ({"angular_velocity": ([3, 4], "inf")}, "angular_velocity is infinite"),
        ({"velocity": ([3], "fast")}, "no slip"),
        ({"sinkage": (range(20, 26), "-0.003")}, "sinkage not positive"),
        ({"sinkage": ([9], "0")}, "sinkage not positive"),
        ({"sinkage": ([9, 10], "0.125")}, "sinkage beyond the wheel radius"),
        ({"sinkage": ([9, 10], "13.1")}, "sinkage beyond the wheel radius"),
        ({"load": ([1], "-80")}, "load not positive"),
        ({"load": ([1, 60], "1e90")}, "load beyond what soil bears"),
        ({"torque": ([1], "-1e90")}, "torque beyond what soil takes"),
        ({"angular_velocity": ([1], "1e90")}, "angular_velocity beyond that of any vehicle"),
        ({"angular_velocity": (range(50, 90), "0")}, "wheel stands (ω = 0, slip undefined)"),
        ({"velocity": ([40], "-0.1")}, "wheel rolls against its drive (slip > 1)"),
        ({"time": ([60], "")}, "no time"),
        ({"time": ([60], "later")}, "no time"),
        ({"time": (range(60, 64), "0.5")}, "time runs backwards"),
        ({"time": (range(60, 63), "2.95")}, "time repeated"),
        ({"time": ([60], "9e9")}, "time runs backwards"),
    ],
)  # fmt: skip
def test_samples_that_cannot_be_used(set_aside, cells, reason):
    places = next(iter(cells.values()))[0]
    rejects = set_aside(write("run.csv", text(changed(**cells))), {reason: len(places)})
    assert [int(row["sample"]) for row in rejects] == [place + 1 for place in places]


def test_the_line_cannot_use_a_wheel_that_skids(set_aside, run):
    skids = text(changed(velocity=(range(40, 45), "0.2")))
    set_aside(write("run.csv", skids), {"wheel skids (slip < 0)": 5})
    set_aside(write("run.csv", skids), {}, options=("--method", "auto"))
    # By default the full model is asked, which can.
    code, out, err = run("inspect", "run.csv")
    assert code == 0, err
    assert f"{N} samples can be used" in out


def test_reasons_are_counted_beside_each_other(set_aside):
    rows = changed(torque=([1, 2], ""), load=([2, 3], "-1"), sinkage=([5], "inf"))
    told = {"no torque": 2, "load not positive": 1, "sinkage is infinite": 1}
    set_aside(write("run.csv", text(rows)), told)


def test_texts_in_numbers_are_told_with_their_row(set_aside):
    rows = changed(load=([4, 9], "overload"))
    says = ["row 6: load is 'overload', not a number (2 such"]
    set_aside(write("run.csv", text(rows)), {"no load": 2}, says=says)


def test_nothing_that_can_be_used(folder, refused):
    untimed = write("run.csv", text([["", *row[1:]] for row in good()]))
    refused(untimed, 65, "none of 200 samples can be used (no time: 200)", kept=["rejects.csv"])
    (folder / "rejects.csv").unlink()
    rows = changed(load=(range(N), "-80"), torque=([1, 2], ""))
    says = "none of 200 samples can be used (load not positive: 198, no torque: 2)"
    err = refused(write("run.csv", text(rows)), 65, says, kept=["rejects.csv"])
    assert (folder / "rejects.csv").read_text().count("load not positive") == 198
    assert "load = { …, scale = -1 }" in err
    (folder / "rejects.csv").unlink()
    backwards = write("run.csv", text(changed(velocity=(range(N), "-0.1"))))
    err = refused(backwards, 65, "against its drive", kept=["rejects.csv"])
    assert "angular_velocity = { …, scale = -1 }" in err


def test_a_unit_by_which_nothing_can_be_used_is_told(folder, refused):
    rows = [[*row[:5], f"{3.6 * float(row[5]):.6g}"] for row in good()]
    path = write("run.csv", text(rows))
    err = refused(path, 65, "wheel skids", kept=["rejects.csv"], options=("--method", "least-squares"))
    assert 'if velocity is in km/h, velocity = { column = "velocity", unit = "km/h" }' in err


def test_a_log_written_backwards(set_aside, run):
    path, aside = write("run.csv", text(good()[::-1])), {"time runs backwards": N - 1}
    set_aside(path, aside, says=[f"time runs backwards in {N - 1} of {N} samples: sort the rows by time"])
    for verb in ("compare", "diagnose"):
        code, out, _ = run(verb, path, "-q")
        assert code == 0
        assert out.endswith("The rows are not in the order of time: sort them by it.\n")


@pytest.mark.parametrize("verb", ["compare", "diagnose"])
def test_texts_in_numbers_are_told_by_every_verb(verb, run):
    code, out, _ = run(verb, write("run.csv", text(changed(load=([4, 9], "overload")))), "-q")
    assert code == 0
    assert "note: run.csv: row 6: load is 'overload', not a number (2 such cells)" in out


def test_a_log_without_geometry(folder, run):
    (folder / "rover.toml").unlink()
    code, out, err = run("estimate", write("run.csv", text(good())), "-o", "soil.csv")
    assert (code, out) == (78, "")
    assert err.startswith("terrain-est: there is no rover.toml to give the radius and width of the wheel and")
    assert "  [wheel]\n  radius = …  # m\n  width = …  # m\n  [soil]\n  shear_modulus = …" in err
    assert not Path("soil.csv").exists()


def test_a_rover_file_that_is_wrong(folder, run):
    (folder / "rover.toml").write_text(ROVER.replace("radius", "raduis"))
    code, out, err = run("estimate", write("run.csv", text(good())))
    assert (code, out) == (78, "")
    assert "wheel.raduis: unknown key; did you mean radius?" in err


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Hold the sample drive in the kinds of bag that the samples do not have."""
    folder = tmp_path_factory.mktemp("bags")
    shutil.copy(SAMPLE / "run.bag", folder)
    shutil.copy(SAMPLE / "run.mcap", folder)
    with sqlite3.connect(folder / "run.db3") as base:
        base.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT)")
        base.executemany("INSERT INTO topics(name) VALUES (?)", [("x" * 4000,)] * 50)
    base.close()
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("share", [0.999, 0.5, 0.01])
@pytest.mark.parametrize("name", ["run.bag", "run.mcap", "run.db3"])
def test_a_bag_cut_in_the_middle(refused, run, bags, name, share):
    content = bags[name]
    write(name, content[: int(share * len(content))])
    refused(name, 65)
    code, out, err = run("inspect", name)
    assert (code, out) == (65, "")
    assert err.startswith(f"terrain-est: {name}: ")


def without_definition(path, topic="/odom"):
    """Write the sample drive with the definition of one topic's type left out."""
    from rosbags.rosbag1 import Reader, Writer

    with Reader(SAMPLE / "run.bag") as reader, Writer(path) as writer:
        connections = {}
        for connection in reader.connections:
            own = "" if connection.topic == topic else connection.msgdef.data
            kind = "lost_msgs/msg/Own" if connection.topic == topic else connection.msgtype
            connections[connection.id] = writer.add_connection(
                connection.topic, kind, msgdef=own, md5sum=connection.digest
            )
        for connection, time, payload in reader.messages():
            writer.write(connections[connection.id], time, payload)


def test_a_topic_with_no_definition(folder, run, refused):
    shutil.copy(SAMPLE / "rover.toml", folder)
    without_definition(folder / "run.bag")
    code, out, err = run("inspect", "run.bag")
    assert (code, err) == (0, "")
    assert "/odom cannot be read: lost_msgs/msg/Own: the file has no definition of it" in out
    assert "not measured, and there is no velocity to derive it from" in out
    refused("run.bag", 65, "slip is neither measured nor derived", "velocity = { topic = ")
    # Asked for, it is said why it cannot be had.
    with (folder / "rover.toml").open("a") as file:
        file.write(
            '[channels]\nvelocity = { topic = "/odom", field = "twist.twist.linear.x", unit = "m/s" }\n'
        )
    code, out, err = run("estimate", "run.bag")
    assert (code, out) == (78, "")
    assert "topic /odom has no field 'twist.twist.linear.x'" in err


@pytest.mark.parametrize("cut", [slice(None, -20), slice(None, 100), slice(4, None)])
def test_a_parquet_file_that_is_not_whole(refused, cut):
    table = {name: np.array([float(row[j]) for row in good()]) for j, name in enumerate(HEADER)}
    pq.write_table(pa.table(table), "whole.parquet")
    refused(write("run.parquet", Path("whole.parquet").read_bytes()[cut]), 65)


def test_a_packed_table_that_is_cut(refused):
    cut = gzip.compress(text(good()).encode())[:-500]
    refused(write("run.csv.gz", cut), 65, "is cut off: its gzip data end too early")


def test_no_such_input(refused):
    refused("nothing.csv", 66, "no such file")


def test_one_bad_input_among_good_ones(folder, run):
    write("a.csv", text(good()))
    write("b.csv", "")
    code, out, err = run("estimate", "a.csv", "b.csv", "-o", "soil.csv")
    assert (code, out) == (65, "")
    assert err == "terrain-est: b.csv: is empty\n"
    assert not Path("soil.csv").exists()


@pytest.mark.parametrize("verb", ["inspect", "estimate"])
def test_no_permission_to_read(folder, run, verb):
    write("run.csv", text(good()))
    # All is imported now: another user may not be able to read this Python.
    assert run(verb, "run.csv")[0] == 0
    folder.chmod(0o755)
    Path("run.csv").chmod(0)
    user = os.geteuid()
    if user == 0:
        # Permissions do not bind root.
        os.seteuid(65_534)
    try:
        code, out, err = run(verb, "run.csv")
    finally:
        os.seteuid(user)
    assert (code, out, err) == (66, "", "terrain-est: run.csv: no permission to read it\n")


@pytest.mark.parametrize("output", ["nowhere/soil.csv", "soil.xlsx", "."])
def test_an_output_that_cannot_be(folder, run, output):
    code, out, err = run("estimate", write("run.csv", text(good())), "-o", output)
    assert (code, out) == (73, "")
    assert err.startswith(f"terrain-est: {output}: ")
    assert output != "soil.xlsx" or err.endswith(".geojsons, .mcap\n"), "not all that it writes is named"


@pytest.mark.parametrize(
    ("verb", "option", "output"),
    [
        ("estimate", "-o", "nowhere/soil.csv"),
        ("estimate", "--summary", "nowhere/soil.json"),
        ("estimate", "--posterior", "nowhere/soil.csv"),
        ("estimate", "--plot", "run.csv/pictures"),
        ("compare", "--plot", "run.csv/pictures"),
        ("diagnose", "--plot", "run.csv/pictures"),
        ("diagnose", "--draft", "nowhere/law.toml"),
        ("report", "-o", "nowhere/page.html"),
        ("batch", "-o", "run.csv/results"),
    ],
)
def test_an_output_that_cannot_be_is_told_before_the_work(verb, option, output, run, monkeypatch):
    monkeypatch.setattr("formats.open_source", lambda *_, **__: pytest.fail("an input was read"))
    code, out, err = run(verb, write("run.csv", text(good())), option, output)
    hint = "  make it first, or name another\n" if output.startswith("nowhere") else ""
    assert (code, out, err) == (73, "", f"terrain-est: {output}: no such folder\n{hint}")
