"""The parts of a user's law, and their evaluation with NumPy: of arrays, or of numbers with derivatives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

CONSTANTS = {"pi": math.pi}


class Function(NamedTuple):
    """A function of the language.

    Parameters
    ----------
    evaluate : callable
        Of arrays, or numbers with derivatives.
    least, most : int
        Arguments.
    """

    evaluate: Callable[..., Any]
    least: int = 1
    most: int = 1


FUNCTIONS: dict[str, Function] = {
    "abs": Function(np.absolute),
    "sign": Function(np.sign),
    "sqrt": Function(np.sqrt),
    "exp": Function(np.exp),
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
_ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.true_divide,
    "^": np.power,
}
COMPARE: dict[str, Callable[[Any, Any], Any]] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
}


@dataclass(frozen=True, slots=True)
class Node:
    """A part of a law.

    Parameters
    ----------
    start, end : int
        Its place in the text.
    """

    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Number(Node):
    """A number as it is written."""

    value: float


@dataclass(frozen=True, slots=True)
class Name(Node):
    """A channel, quantity or parameter."""

    name: str


@dataclass(frozen=True, slots=True)
class Negative(Node):
    """A minus sign before a term."""

    operand: Node


@dataclass(frozen=True, slots=True)
class Arithmetic(Node):
    """Two terms joined by ``+ - * / ^``."""

    operator: str
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Call(Node):
    """One of `FUNCTIONS`; the first argument of ``where`` is a condition."""

    function: str
    arguments: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Relation(Node):
    """Terms in a chain: ``0 < slip <= 1``."""

    operators: tuple[str, ...]
    terms: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Logic(Node):
    """Conditions joined by ``and`` or ``or``, or one turned round by ``not``."""

    word: str
    terms: tuple[Node, ...]


def children(node: Node) -> tuple[Node, ...]:
    """Return the parts of which a part of a law is made."""
    match node:
        case Negative(operand=operand):
            return (operand,)
        case Arithmetic(left=left, right=right):
            return (left, right)
        case Call(arguments=parts) | Relation(terms=parts) | Logic(terms=parts):
            return parts
    return ()


def names(node: Node) -> Iterator[Name]:
    """Yield every name that a part of a law reads, where it reads it."""
    waiting = [node]
    while waiting:
        node = waiting.pop()
        if isinstance(node, Name):
            yield node
        waiting.extend(reversed(children(node)))


def evaluate(node: Node, q: Mapping[str, Any]) -> Any:
    """Evaluate a part of a law.

    Parameters
    ----------
    q : mapping of str to ndarray, float or Dual
        Every name that it reads.

    Returns
    -------
    ndarray, float or Dual
        NaN where it is no number.
    """
    with np.errstate(all="ignore"):
        return _value(node, q)


def _value(node: Node, q: Mapping[str, Any]) -> Any:  # noqa: PLR0911 - one for each kind of node
    match node:
        case Number(value=value):
            return value
        case Name(name=name):
            return q[name]
        case Negative(operand=operand):
            return np.negative(_value(operand, q))
        case Arithmetic(operator="^", left=left, right=Number(value=2.0)):
            return np.square(_value(left, q))
        case Arithmetic(operator=operator, left=left, right=right):
            return _ARITHMETIC[operator](_value(left, q), _value(right, q))
        case Call(function=function, arguments=arguments):
            return FUNCTIONS[function].evaluate(*(_value(argument, q) for argument in arguments))
        case Relation(operators=operators, terms=terms):
            values = [_value(term, q) for term in terms]
            pairs = zip(operators, values[:-1], values[1:], strict=True)
            return reduce(np.logical_and, [COMPARE[sign](a, b) for sign, a, b in pairs])
        case Logic(word="not", terms=(term,)):
            return np.logical_not(_value(term, q))
        case Logic(word=word, terms=terms):
            join = np.logical_and if word == "and" else np.logical_or
            return reduce(join, [_value(term, q) for term in terms])
    raise TypeError(node)
