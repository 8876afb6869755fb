"""Pages of docs/ as tests: their commands are run, and what they say is printed is what is printed."""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
NUMBER = re.compile(r"(?<![\w.])[-−]?\d+(?:\.\d+)?(?:e-?\d+)?")
#: Another version of NumPy or SciPy may end a fit elsewhere within this.
SHARE = 0.01
#: A line in which a shell has nothing to do but to start the command, and to keep what it prints.
PLAIN = re.compile(r"terrain-est ([^|&;<>$*?~`]+?)(?: > ([\w.-]+))?")


def text_of(name):
    return (ROOT / "docs" / name).read_text("utf-8")


def steps(page):
    """Return each block of commands, with the block after it of what the last of them prints, or ""."""
    return re.findall(r"^```sh\n(.*?)^```\n+(?:```text\n(.*?)^```)?", page, re.MULTILINE | re.DOTALL)


def lines(page):
    return [line for commands, _ in steps(page) for line in commands.splitlines()]


def run(page, folder, bin_folder, terrain_est_here, *, remarks=False):
    """Run every command of a page, one after another in a clone of the data.

    Parameters
    ----------
    folder : Path
        Empty; the data are copied there.
    bin_folder, terrain_est_here
        The fixtures: a shell finds the command in the one, plain lines are run by the other.
    remarks : bool
        What is said on standard error belongs to what is printed.

    Returns
    -------
    outputs : dict of str to str
        What each command prints.
    folder : Path
        Where the last of them ended.
    """
    shutil.copytree(ROOT / "sample_data", folder / "sample_data")
    where = folder.parent / f"{folder.name}.cwd"
    path = os.pathsep.join([str(bin_folder), str(Path(sys.executable).parent), os.environ["PATH"]])
    quiet = {"TERRAIN_EST_QUIET": str(not remarks).lower()}
    env = {**os.environ, "PATH": path, **quiet}
    found = {}
    for line in lines(page):
        if plain := PLAIN.fullmatch(line):
            done = terrain_est_here(*shlex.split(plain[1]), cwd=folder, env=quiet)
            if plain[2]:
                (folder / plain[2]).write_text(done.stdout, "utf-8")
        else:
            # A shell for each line; it begins in the folder where that before it ended.
            command = ["bash", "-euo", "pipefail", "-c", f"{line}\npwd >'{where}'"]
            done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=False)
            folder = Path(where.read_text("utf-8").rstrip("\n")) if done.returncode == 0 else folder
        assert done.returncode == 0, f"{line}\n{done.stderr}"
        found[line] = done.stdout + (done.stderr if remarks else "")
    return found, folder


def assert_printed(text, output):
    """Check that the lines of a block of text are printed, in its order."""
    printed = output.splitlines()
    # An ellipsis stands for lines that are left out.
    place = 0
    for quoted in text.splitlines():
        if quoted.strip() in ("", "…"):
            continue
        after = (at for at in range(place, len(printed)) if alike(quoted, printed[at]))
        at = next(after, None)
        assert at is not None, f"{quoted!r} is not printed after line {place}:\n" + "\n".join(printed)
        place = at + 1


def assert_bold_figures_are_printed(page, outputs):
    """Check that figures in bold are printed by some command, in the unit in which they are told."""
    prose = re.sub(r"^```.*?^```", "", page, flags=re.MULTILINE | re.DOTALL)
    told = [float(text.replace("−", "-")) for text in re.findall(r"\*\*([-−]?\d[\d.]*)", prose)]
    assert told
    printed = {value for text in outputs.values() for value in figures(text)}
    assert [one for one in told if not any(one == pytest.approx(v, rel=SHARE) for v in printed)] == []


def assert_linked_files_exist(page):
    links = re.findall(r"\]\((?!https?:)([^)#]+)", page)
    assert [link for link in links if not (ROOT / "docs" / link).exists()] == []


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
