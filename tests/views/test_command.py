"""`terrain-est report` as users call it."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from terrain_cli import version

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "sample_data" / "run.csv"


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    """Return the first part of the sample drive, with its rover file beside it."""
    folder = tmp_path_factory.mktemp("drive")
    lines = SAMPLE.read_text("utf-8").splitlines(keepends=True)
    (folder / "run.csv").write_text("".join(lines[:500]), "utf-8")
    (folder / "rover.toml").write_bytes((ROOT / "sample_data" / "rover.toml").read_bytes())
    return folder / "run.csv"


def test_writes_the_same_page_to_a_file_and_to_the_standard_output(
    terrain_est, terrain_est_here, short, tmp_path
):
    page = tmp_path / "run.html"
    done = terrain_est("report", short, "-o", page, "--segments", "none", "--seed", "3")
    assert (done.returncode, done.stdout) == (0, "")
    told = done.stderr.splitlines()
    assert told[::2] == [
        f"{short}  front-left: 240 of 250 samples used",
        f"{short}  front-right: 240 of 249 samples used",
    ]
    assert told[1::2] == [f"  set aside: {n} · wheel stands (ω = 0, slip undefined)" for n in (10, 9)]
    text = page.read_text("utf-8")
    assert text.startswith("<!DOCTYPE html>")
    assert 1e6 < page.stat().st_size < 6e6
    for said in ("Errors of the prediction", "torque T (N m)", "wong-reece", str(short)):
        assert said in text
    assert text.rstrip().endswith("</html>")
    again = terrain_est_here("report", short, "-o", "-", "--segments", "none", "--seed", "3", "-q")
    assert (again.returncode, again.stderr) == (0, "")
    assert again.stdout == text


def test_takes_another_model_and_one_wheel(terrain_est_here, short, tmp_path):
    page = tmp_path / "run.html"
    done = terrain_est_here("report", short, "-o", page, "--model", "linear", "--wheel", "front-left", "-q")
    assert (done.returncode, done.stderr) == (0, "")
    text = page.read_text("utf-8")
    assert "The model linear" in text
    assert not re.search(r"<th scope=.row.>sinkage", text)


def test_needs_a_place_to_write_to(terrain_est_here, short):
    done = terrain_est_here("report", short)
    assert done.returncode == 2
    assert "--output" in done.stderr


def test_says_what_to_install(short, tmp_path):
    code = (
        "import sys; sys.modules['jinja2'] = None\n"
        "from terrain_cli.app import main\n"
        f"main(['report', {str(short)!r}, '-o', {str(tmp_path / 'run.html')!r}])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (78, "")
    assert done.stderr.splitlines() == [
        "terrain-est: a report needs jinja2, which is not installed",
        f"  {version.command_for('report')}",
    ]


def test_compare_draws_pictures(terrain_est_here, short, tmp_path):
    done = terrain_est_here("compare", short, "--segments", "none", "--plot", tmp_path / "pictures")
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (tmp_path / "pictures").iterdir()}
    assert {"predicted-measured.png", "residual-torque.svg", "strength.png", "rim-stress.svg"} <= names
