"""What the README says is so: its commands run, its examples load, its tables are complete."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pages
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
PAGES = {name: pages.text_of(f"{name}.md") for name in ("input", "output", "scripts", "rover", "bags")}


def first_cells(page, heading):
    """Return the names in backticks in the first column of the table with this heading, row by row."""
    table = page.partition(heading)[2].partition("\n\n")[0]
    return [name for row in table.splitlines()[2:] for name in re.findall(r"`(\w[\w-]*)`", row.split("|")[1])]


def test_prints_what_it_says_in_its_order(tmp_path, bin_folder, terrain_est_here):
    page = README
    for block in SETUP:
        page = page.replace(block, "")
    outputs, folder = pages.run(page, tmp_path, bin_folder, terrain_est_here, remarks=True)
    for commands, text in pages.steps(page):
        if text:
            pages.assert_printed(text, outputs[commands.splitlines()[-1]])
    for name in ("soil.csv", "sinks-soil.csv", "report.html", "pictures/ladder.png"):
        assert (folder / name).stat().st_size > 100


@pytest.mark.parametrize("name", ["input", "output"])
def test_commands_of_its_pages_run(name, tmp_path, bin_folder, terrain_est_here):
    _, folder = pages.run(PAGES[name], tmp_path, bin_folder, terrain_est_here)
    written = re.findall(
        r"(?:>|--summary|--rejects|--trace) ([\w-]+\.\w+)", "\n".join(pages.lines(PAGES[name]))
    )
    assert len(written) > 2
    assert all((folder / one).stat().st_size > 0 for one in written)


@pytest.mark.parametrize(("name", "written"), [("rover", ["rover.toml", "soil.csv"]), ("bags", ["soil.csv"])])
def test_commands_of_a_guide_run(name, written, tmp_path, bin_folder, terrain_est_here):
    _, folder = pages.run(PAGES[name], tmp_path, bin_folder, terrain_est_here)
    assert all((folder / one).stat().st_size > 0 for one in written)


def test_it_is_short():
    assert len(README.split()) <= 1_000


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
    texts = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")]
    asked = {
        extra
        for page in texts
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


def test_notebook_example_runs(tmp_path):
    (block,) = (block for kind, block in BLOCKS if kind == "python")
    shutil.copytree(ROOT / "sample_data", tmp_path / "sample_data")
    done = subprocess.run(
        [sys.executable, "-c", block],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "front-left" in done.stdout
    assert "strength_kPa" in done.stdout


def test_columns_are_all_there_in_their_order():
    assert tuple(first_cells(PAGES["output"], "| column | meaning |")) == segment_table.COLUMNS


def test_every_status_is_explained():
    assert set(first_cells(PAGES["output"], "| status | meaning | what to do |")) == {"ok", *summary.MEANINGS}


def test_exit_codes_are_those_of_the_help():
    table = PAGES["scripts"].partition("| exit code |")[2].partition("\n\n")[0]
    codes = generate.EXIT_CODE.findall(generate.blocks(EPILOG)["Exit codes"])
    assert set(re.findall(r"\| (\d+) \|", table)) == {code for code, _ in codes}


def test_linked_files_exist():
    for name in (
        "README.md",
        "CONTRIBUTING.md",
        "docs/conventions.md",
        *(f"docs/{name}.md" for name in PAGES),
    ):
        page = ROOT / name
        links = re.findall(r"\]\((?!https?:)([^)#]+)", page.read_text("utf-8"))
        assert [link for link in links if not (page.parent / link).exists()] == []
