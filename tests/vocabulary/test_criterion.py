"""What decides is declared once, is read where it stands, and is told in docs/criteria.md."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from man import criteria_page

ROOT = Path(criteria_page.__file__).parent.parent
CRITERIA = criteria_page.criteria()
STUDY = re.compile(r"\w+_study\b")


def test_the_page_is_not_stale():
    written = criteria_page.PAGE.read_text("utf-8")
    assert written == criteria_page.page(), "run python man/criteria_page.py"


def test_every_declaration_is_read():
    """Anything else in a module of criteria, or a criterion without a question, would be left out."""
    declared = sum(
        path.read_text("utf-8").count("= criterion(") for path in ROOT.glob("terrain_cli/*/*_criteria.py")
    )
    assert declared == len(CRITERIA)
    assert all(one.question.endswith("?") and one.meaning and one.evidence for one in CRITERIA)


def test_names_stand_once_and_there_are_few():
    assert len({one.name for one in CRITERIA}) == len(CRITERIA) <= 90


def uses():
    """Return the names that the program reads from a module of criteria, and those it takes out of one."""
    read, taken = set(), set()
    for path in ROOT.glob("terrain_cli/**/*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Attribute):
                read.add(node.attr)
            elif isinstance(node, ast.ImportFrom) and str(node.module).endswith("_criteria"):
                taken.add(path.name)
    return read, taken


def test_every_criterion_is_read_from_its_module():
    """One that is taken out of it, or given as a default, would not follow where a study moves it."""
    read, taken = uses()
    assert not {one.name for one in CRITERIA} - read
    assert not taken


def test_no_default_holds_a_criterion():
    names = {one.name for one in CRITERIA}
    held = [
        (path.name, node.lineno)
        for path in ROOT.glob("terrain_cli/**/*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.arguments)
        for default in (*node.defaults, *node.kw_defaults)
        if default is not None
        for node in ast.walk(default)
        if isinstance(node, ast.Attribute) and node.attr in names
    ]
    assert not held


@pytest.mark.parametrize("study", sorted({word for one in CRITERIA for word in STUDY.findall(one.evidence)}))
def test_evidence_of_a_study_can_be_read(study):
    assert (criteria_page.PAGE.parents[1] / "benchmarks" / "results" / f"{study}.txt").is_file()
