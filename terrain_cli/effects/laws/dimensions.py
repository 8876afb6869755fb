"""Units of a user's effect: what a text such as ``N s/rad`` is in SI, and whether a law's terms go together.

A dimension is a product of powers of kg, m, s, K and A. Angles are plain numbers. The stiffness of
Bekker's law is in Pa/m^n with n the sinkage exponent, so m^n stands beside them as if it were a
unit of its own. Only equal units are added, and functions take plain numbers.
"""

from __future__ import annotations

import ast
import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import tau
from typing import NamedTuple, NoReturn

from terrain_cli.effects.laws import expression
from terrain_cli.effects.laws.expression import Node
from terrain_cli.effects.laws.grammar import LawError
from terrain_cli.errors import ConfigurationError
from terrain_cli.vocabulary import units

_BASE = ("kg", "m", "s", "K", "A", "m^n")
#: Bounds of the text of a unit: characters, powers.
_LONGEST = 60
_HIGHEST = 12
#: Largest size, over that of the SI unit.
_LARGEST = 1e30
_FORM = "such as N s/rad, kPa, Pa/m^1.5, %/K or N/(m/s); 1 for a plain number"


@dataclass(frozen=True, slots=True)
class Dimension:
    """A product of powers."""

    powers: tuple[Fraction, ...] = (Fraction(0),) * len(_BASE)  # Of kg, m, s, K, A and m^n

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(tuple(a + b for a, b in zip(self.powers, other.powers, strict=True)))

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other ** Fraction(-1)

    def __pow__(self, exponent: Fraction) -> Dimension:
        return Dimension(tuple(power * exponent for power in self.powers))

    def __str__(self) -> str:
        return _COMMON.get(self) or " ".join(
            unit if power == 1 else f"{unit.replace('m^n', '(m^n)')}^{power}"
            for unit, power in zip(_BASE, self.powers, strict=True)
            if power
        )


class Scale(NamedTuple):
    """What a unit is in SI."""

    factor: float  # SI value of one
    dimension: Dimension


def _of(**powers: int) -> Dimension:
    return Dimension(tuple(Fraction(powers.get(unit, 0)) for unit in _BASE))


PLAIN = _of()
METRE = _of(m=1)
#: m^n, with n the sinkage exponent.
METRE_TO_N = Dimension((*PLAIN.powers[:-1], Fraction(1)))
_MEASURES = {name: _of(**powers) for name, powers in units.POWERS.items()}
#: Units of parameters that no channel has.
_FURTHER = {
    "MPa": Scale(1e6, _MEASURES["pressure"]),
    "J": Scale(1.0, _MEASURES["torque"]),
    "W": Scale(1.0, _of(kg=1, m=2, s=-3)),
    "V": Scale(1.0, _of(kg=1, m=2, s=-3, A=-1)),
    "Hz": Scale(1.0, _of(s=-1)),
    "rev": Scale(tau, PLAIN),
    "1": Scale(1.0, PLAIN),
}
_SYMBOL = re.compile(r"1(?![0-9.])|°[A-Za-z]?|%|[A-Za-zμ]+")
_POWER = re.compile(
    r"\^?(?P<number>[+-]?[0-9]{1,4}(?:\.[0-9]{1,4})?)"
    r"|\^(?:\((?P<open>n)?(?P<more>[+-]?[0-9]{1,4}(?:\.[0-9]{1,4}|/[1-9][0-9]?)?)?\)|(?P<n>n)(?![A-Za-z]))"
)
_OPEN, _CLOSE = re.compile(r"\("), re.compile(r"\)")
_JOINT = re.compile(r"\s*/\s*|\s*[·*⋅∙]\s*|\s+(?!\))|\.(?=[A-Za-z])")


def parse(text: str) -> Scale:
    """Read a unit, such as ``N s/rad``, ``Pa/m^n`` or ``N/(m/s)``; K and °C are both a step of one kelvin."""
    return _UnitReader(text).unit()


