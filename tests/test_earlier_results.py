"""A file that is there is replaced only where it is an earlier result of the same kind."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from wheel_table import ROVER, good, text

from formats.output import whole_files
from terrain_cli.app import main
from terrain_cli.commands import named_files, paths

TABLES = ("csv", "parquet", "json", "geojson", "geojsonl", "geojsons", "gpkg")
KEPT = "is there already, and is no earlier result of this kind"
QUICK = ("-q", "--method", "least-squares")


def run(*args):
    with pytest.raises(SystemExit) as end:
        main([str(arg) for arg in args])
    return end.value.code


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return a folder with an earlier result of every kind, as each option writes it."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "rover.toml").write_text(ROVER)
    # One sample is set aside.
    rows = good()
    rows[3][1] = "-1"
    (folder / "run.csv").write_text(text(rows))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for kind in TABLES:
            options = [
                w for name in ("samples", "rejects", "posterior") for w in (f"--{name}", f"{name}.{kind}")
            ]
            assert run("estimate", "run.csv", *QUICK, "-o", f"output.{kind}", *options) == 0
        recursive = ("estimate", "run.csv", "-q", "--method", "recursive", "-o", "output.mcap")
        assert run(*recursive, "--trace", "trace.csv", "--summary", "summary.json") == 0
        assert run("estimate", "run.csv", *QUICK, "-o", "both.gpkg", "--samples", "both.gpkg") == 0
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    shutil.copytree(made, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")


RESULTS = [
    *((name, f"{name}.{kind}") for name in ("output", "samples", "rejects", "posterior") for kind in TABLES),
    ("output", "output.mcap"),
    ("output", "both.gpkg"),
    ("samples", "both.gpkg"),
    ("trace", "trace.csv"),
    ("summary", "summary.json"),
]


def again(option, file):
    """Run the quickest command that writes one file."""
    method = ("-q", "--method", "recursive") if option == "trace" else QUICK
    rest = () if option == "output" else ("-o", "free.csv")
    return run("estimate", "run.csv", *method, *rest, f"--{option}", file)


@pytest.mark.parametrize(("option", "file"), RESULTS)
def test_an_earlier_result_is_replaced(here, option, file):
    before = Path(file).stat().st_ino
    assert again(option, file) == 0
    assert Path(file).stat().st_ino != before


OTHERS = {
    "log.csv": text(good()),
    "blank.csv": "\nnotes of a day\n",
    "more.csv": "day,source,wheel,segment,terrain,t_start_s\n",
    "record.json": '{"source": "a", "wheel": "b"}',
    "numbers.json": "[1, 2, 3]",
    "page.json": "<!DOCTYPE html><title>c_kPa</title>",
    "broken.parquet": "PAR1 and no more",
    "broken.gpkg": "SQLite format 3\0 and no more",
    "rover.csv": ROVER,
}


@pytest.mark.parametrize("option", ["output", "samples", "rejects", "posterior", "trace", "summary"])
def test_a_file_of_others_is_kept(here, capfd, option):
    method = "recursive" if option == "trace" else "least-squares"
    rest = () if option == "output" else ("-o", "free.csv")
    for file, content in OTHERS.items():
        Path(file).write_text(content)
        assert run("estimate", "run.csv", "-q", "--method", method, *rest, f"--{option}", file) == 73
        assert capfd.readouterr() == (
            "",
            f"terrain-est: {file}: {KEPT}\n  --force replaces it\n",
        )
        assert Path(file).read_text() == content
    assert not Path("free.csv").exists()


@pytest.mark.parametrize("file", ["summary.json", "trace.csv", "rejects.parquet", "posterior.geojson"])
def test_a_result_of_another_option_is_kept(here, file):
    before = Path(file).read_bytes()
    assert run("estimate", "run.csv", *QUICK, "-o", file) == 73
    assert Path(file).read_bytes() == before


def test_force_and_empty_files(here):
    Path("log.csv").write_text(OTHERS["log.csv"])
    Path("empty.json").touch()
    Path("link.csv").symlink_to("log.csv")
    assert run("estimate", "run.csv", *QUICK, "-o", "link.csv") == 73
    assert run("estimate", "run.csv", *QUICK, "-o", "link.csv", "--summary", "empty.json", "--force") == 0
    assert Path("log.csv").read_text().startswith("source,wheel")
    # No force writes onto an input.
    assert run("estimate", "run.csv", *QUICK, "-o", "run.csv", "--force") == 2


def test_layers_of_others_in_a_geopackage(here):
    for change in (
        "UPDATE gpkg_contents SET data_type = 'tiles' WHERE table_name = 'segments'",
        "CREATE TABLE mine (fid INTEGER PRIMARY KEY, name TEXT)",
    ):
        shutil.copy("output.gpkg", "mine.gpkg")
        with closing(sqlite3.connect("mine.gpkg")) as database, database:
            database.execute(change)
            if "CREATE" in change:
                database.execute(
                    "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) "
                    "VALUES ('mine', 'attributes', 'mine', 0)"
                )
        assert run("estimate", "run.csv", *QUICK, "-o", "mine.gpkg") == 73


def test_a_page(here):
    Path("page.html").write_text(OTHERS["page.json"])
    assert run("report", "run.csv", "-q", "-o", "page.html") == 73
    assert run("report", "run.csv", "-q", "--model", "linear", "-o", "page.html", "--force") == 0
    assert named_files.PAGE.on("page.html")


def test_pictures(here):
    for name in ("strength.png", "holiday.png"):
        Path("drawn").mkdir(exist_ok=True)
        Path("drawn", name).write_bytes(b"\x89PNG of mine")
    args = ("estimate", "run.csv", *QUICK, "-o", "free.csv", "--plot", "drawn")
    assert run(*args) == 73
    Path("drawn/strength.png").unlink()
    assert run(*args) == 0
    drawn = {path.name for path in Path("drawn").iterdir()} - {"holiday.png"}
    assert drawn
    assert all(map(named_files.PICTURES.fullmatch, drawn))
    assert all(sign.on(name) for name, sign in paths.PICTURES.signed("drawn"))


@pytest.mark.parametrize("name", ["summary.json", "manifest.jsonl", "segments.parquet", "segments.gpkg"])
def test_a_batch_begins_in_no_folder_that_has_such_files(here, name):
    Path("out").mkdir()
    Path("out", name).write_text("mine")
    args = ("batch", "run.csv", "-q", "--method", "least-squares", "-o", "out")
    assert run(*args, "--force") == 73
    assert [path.name for path in Path("out").rglob("*")] == [name]


def test_a_batch_goes_on_without_its_state(here):
    """As when its results were copied, and the state was not."""
    args = ("batch", "run.csv", "-q", "--method", "least-squares", "-o", "out")
    assert run(*args) == 0
    shutil.rmtree("out/.state")
    assert run(*args) == 0


def test_every_table_begins_as_its_sign(made):
    """The signs are the first columns, which the contract fixes."""
    for name in ("output", "samples", "rejects", "posterior"):
        for kind in TABLES:
            (names,) = whole_files.first_columns(str(made / f"{name}.{kind}"))
            header = (made / f"{name}.csv").read_text().partition("\n")[0].split(",")
            assert list(names[:5]) == header[:5], (name, kind)
