"""Simple conditions on columns: ``--where "slip_angle_deg == 0 and load > 50"``."""

from __future__ import annotations

import ast
import operator
import re
from datetime import UTC, datetime
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from formats import Labels
from terrain_cli.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from formats import Column

    Mask = NDArray[np.bool_]

_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_LONGEST = 1000
_FORM = (
    "a condition compares columns with numbers or texts, joined by and, or, not: "
    "slip_angle_deg == 0 and terrain != 'rock'"
)


class Condition:
    """A condition on the rows of a table or the samples of a wheel.

    Comparisons (``== != < <= > >=``) of column names with numbers or quoted texts, joined by ``and``, ``or``,
    ``not`` and parentheses. A header that is not a plain name stands in backticks: ```load [kN]` > 0.1``.
    Anything else is a UsageError, and never executed.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._quoted: dict[str, str] = {}
        try:
            if len(text) > _LONGEST:
                raise SyntaxError("too long")
            self._tree = ast.parse(re.sub(r"`([^`]+)`", self._quote, text.strip()), mode="eval").body
            self._check(self._tree)
            if not self.names:
                raise SyntaxError("names no column")
        except (SyntaxError, RecursionError, ValueError, MemoryError):
            raise UsageError(f"--where: cannot read {text!r}", hint=_FORM) from None

    def _quote(self, match: re.Match[str]) -> str:
        name = f"quoted_{len(self._quoted)}_"
        self._quoted[name] = match[1].strip()
        return name

    def _check(self, node: ast.AST) -> None:
        match node:
            case ast.BoolOp(values=values):
                for value in values:
                    self._check(value)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                self._check(operand)
            case ast.Compare(left=left, ops=ops, comparators=others):
                if not all(type(op) in _COMPARE for op in ops):
                    raise SyntaxError
                for term in (left, *others):
                    self._check_term(term)
            case _:
                raise SyntaxError

    def _check_term(self, node: ast.AST) -> None:
        match node:
            case ast.Name() | ast.Constant(value=int() | float() | str()):
                pass
            case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float())):
                pass
            case _:
                raise SyntaxError

    @property
    def names(self) -> set[str]:
        """The columns that the condition reads."""
        return {
            self._quoted.get(node.id, node.id) for node in ast.walk(self._tree) if isinstance(node, ast.Name)
        }

    def holds(self, columns: Mapping[str, Column]) -> Mask:
        """Tell in which rows the condition holds: not where it turns on a number or time that is missing."""
        return self._evaluate(self._tree, columns)[0]

    def _evaluate(self, node: ast.AST, columns: Mapping[str, Column]) -> tuple[Mask, Mask]:
        """Return where a condition holds and where it does not: neither where a value is missing."""
        match node:
            case ast.BoolOp(op=op, values=values):
                parts = [self._evaluate(value, columns) for value in values]
                holds, fails = ([part[k] for part in parts] for k in (0, 1))
                if isinstance(op, ast.And):
                    return reduce(np.logical_and, holds), reduce(np.logical_or, fails)
                return reduce(np.logical_or, holds), reduce(np.logical_and, fails)
            case ast.UnaryOp(operand=operand):
                return self._evaluate(operand, columns)[::-1]
            case ast.Compare(left=left, ops=ops, comparators=others):
                n = len(next(iter(columns.values())))
                terms = [self._term(term, columns) for term in (left, *others)]
                pairs = [
                    self._compare(op, a, b, n) for op, a, b in zip(ops, terms[:-1], terms[1:], strict=True)
                ]
                return reduce(np.logical_and, [p[0] for p in pairs]), reduce(
                    np.logical_or, [p[1] for p in pairs]
                )
        raise self._mixed()

    def _term(self, node: ast.AST, columns: Mapping[str, Column]) -> Any:
        if isinstance(node, ast.Name):
            column = columns[self._quoted.get(node.id, node.id)]
            if isinstance(column, Labels):
                return np.array([*column.names, ""], dtype=object)[column.codes]
            return column
        return np.asarray(ast.literal_eval(node))

    def _compare(self, op: ast.cmpop, a: Any, b: Any, n: int) -> tuple[Mask, Mask]:
        if _kind(a) != _kind(b):
            a, b = self._as(a, _kind(b)), self._as(b, _kind(a))
        if _kind(a) != _kind(b):
            raise self._mixed()
        if _kind(a) == "text" and not isinstance(op, ast.Eq | ast.NotEq):
            raise UsageError(f"--where: {self.text!r}: texts are equal or not, and nothing else", hint=_FORM)
        known = np.ones(n, dtype=bool)
        for term in (a, b):
            if term.dtype.kind in "fM":
                known &= ~(np.isnan(term) if term.dtype.kind == "f" else np.isnat(term))
        result = np.asarray(_COMPARE[type(op)](a, b), dtype=bool)
        return result & known, ~result & known

    def _as(self, term: Any, kind: str) -> Any:
        """Bring a constant to the kind of the column it is compared with; columns stay as they are."""
        if term.ndim:
            return term
        value = term.item()
        if kind == "text":
            # A label that reads as a number (run 3, trial 2).
            return np.asarray(f"{value:.15g}")
        if kind == "time" and isinstance(value, str):
            try:
                moment = datetime.fromisoformat(value)
            except ValueError:
                raise self._mixed() from None
            utc = moment if moment.tzinfo is None else moment.astimezone(UTC).replace(tzinfo=None)
            return np.asarray(np.datetime64(utc, "ns"))
        return term

    def _mixed(self) -> UsageError:
        return UsageError(f"--where: {self.text!r} compares what cannot be compared", hint=_FORM)


def _kind(term: Any) -> str:
    return {"O": "text", "U": "text", "M": "time"}.get(term.dtype.kind, "number")
