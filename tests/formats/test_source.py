"""Which inputs there are, and telling them apart by content."""

from __future__ import annotations

import datetime as dt
import io
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from formats import FormatError, NotFoundError, expand, open_source
from formats.source import parts, takes

CSV = "time,torque\n0,1\n1,2\n"


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def put(*names):
    for name in names:
        path = Path(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        if name.endswith(".parquet"):
            pq.write_table(pa.table({"torque": [1.0, 2.0]}), path)
        else:
            path.write_text(CSV)


def stdin(monkeypatch, data):
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(data)))


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def torque(source):
    return [value for batch in source.read("", ["torque"]) for value in batch["torque"].tolist()]


def test_files_keep_their_order_and_come_once():
    put("b.csv", "a.csv", "odd.name")
    assert expand(["b.csv", "-", "odd.name", "a.csv", "b.csv", "./b.csv", "-"]) == [
        "b.csv",
        "-",
        "odd.name",
        "a.csv",
        "./b.csv",
    ]


def test_patterns():
    put("run10.csv", "run9.csv", "other.csv", "deep/er/run1.csv", "run[1].csv")
    assert expand(["run?.csv", "run[0-9]*.csv"]) == ["run9.csv", "run10.csv"]
    assert expand(["**/run1.csv"]) == ["deep/er/run1.csv"]
    assert expand(["run[1].csv"]) == ["run[1].csv"]
    with pytest.raises(NotFoundError, match="matches no file"):
        expand(["nothing*.csv"])


def test_folder_is_the_logs_directly_inside():
    put(
        *("logs/b.CSV", "logs/a2.tsv", "logs/a10.txt", "logs/c.csv.gz", "logs/d.csv.zst", "logs/e.txt.bz2"),
        *("logs/f.bag", "logs/g.mcap", "logs/h.db3", "logs/i.parquet", "logs/rover.toml", "logs/notes.md"),
        *("logs/.hidden.csv", "logs/_part.csv", "logs/j.parquet.gz", "logs/deeper/k.csv"),
        *("logs/bag2/metadata.yaml", "logs/bag2/bag2_0.mcap", "logs/tree/run=1/x.parquet"),
    )
    names = "a2.tsv a10.txt b.CSV bag2 c.csv.gz d.csv.zst e.txt.bz2 f.bag g.mcap h.db3 i.parquet tree"
    assert expand(["logs"]) == [f"logs/{name}" for name in names.split()]


def test_folder_that_is_one_log():
    put("bag/metadata.yaml", "bag/bag_0.db3")
    put("drive/part-2.parquet", "drive/part-10.parquet", "drive/_SUCCESS", "drive/.crc")
    assert expand(["bag/", "drive"]) == ["bag/", "drive"]


def test_files_of_a_log():
    put(
        "run.csv",
        "bag/metadata.yaml",
        "bag/a.mcap",
        "bag/rover.toml",
        "drive/k=1/a.parquet",
        "drive/b.parquet",
    )
    assert parts("run.csv") == ["run.csv"]
    assert parts("-") == ["-"]
    assert sorted(parts("bag")) == ["bag/a.mcap", "bag/metadata.yaml"]
    assert sorted(parts("drive/")) == ["drive/b.parquet", "drive/k=1/a.parquet"]


@pytest.mark.parametrize(
    "file", ["new.csv", "new.mcap", "new.csv.gz", "new.json", "_new.csv", "new", "x/new.csv"]
)
@pytest.mark.parametrize("name", [".", "*", "*.csv", "**", "n*.csv", "a*", "a.csv", "x"])
def test_what_takes_a_file_is_what_finds_it_once_it_is_there(name, file):
    put("a.csv", "nb.csv", "x/b.csv")
    foretold = takes(name, file)
    put(file)
    assert foretold == (file in [log.removeprefix("./") for log in expand([name])])


def test_nothing_there():
    Path("empty").mkdir()
    for name, message in [("missing.csv", "no such file or folder"), ("empty", "no log in this folder")]:
        with pytest.raises(NotFoundError, match=message) as caught:
            expand([name])
        assert caught.value.exit_code == 66
    with pytest.raises(NotFoundError, match="no such file or folder"):
        open_source("missing.csv")


def test_content_decides_not_the_name():
    put("table.parquet")
    Path("table.parquet").rename("table.csv")
    put("text.bag", "plain")
    for name, kind, remark in [
        ("table.csv", "parquet", ["holds Parquet, whatever its name says"]),
        ("text.bag", "csv", ["holds a text table, whatever its name says"]),
        ("plain", "csv", []),
    ]:
        source = open_source(name)
        assert torque(source) == [1.0, 2.0]
        assert source.kind == kind
        assert source.remarks == remark


