"""Write docs/criteria.md afresh from the criteria: python man/criteria_page.py."""

from __future__ import annotations

import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from terrain_cli.comparison import comparison_criteria  # noqa: E402 - needs the path above
from terrain_cli.diagnosis import diagnosis_criteria  # noqa: E402
from terrain_cli.improvement import improvement_criteria  # noqa: E402
from terrain_cli.vocabulary.criterion import JUDGED, DeclaredCriterion, criteria_of  # noqa: E402

PAGE = HERE.parent / "docs" / "criteria.md"
MODULES = (comparison_criteria, diagnosis_criteria, improvement_criteria)


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
