"""The tutorial: its commands run, and what it says they print is what they print."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
#: A block of commands, and the block after it with what the last of them prints.
STEPS = re.findall(r"^```sh\n(.*?)^```\n+(?:```text\n(.*?)^```)?", PAGE, re.MULTILINE | re.DOTALL)
NUMBER = re.compile(r"(?<![\w.])[-−]?\d+(?:\.\d+)?(?:e-?\d+)?")
#: Another version of NumPy or SciPy may end a fit elsewhere within this.
SHARE = 0.01
LINES = [line for commands, _ in STEPS for line in commands.splitlines()]


@pytest.fixture(scope="module")
def outputs(tmp_path_factory, bin_folder):
    """Run every command of the page, one after another in one folder, and return what each prints."""
    folder = tmp_path_factory.mktemp("clone")
    shutil.copytree(ROOT / "sample_data", folder / "sample_data")
    where = folder.parent / f"{folder.name}.cwd"
    env = {**os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", "TERRAIN_EST_QUIET": "true"}
    found = {}
    for line in LINES:
        # A shell for each line; it begins in the folder where that before it ended.
        command = ["bash", "-euo", "pipefail", "-c", f"{line}\npwd >'{where}'"]
        done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        found[line] = done.stdout
        folder = Path(where.read_text("utf-8").rstrip("\n"))
    return found


def words(line):
    """Return a line without its figures and without what aligns it."""
    return re.sub(r"\s+", " ", NUMBER.sub("#", line)).strip()


def figures(line):
    return [float(text.replace("−", "-")) for text in NUMBER.findall(line)]


def alike(quoted, printed):
    """Tell whether two lines have the same words, and the same figures but for rounding of a last digit."""
    if words(quoted) != words(printed):
        return False
    return figures(quoted) == [pytest.approx(value, rel=SHARE, abs=1e-9) for value in figures(printed)]


@pytest.mark.parametrize(("commands", "text"), [step for step in STEPS if step[1]])
def test_prints_what_the_page_says(commands, text, outputs):
    printed = outputs[commands.splitlines()[-1]].splitlines()
    # An ellipsis stands for lines that are left out.
    place = 0
    for quoted in text.splitlines():
        if quoted.strip() in ("", "…"):
            continue
        after = (at for at in range(place, len(printed)) if alike(quoted, printed[at]))
        at = next(after, None)
        assert at is not None, f"{quoted!r} is not printed after line {place}:\n" + "\n".join(printed)
        place = at + 1


def test_figures_in_the_prose_are_those_of_the_commands(outputs):
    """Figures in bold are printed by some command, in the unit in which they are told."""
    prose = re.sub(r"^```.*?^```", "", PAGE, flags=re.MULTILINE | re.DOTALL)
    told = [float(text.replace("−", "-")) for text in re.findall(r"\*\*([-−]?\d[\d.]*)", prose)]
    assert told
    printed = {value for text in outputs.values() for value in figures(text)}
    assert [one for one in told if not any(one == pytest.approx(v, rel=SHARE) for v in printed)] == []


def test_every_log_of_the_tutorial_is_used_and_small():
    for path in (ROOT / "sample_data" / "tutorial").iterdir():
        assert path.stat().st_size <= 300_000
        assert path.suffix != ".csv" or any(path.name in line for line in LINES)


def test_linked_files_exist():
    links = re.findall(r"\]\((?!https?:)([^)#]+)", PAGE)
    assert [link for link in links if not (ROOT / "docs" / link).exists()] == []
