"""The units of a law's terms: only equal units are added, and functions take plain numbers."""

from __future__ import annotations

import ast
from fractions import Fraction
from typing import TYPE_CHECKING

from terrain_cli.effects.laws import expression
from terrain_cli.effects.laws.dimensions import METRE, METRE_TO_N, PLAIN
from terrain_cli.effects.laws.grammar import LawError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from terrain_cli.effects.laws.dimensions import Dimension
    from terrain_cli.effects.laws.expression import Node

#: Characters of a term that an error shows.
_SHOWN = 40


def infer(node: Node, text: str, known: Mapping[str, Dimension]) -> Dimension | None:
    """Find what a part of a law measures; None for a bare 0, which fits any. LawError tells the place."""
    return _Inference(text, known).of(node)


class _Inference:
    def __init__(self, text: str, known: Mapping[str, Dimension]) -> None:
        self.text, self.known = text, known

    def of(self, node: Node) -> Dimension | None:
        match node:
            case ast.Constant(value=value):
                return PLAIN if value else None
            case ast.Name(id=name):
                return self.known[name]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.of(operand)
            case ast.BinOp(op=op, left=left, right=right):
                return self.joined(op, left, right)
            case ast.Call(func=ast.Name(id=function), args=arguments):
                return self.call(function, arguments)
            case ast.Compare(left=left, comparators=others):
                self.alike([left, *others], "compares {1} with {0}")
            case _:
                for term in expression.children(node):
                    self.of(term)
        return PLAIN

    def joined(self, op: ast.operator, left: Node, right: Node) -> Dimension | None:
        if isinstance(op, ast.Add | ast.Sub):
            form = "adds {1} to {0}" if isinstance(op, ast.Add) else "subtracts {1} from {0}"
            return self.alike([left, right], form)
        if isinstance(op, ast.Pow):
            return self.power(left, right)
        a, b = self.of(left), self.of(right)
        if a is None or b is None:
            # 0 · x is as good as 0.
            return None if isinstance(op, ast.Mult) or a is None else a
        return a * b if isinstance(op, ast.Mult) else a / b

    def alike(self, nodes: list[Node], form: str) -> Dimension | None:
        """Return what all terms measure; refuse the first that differs from those before it."""
        found: Dimension | None = None
        first = nodes[0]
        for node in nodes:
            dimension = self.of(node)
            if found is None:
                found, first = dimension, node
            elif dimension not in (None, found):
                shown = [f"{self.shown(n)} ({d})" for n, d in ((first, found), (node, dimension))]
                bare = any(not any(expression.names(n)) for n in (first, node))
                advice = "a number with a unit is a parameter" if bare else ""
                raise LawError(form.format(*shown), self.text, *expression.span(node), advice)
        return found

    def plain(self, node: Node, what: str) -> None:
        dimension = self.of(node)
        if dimension not in (None, PLAIN):
            problem = f"{what} must be a plain number, and {self.shown(node)} is in {dimension}"
            raise LawError(problem, self.text, *expression.span(node), "divide it by something in that unit")

    def power(self, base: Node, exponent: Node) -> Dimension | None:
        dimension = self.of(base)
        self.plain(exponent, "an exponent")
        if dimension in (None, PLAIN):
            return PLAIN
        if not any(expression.names(exponent)):
            return dimension ** Fraction(float(expression.evaluate(exponent, {}))).limit_denominator(60)
        if isinstance(exponent, ast.Name) and exponent.id == "sinkage_exponent" and dimension == METRE:
            # z^n goes with the stiffness, in Pa/m^n.
            return METRE_TO_N
        raise LawError(
            f"{self.shown(base)} is in {dimension} and has a power that is not a constant",
            self.text,
            *expression.span(exponent),
            "divide it by something in that unit first",
        )

    def call(self, function: str, arguments: list[Node]) -> Dimension | None:
        if function == "where":
            self.of(arguments[0])
            return self.alike(arguments[1:], "gives {1} or {0}")
        if function in {"min", "max"}:
            return self.alike(arguments, function + " of {1} and {0}")
        if function in {"abs", "sqrt", "sign"}:
            dimension = self.of(arguments[0])
            if function == "sign" or dimension is None:
                return PLAIN if function == "sign" else None
            return dimension if function == "abs" else dimension ** Fraction(1, 2)
        self.plain(arguments[0], f"what {function} takes")
        return PLAIN

    def shown(self, node: Node) -> str:
        text = " ".join(self.text[slice(*expression.span(node))].split())
        return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"
