"""Tables whose time has another name, or none: never steady test points without a word."""

import csv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent.parent
ROVER = ROOT / "sample_data" / "rover.toml"
with (ROOT / "sample_data" / "run.csv").open(encoding="utf-8") as _file:
    HEADER, *ROWS = list(csv.reader(_file))
LEFT = [row for row in ROWS if row[HEADER.index("wheel")] == "front-left"]


def written(path, name, scale=1.0, drop=()):
    """Write the drive of one wheel with another header for its time."""
    kept = [place for place, header in enumerate(HEADER) if header not in {"wheel", *drop}]
    time = HEADER.index("time")
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([name if place == time else HEADER[place] for place in kept])
        for row in LEFT:
            cells = [f"{float(row[time]) * scale!r}" if place == time else row[place] for place in kept]
            writer.writerow(cells)
    return path


def rows(done):
    return list(csv.DictReader(done.stdout.splitlines()))


@pytest.fixture(scope="module")
def plain(tmp_path_factory, terrain_est_here):
    log = written(tmp_path_factory.mktemp("plain") / "run.csv", "time")
    return rows(terrain_est_here("estimate", log, "--rover", ROVER, "--wheel", "front-left"))


@pytest.mark.parametrize(
    "name", ["ts", "sec", "elapsed", "epoch", "header.stamp", "Zeit", "__time", "utc", "t_s", "timestamp"]
)
def test_names_of_a_time(name, plain, tmp_path, terrain_est_here):
    log = written(tmp_path / "run.csv", name)
    found = rows(terrain_est_here("estimate", log, "--rover", ROVER, "--wheel", "front-left"))
    assert [row | {"source": ""} for row in found] == [row | {"source": ""} for row in plain]


def test_what_looks_like_a_time_is_offered_by_name(tmp_path, terrain_est_here):
    log = written(tmp_path / "run.csv", "tick", scale=1.37)
    done = terrain_est_here("estimate", log, "--rover", ROVER, "--wheel", "front-left")
    assert (done.returncode, done.stdout) == (65, "")
    assert "tick" in done.stderr
    assert "time = {" in done.stderr


def test_a_clock_of_whole_seconds_is_offered_too(tmp_path, terrain_est_here):
    log = tmp_path / "run.csv"
    points = [
        f"{k // 4},{80 + 9 * (k % 3)},{2 + 0.3 * (k % 5)},0.0{1 + k % 4},0.{1 + k % 6}" for k in range(48)
    ]
    log.write_text("\n".join(["tick,W,T,z,slip", *points, ""]), "utf-8")
    done = terrain_est_here("estimate", log, "--rover", ROVER, "--wheel", "front-left")
    assert "if 'tick' is the time: [channels] time = { column = \"tick\"" in done.stderr


@pytest.mark.parametrize("verb", ["estimate", "inspect", "compare"])
def test_a_table_without_time_is_said_to_hold_steady_points(verb, tmp_path, terrain_est_here):
    log = tmp_path / "points.csv"
    points = [f"{80 + 9 * (k % 3)},{2 + 0.3 * (k % 5)},0.0{1 + k % 4},0.{1 + k % 6}" for k in range(24)]
    log.write_text("\n".join(["W,T,z,slip", *points, ""]), "utf-8")
    done = terrain_est_here(verb, log, "--rover", ROVER, "--wheel", "front-left")
    assert done.returncode == 0, done.stderr
    assert "steady" in done.stdout + done.stderr


def test_two_marks_of_byte_order_are_read_as_one(plain, tmp_path, terrain_est_here):
    log = written(tmp_path / "run.csv", "time")
    log.write_bytes(b"\xef\xbb\xbf" * 2 + log.read_bytes())
    found = rows(terrain_est_here("estimate", log, "--rover", ROVER, "--wheel", "front-left"))
    assert [row | {"source": ""} for row in found] == [row | {"source": ""} for row in plain]