def test_bags_are_told_by_their_first_bytes(monkeypatch):
    opened = []
    monkeypatch.setitem(
        sys.modules,
        "formats.rosbag.bag_source",
        SimpleNamespace(
            BagSource=lambda path, kind, **_: (
                opened.append((path, kind)) or SimpleNamespace(kind=kind, remarks=[])
            )
        ),
    )
    put("m/metadata.yaml", "d/metadata.yaml")
    Path("m/metadata.yaml").write_text("rosbag2_bagfile_information:\n  storage_identifier: mcap\n")
    Path("d/metadata.yaml").write_text("rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n")
    for name, data in [("a", b"#ROSBAG V2.0\n"), ("b", b"\x89MCAP0\r\n"), ("c", b"SQLite format 3\0")]:
        Path(name).write_bytes(data)
    for name in "abcmd":
        open_source(name)
    assert opened == [("a", "ros1"), ("b", "mcap"), ("c", "db3"), ("m", "mcap"), ("d", "db3")]


def test_folder_that_is_no_log():
    put("logs/a.csv")
    with pytest.raises(FormatError, match="is a folder"):
        open_source("logs")


@pytest.mark.parametrize("packing", ["", "gzip", "zstd", "parquet"])
def test_standard_input(monkeypatch, here, packing):
    monkeypatch.setattr(tempfile, "tempdir", str(here))
    put("t.parquet")
    data = CSV.encode()
    if packing == "parquet":
        data = Path("t.parquet").read_bytes()
    elif packing:
        sink = pa.BufferOutputStream()
        with pa.CompressedOutputStream(sink, packing) as stream:
            stream.write(data)
        data = sink.getvalue().to_pybytes()
    stdin(monkeypatch, data)
    source = open_source("-")
    assert source.path == "-"
    assert [torque(source), torque(source)] == [[1.0, 2.0]] * 2
    del source
    assert names_in(here) == ["t.parquet"], "the copy is gone with the source"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "standard input: is empty"),
        (b"#ROSBAG V2.0\n", "standard input: a bag cannot be read from a pipe"),
        (b"a,b\n", "standard input: has a header but no rows"),
        (b"PAR1", "standard input: is not a whole Parquet file"),
    ],
)
def test_bad_standard_input(monkeypatch, here, data, message):
    monkeypatch.setattr(tempfile, "tempdir", str(here))
    stdin(monkeypatch, data)
    with pytest.raises(FormatError, match=message):
        open_source("-")
    assert names_in(here) == []


def test_named_pipe_is_read_once_and_kept():
    os.mkfifo("pipe")
    with subprocess.Popen(["sh", "-c", f"printf '{CSV}' > pipe".replace("\n", "\\n")]):
        source = open_source("pipe")
    assert [torque(source), torque(source)] == [[1.0, 2.0]] * 2


def test_no_permission(unprivileged):
    put("secret.csv", "closed/log.csv")
    Path("secret.csv").chmod(0)
    Path("closed").chmod(0)
    for act, argument, name in [
        (open_source, "secret.csv", "secret.csv"),
        (open_source, "closed/log.csv", "closed/log.csv"),
        (expand, ["closed"], "closed"),
        (expand, ["closed/log.csv"], "closed/log.csv"),
    ]:
        with unprivileged(), pytest.raises(NotFoundError) as caught:
            act(argument)
        assert str(caught.value) == f"{name}: no permission to read it"
        assert caught.value.exit_code == 66


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_are_read_without_pandas(tmp_path, ending):
    """It takes half a second to import; pyarrow does so to convert what has gaps, and times."""
    path = tmp_path / f"log.{ending}"
    if ending == "csv":
        lines = ["2026-01-01T00:00:00Z, 1.5, sand", "2026-01-01T00:00:01Z,, ", ", NaN, sand", ", odd, clay"]
        path.write_text("\n".join(["time, load, terrain", *lines * 10]) + "\n")
    else:
        day = dt.datetime(2026, 1, 1, tzinfo=dt.UTC)
        lasting = [dt.timedelta(seconds=1), None] * 20
        columns = {
            "time": [day, None] * 20,
            "load": [1.5, None] * 20,
            "for": lasting,
            "soil": ["a", None] * 20,
        }
        pq.write_table(pa.table(columns), path)
    code = (
        "import sys; from formats import open_source; source = open_source(sys.argv[1])\n"
        "fields = [field.name for field in source.streams()[0].fields]\n"
        "print(sum(len(batch[fields[0]]) for batch in source.read('', fields)), 'pandas' in sys.modules)"
    )
    command = [sys.executable, "-c", code, str(path)]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout == "40 False\n"


@pytest.mark.parametrize(
    ("name", "kind"), [("run.bag", "a ROS 1 bag"), ("run.mcap", "MCAP"), ("run.parquet", "Parquet")]
)
@pytest.mark.parametrize("content", [b"\xe9" * 99, b"\0\1" * 99], ids=["no UTF-8", "binary"])
def test_a_file_that_is_not_what_its_name_says(name, kind, content):
    Path(name).write_bytes(content)
    with pytest.raises(FormatError, match=f"is not {kind}, though its name says so"), open_source(name):
        pytest.fail("it was opened")
