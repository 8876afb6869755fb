"""The parts of a user's law, and their evaluation with NumPy: of arrays, or of numbers with derivatives.

A law is a tree of Python's own `ast`, as `terrain_cli.effects.laws.grammar` makes it: of few kinds, with
numbers as floats, and with places in the text of the law.
"""

import ast
import math
from collections.abc import Callable, Iterator, Mapping
from functools import reduce
from typing import Any, NamedTuple, TypeAlias

import numpy as np

CONSTANTS = {"pi": math.pi}


class Function(NamedTuple):
    evaluate: Callable[..., Any]  # Of arrays, or numbers with derivatives
    # least, most: arguments
    least: int = 1
    most: int = 1


FUNCTIONS: dict[str, Function] = {
    "abs": Function(np.absolute),
    "sign": Function(np.sign),
    "sqrt": Function(np.sqrt),
    "exp": Function(np.exp),
    "expm1": Function(np.expm1),
    "log": Function(np.log),
    "ln": Function(np.log),
    "log10": Function(lambda x: np.true_divide(np.log(x), math.log(10.0))),
    "sin": Function(np.sin),
    "cos": Function(np.cos),
    "tan": Function(np.tan),
    "asin": Function(np.arcsin),
    "acos": Function(np.arccos),
    "atan": Function(np.arctan),
    "tanh": Function(np.tanh),
    "min": Function(lambda *x: reduce(np.minimum, x), 2, 10),
    "max": Function(lambda *x: reduce(np.maximum, x), 2, 10),
    "where": Function(np.where, 3, 3),
}
_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.true_divide,
    ast.Pow: np.power,
}
_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}
Node: TypeAlias = ast.expr


def span(node: Node) -> tuple[int, int]:
    """Return where a part of a law begins and ends in its text."""
    return node.col_offset, node.end_col_offset or node.col_offset


def is_condition(node: Node) -> bool:
    """Tell what holds or does not from a number."""
    return isinstance(node, ast.Compare | ast.BoolOp) or (
        isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
    )


def children(node: Node) -> list[Node]:
    """Return the parts of which a part of a law is made."""
    if isinstance(node, ast.Call):
        return node.args
    return [part for part in ast.iter_child_nodes(node) if isinstance(part, ast.expr)]


def names(node: Node) -> Iterator[ast.Name]:
    """Yield every name that a part of a law reads, where it reads it."""
    waiting = [node]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.Name):
            yield node
        waiting.extend(reversed(children(node)))


def evaluate(node: Node, q: Mapping[str, Any]) -> Any:
    """Evaluate a part of a law, of arrays or numbers with derivatives; NaN where it is no number."""
    with np.errstate(all="ignore"):
        return _value(node, q)


def _value(node: Node, q: Mapping[str, Any]) -> Any:  # noqa: PLR0911 - one for each kind of node
    match node:
        case ast.Constant(value=value):
            return value
        case ast.Name(id=name):
            return q[name]
        case ast.UnaryOp(op=op, operand=operand):
            return (np.logical_not if isinstance(op, ast.Not) else np.negative)(_value(operand, q))
        case ast.BinOp(op=ast.Pow(), left=left, right=ast.Constant(value=2.0)):
            return np.square(_value(left, q))
        case ast.BinOp(op=op, left=left, right=right):
            return _ARITHMETIC[type(op)](_value(left, q), _value(right, q))
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name].evaluate(*(_value(argument, q) for argument in arguments))
        case ast.Compare(left=left, ops=ops, comparators=others):
            values = [_value(term, q) for term in (left, *others)]
            pairs = zip(ops, values[:-1], values[1:], strict=True)
            return reduce(np.logical_and, [_COMPARE[type(op)](a, b) for op, a, b in pairs])
        case ast.BoolOp(op=op, values=terms):
            join = np.logical_and if isinstance(op, ast.And) else np.logical_or
            return reduce(join, [_value(term, q) for term in terms])
    raise TypeError(node)
