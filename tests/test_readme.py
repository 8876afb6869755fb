"""What the README says is so: its commands run, its examples load, its tables are complete."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from man import generate
from terrain_cli import rover
from terrain_cli.app import EPILOG
from terrain_cli.presentation import segment_table, summary

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text("utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", README, re.MULTILINE | re.DOTALL)
#: These two need the network; .ci/run runs them as they stand.
SETUP = [block for kind, block in BLOCKS if kind == "sh" and "-m venv" in block]


def commands(line):
    """Return the commands of a line without its comment; model files and laws may have any name."""
    alone = line.partition("  #")[0].strip().replace("../sample_data", "sample_data")
    return {re.sub(r"(?<= )[\w.-]+\.toml", "FILE.toml", one.strip()) for one in alone.split("&&")}


#: The test of the tutorial runs these, and checks what they print.
TUTORIAL = {
    command
    for block in re.findall(
        r"^```sh\n(.*?)^```", (ROOT / "docs" / "tutorial.md").read_text("utf-8"), re.MULTILINE | re.DOTALL
    )
    for line in block.splitlines()
    for command in commands(line)
}
LINES = [
    pytest.param(line, marks=pytest.mark.real("ogr2ogr") if "ogr2ogr" in line else ())
    for kind, block in BLOCKS
    if kind == "sh" and block not in SETUP
    for line in block.splitlines()
    if not commands(line) <= TUTORIAL
]


@pytest.fixture
def clone(tmp_path):
    shutil.copytree(ROOT / "sample_data", tmp_path / "sample_data")
    return tmp_path


def environment(bin_folder):
    return {**os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}


def first_cells(heading):
    """Return the names in backticks in the first column of the table with this heading, row by row."""
    table = README.partition(heading)[2].partition("\n\n")[0]
    return [name for row in table.splitlines()[2:] for name in re.findall(r"`(\w[\w-]*)`", row.split("|")[1])]


@pytest.mark.parametrize("line", LINES)
def test_command_runs(line, clone, bin_folder):
    done = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", line],
        cwd=clone,
        env=environment(bin_folder),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    written = re.findall(r"(?:>|-o|--summary|--rejects|--trace|GPKG) (\S+\.\w+)", line)
    assert done.stdout or written
    assert all((clone / name).stat().st_size > 0 for name in written)


def test_commands_in_the_order_of_the_page_meet_no_file_that_they_do_not_replace():
    written = re.findall(r"(?:model new|simulate .*?-o|--draft|--truth) (\S+\.\w+)", README)
    assert len(written) > 3
    assert len(written) == len(set(written))


def test_two_commands_set_up_and_do_everything():
    run, test = (block.strip() for block in SETUP)
    assert run.startswith("python3 -m venv .venv && .venv/bin/pip install ")
    assert run.endswith(" && .venv/bin/terrain-est estimate sample_data/run.bag")
    assert test.startswith("python3 -m venv .venv && .venv/bin/pip install ")
    assert ".venv/bin/pytest" in test
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    assert set(re.findall(r"\[(\w+)\]", test)) <= extras.keys()


def test_every_extra_that_a_page_asks_for_is_there():
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["optional-dependencies"]
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
    asked = {
        extra
        for page in pages
        for several in re.findall(r"(?:\.|terrain-est)\[([a-z,]+)\]", page.read_text("utf-8"))
        for extra in several.split(",")
    }
    assert {"bench", "test"} <= asked <= extras.keys()


@pytest.mark.parametrize("block", [block for kind, block in BLOCKS if kind == "toml"])
def test_rover_file_loads(block, tmp_path):
    (tmp_path / "rover.toml").write_text(block, "utf-8")
    wheel = rover.load(tmp_path / "rover.toml").wheel()
    assert wheel.radius == 0.125
    assert set(wheel.channels) == {"torque", "sinkage", "load"}


@pytest.mark.parametrize("block", [block for kind, block in BLOCKS if kind == "python"])
def test_notebook_example_runs(block, clone, bin_folder):
    done = subprocess.run(
        [sys.executable, "-c", block],
        cwd=clone,
        env=environment(bin_folder),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "front-left" in done.stdout
    assert "strength_kPa" in done.stdout


def test_columns_are_all_there_in_their_order():
    assert tuple(first_cells("| column | meaning |")) == segment_table.COLUMNS


def test_every_status_is_explained():
    assert set(first_cells("| status | what to do |")) == {"ok", *summary.MEANINGS}


def test_exit_codes_are_those_of_the_help():
    table = README.partition("| exit code |")[2].partition("\n\n")[0]
    codes = generate.EXIT_CODE.findall(generate.blocks(EPILOG)["Exit codes"])
    assert set(re.findall(r"\| (\d+) \|", table)) == {code for code, _ in codes}


def test_linked_files_exist():
    for name in ("README.md", "CONTRIBUTING.md", "docs/conventions.md"):
        page = ROOT / name
        links = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text("utf-8"))
        assert [link for link in links if not (page.parent / link).exists()] == []