class _UnitReader:
    def __init__(self, text: str) -> None:
        self.whole = text.strip()
        plain = unicodedata.normalize("NFKC", self.whole[: 2 * _LONGEST].replace("º", "°"))
        self.text = plain.replace("−", "-").replace("**", "^")
        self.place = 0

    def fail(self, problem: str, advice: str = _FORM) -> NoReturn:
        shown = self.whole if len(self.whole) <= _LONGEST else self.whole[: _LONGEST - 1] + "…"
        raise ConfigurationError(f"{shown!r} {problem}", hint=advice)

    def take(self, pattern: re.Pattern[str]) -> re.Match[str] | None:
        match = pattern.match(self.text, self.place)
        if match:
            self.place = match.end()
        return match

    def unit(self) -> Scale:
        if len(self.whole) > _LONGEST:
            self.fail(f"is longer than {_LONGEST} characters")
        if self.text in {"", "-"}:
            return Scale(1.0, PLAIN)
        scale = self.product()
        if self.place < len(self.text):
            self.fail("is not a known unit: there is a ) too many")
        if any(abs(power) > _HIGHEST for power in scale.dimension.powers):
            self.fail(f"is not a unit: powers go up to {_HIGHEST}")
        if not 1.0 / _LARGEST <= scale.factor <= _LARGEST:
            self.fail("is not a unit: its size is beyond all bounds")
        return scale

    def product(self) -> Scale:
        (factor, dimension), divided = self.factor(), False
        while self.place < len(self.text) and self.text[self.place] != ")":
            joint = self.take(_JOINT)
            if joint is None:
                self.fail(f"is not a known unit from {self.text[self.place :]!r} on")
            if divided and "/" not in joint[0]:
                self.fail("can be read in two ways", "put all that divides into brackets: N/(m s)")
            divided, other = "/" in joint[0], self.factor()
            factor = factor / other.factor if divided else factor * other.factor
            dimension = dimension / other.dimension if divided else dimension * other.dimension
        return Scale(factor, dimension)

    def factor(self) -> Scale:
        if self.take(_OPEN):
            scale = self.product()
            if not self.take(_CLOSE):
                self.fail("has a ( that is never closed")
            return scale
        symbol = self.take(_SYMBOL)
        if symbol is None:
            self.fail(f"is not a known unit from {self.text[self.place :]!r} on")
        return self.raised(self.known(symbol[0]), self.take(_POWER))

    def known(self, symbol: str) -> Scale:
        if symbol in _FURTHER:
            return _FURTHER[symbol]
        unit = units.parse(symbol)
        if unit is None:
            advice = "write kg or m/s^2: g is a mass to some and an acceleration to others"
            what = "" if symbol == self.whole else f": {symbol!r}"
            self.fail(f"is not a known unit{what}", advice if symbol == "g" else _FORM)
        return Scale(unit.factor, _MEASURES[unit.dimension])

    def raised(self, scale: Scale, power: re.Match[str] | None) -> Scale:
        if power is None:
            return scale
        number = Fraction(power["number"] or power["more"] or 0)
        if abs(number) > _HIGHEST:
            self.fail(f"is not a unit: powers go up to {_HIGHEST}")
        raised = Scale(scale.factor ** float(number), scale.dimension**number)
        if not (power["open"] or power["n"]):
            return raised
        if scale != Scale(1.0, METRE):
            self.fail("is not a unit: only m can have the power n, the sinkage exponent")
        return raised._replace(dimension=raised.dimension * METRE_TO_N)


_COMMON = {PLAIN: "a plain number"} | {
    parse(text).dimension: text
    for text in (
        *("kg", "m", "s", "K", "A", "m²", "m/s", "m/s²", "1/s", "1/s²", "1/m", "1/K"),
        *("N", "N m", "Pa", "W", "V"),
        *("N/m", "N s", "N s/m", "N m s", "N m s²", "N/K", "N m/K", "N m/A", "1/N", "1/Pa", "Pa/m"),
        *("Pa s", "Pa/m^n", "Pa/m^(n-1)", "kg/m³", "N/m³", "s/m", "s²/m"),
    )
}

_SHOWN = 40  # Characters of a term that an error shows


class Inference:
    """Finds what parts of a law measure; None for a bare 0, which fits any. LawError tells the place."""

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
