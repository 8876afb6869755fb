"""The man pages are those of the commands as they are, and correct for the programs that show them."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from man import generate
from terrain_cli.app import VERBS

FOLDER = Path(generate.__file__).parent
PAGES = {path.name: path for path in sorted(FOLDER.glob("*.1"))}


def output(*command):
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def test_pages_are_not_stale():
    written = {name: generate.undated(path.read_text("utf-8")) for name, path in PAGES.items()}
    now = {name: generate.undated(page) for name, page in generate.pages("2026-01-01").items()}
    assert written == now, "run python man/generate.py"


def test_completion_scripts_are_not_stale():
    scripts = generate.scripts()
    assert {path.parent.name for path in scripts} == {"bash", "zsh", "fish"}
    assert {path: path.read_text("utf-8") for path in scripts} == scripts, "run python man/generate.py"


def test_a_page_does_not_change_with_the_day():
    early, late = generate.pages("2026-01-01"), generate.pages("2031-12-31")
    assert early != late
    assert [*map(generate.undated, early.values())] == [*map(generate.undated, late.values())]


def test_every_verb_has_a_page():
    assert {"terrain-est.1", *(f"terrain-est-{verb}.1" for verb in VERBS)} <= PAGES.keys()


def test_signs_of_roff_are_shown_as_they_stand():
    assert generate.typed(".csv -o ~/a\\b 'φ'") == r"\&.csv \-o \(ti/a\eb \(aq\[u03C6]\(aq"


@pytest.mark.real("mandoc")
@pytest.mark.parametrize("name", PAGES)
def test_mandoc_has_no_warning(name):
    assert not output("mandoc", "-T", "lint", "-W", "warning", PAGES[name])


@pytest.mark.real("groff")
@pytest.mark.parametrize("name", PAGES)
def test_groff_has_no_warning(name):
    assert output("groff", "-man", "-ww", "-T", "utf8", PAGES[name])


@pytest.mark.real("man")
def test_man_shows_what_the_help_says():
    page = subprocess.run(
        ["man", "-l", PAGES["terrain-est-estimate.1"]],
        env={"PATH": "/usr/bin:/bin", "MANWIDTH": "100", "LC_ALL": "C.UTF-8"},
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert "       --window-distance M\n" in page
    assert "TERRAIN_EST_METHOD" in page
    assert '  terrain-est estimate bench.csv --where "slip_angle_deg == 0" --segments none\n' in page
    assert "where c and φ cannot be told apart" in " ".join(page.split())
