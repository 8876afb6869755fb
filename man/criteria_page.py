"""Write docs/criteria.md afresh from the criteria: python man/criteria_page.py."""

from __future__ import annotations

import ast
import inspect
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from terrain_cli.comparison import comparison_criteria  # noqa: E402 - needs the path above
from terrain_cli.diagnosis import diagnosis_criteria  # noqa: E402
from terrain_cli.improvement import improvement_criteria  # noqa: E402
from terrain_cli.vocabulary.choices import JUDGED  # noqa: E402

PAGE = HERE.parent / "docs" / "criteria.md"
MODULES = (comparison_criteria, diagnosis_criteria, improvement_criteria)


class DeclaredCriterion(NamedTuple):
    """A number that decides, and why it is that number."""

    module: str
    name: str
    question: str  # What it answers, with others beside it
    remark: str  # Why the answers to one question differ
    #: The one in force.
    value: float
    meaning: str
    evidence: str


def criteria_of(module: ModuleType) -> Iterator[DeclaredCriterion]:
    """Yield the criteria of a module from its source, each under the question that stands above it."""
    question = remark = ""
    for node in ast.parse(inspect.getsource(module)).body[1:]:
        match node:
            case ast.Expr(ast.Constant(str() as words)):
                question, _, remark = (" ".join(part.split()) for part in words.partition("\n"))
            case ast.Assign([ast.Name(name)], ast.Call(ast.Name("criterion"), [_, *said])):
                meaning, evidence = (*map(ast.literal_eval, said), JUDGED)[:2]
                value = getattr(module, name)
                yield DeclaredCriterion(module.__name__, name, question, remark, value, meaning, evidence)


def criteria() -> list[DeclaredCriterion]:
    """Return every criterion of the program."""
    return [one for module in MODULES for one in criteria_of(module)]


def _linked(evidence: str) -> str:
    """Make the study that an evidence begins with a link to its results."""
    return re.sub(r"^(\w+_study)\b", r"[\1](../benchmarks/results/\1.txt)", evidence)


def page() -> str:
    """Write what decides, question by question."""
    every = criteria()
    judged = sum(one.evidence == JUDGED for one in every)
    lines = [
        "# What decides",
        "",
        "These numbers decide what `compare`, `diagnose` and `model add` report. `make man` writes this page",
        "from `comparison_criteria.py`, `diagnosis_criteria.py` and `improvement_criteria.py`.",
        f"Of {len(every)} numbers, {len(every) - judged} have evidence: arithmetic, or a study that used the",
        "value. Such a study does not show that another value is worse. The others are judged: chosen",
        "without a study. How a few drives respond to another value:",
        "[benchmarks/results/criteria_study.txt](../benchmarks/results/criteria_study.txt).",
    ]
    for question in dict.fromkeys(one.question for one in every):
        own = [one for one in every if one.question == question]
        remark = " ".join(dict.fromkeys(one.remark for one in own if one.remark))
        lines += ["", f"## {question}", "", *([remark, ""] if remark else [])]
        lines += ["| value | means | evidence | name |", "| --- | --- | --- | --- |"]
        lines += [
            f"| {one.value:g} | {one.meaning} | {_linked(one.evidence)} |"
            f" `{one.name}` of {one.module.split('.')[1]} |"
            for one in own
        ]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the page if it has changed."""
    if not PAGE.exists() or PAGE.read_text("utf-8") != page():
        PAGE.write_text(page(), encoding="utf-8")
        print("docs/criteria.md")


if __name__ == "__main__":
    main()
