"""What decides what a user is told: numbers, each with its meaning and its evidence."""

from __future__ import annotations

import ast
import inspect
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import ModuleType

Number = TypeVar("Number", int, float)
#: Chosen by whoever wrote it: no study tells whether another value would do better.
JUDGED = "judged"


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


def criterion(value: Number, meaning: str, evidence: str = JUDGED) -> Number:  # noqa: ARG001 - see below
    """Declare a number that decides. What is said of it is read from the source, by `criteria_of`."""
    return value


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
