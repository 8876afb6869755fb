"""The language of a user's law: arithmetic, comparisons and a few functions, and nothing else.

A law is read into a small tree (`terrain_cli.effects.laws.expression`); no text is ever executed. Bounds
on its length, nesting, size and powers let a hostile law be refused before it costs anything.
"""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, NoReturn

from terrain_cli.effects.laws.expression import (
    COMPARE,
    CONSTANTS,
    FUNCTIONS,
    Arithmetic,
    Call,
    Logic,
    Name,
    Negative,
    Node,
    Number,
    Relation,
    children,
    evaluate,
    names,
)
from terrain_cli.errors import ConfigurationError, nearest

if TYPE_CHECKING:
    from collections.abc import Iterator

#: Bounds: characters, nested brackets and signs, parts in all, powers, characters of a number or name.
LONGEST = 1000
DEEPEST = 40
LARGEST = 200
HIGHEST_POWER = 20.0
_LONGEST_WORD = 60
#: Characters of a law that an error shows.
_SHOWN = 72
#: What a law can name.
NAME_FORM = f"one line of up to {_LONGEST_WORD} characters without backticks"
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

WORDS = frozenset({"and", "or", "not"})
RESERVED = WORDS | FUNCTIONS.keys() | CONSTANTS.keys()


#: How strongly an operator binds; a sign binds between * and ^.
_BINDING = {"or": 1, "and": 2, **dict.fromkeys(COMPARE, 4), "+": 5, "-": 5, "*": 6, "/": 6, "^": 8}
_NOT, _SIGN = 3, 7

_TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    rf"|(?P<name>{NAME.pattern})"
    r"|`(?P<quoted>[^`\n]+)`"
    r"|(?P<operator>\*\*|[<>=!]=|[-+*/^<>(),])"
)
_SIGNS_MEANT = {
    **dict.fromkeys("−–—", "-"),
    **dict.fromkeys("×·⋅∙", "*"),
    "÷": "/",
    "²": "^2",
    "³": "^3",
    "≤": "<=",
    "≥": ">=",
    "≠": "!=",
    "=": "==",
    "&": "and",
    "|": "or",
    "!": "not",
    "√": "sqrt(…)",
    "π": "pi",
}
_NO_PLACE = {
    ".": "nothing in a law has parts to reach by a full stop",
    "_": "a name begins with a letter",
    **dict.fromkeys("\"'", "a law holds no texts; a name that is no plain word stands in `…`"),
    "`": "a name in `…` is not closed",
    **dict.fromkeys("[]{}", "a law has round brackets only"),
}


class LawError(ConfigurationError):
    """Something wrong at one place of a law.

    Parameters
    ----------
    text : str
        The whole law.
    start, end : int
        The place in it.
    advice : str
        What to do about it.
    """

    def __init__(self, problem: str, text: str, start: int, end: int, advice: str = "") -> None:
        self.problem, self.text, self.start, self.end, self.advice = problem, text, start, end, advice
        super().__init__(
            f"column {start + 1}: {problem}", hint="\n".join(filter(None, [self.pointer(), advice]))
        )

    def pointer(self) -> str:
        """Return the line of the law that holds the place, and carets under it."""
        first = self.text.rfind("\n", 0, self.start) + 1
        line = self.text[first:].partition("\n")[0].replace("\t", " ").rstrip("\r")
        low, high = self.start - first, max(self.start + 1, min(self.end, first + len(line))) - first
        cut = max(0, min(low - _SHOWN // 2, len(line) - _SHOWN))
        before = "… " if cut else ""
        after = " …" if cut + _SHOWN < len(line) else ""
        carets = "^" * max(1, min(high, cut + _SHOWN) - low)
        return f"{before}{line[cut : cut + _SHOWN]}{after}\n{' ' * (len(before) + low - cut)}{carets}"


class _Token(NamedTuple):
    kind: str
    text: str
    start: int
    end: int


def written(name: str) -> str:
    """Return how a law names a channel or a column: in backticks where the name is no plain word.

    Returns
    -------
    str
        Empty if no law can name it: it is a word of the language, too long, or has backticks of its own.
    """
    if name in RESERVED or len(name) > _LONGEST_WORD:
        return ""
    if not name.strip() or not name.isprintable() or "`" in name:
        return ""
    return name if NAME.fullmatch(name) else f"`{name}`"


def parse(text: str) -> Node:
    """Read a law.

    Returns
    -------
    Node
        A number, not a condition.

    Raises
    ------
    LawError
        It is not of the language, or beyond its bounds.
    """
    if len(text) > LONGEST:
        raise LawError(f"a law has at most {LONGEST} characters, not {len(text)}", text, LONGEST, LONGEST)
    return _Parser(text).law()


def _tokens(text: str) -> Iterator[_Token]:
    place = 0
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            _refuse_sign(text, place)
        kind = str(match.lastgroup)
        token = _Token(kind, "^" if match[0] == "**" else match[kind], place, match.end())
        place = match.end()
        if kind == "space":
            continue
        if kind != "operator" and len(token.text) > _LONGEST_WORD:
            raise LawError(f"longer than {_LONGEST_WORD} characters", text, token.start, token.end)
        yield token
    end = len(text.rstrip())
    yield _Token("end", "", end, end)


def _refuse_sign(text: str, place: int) -> NoReturn:
    sign = text[place]
    meant = f"write {_SIGNS_MEANT[sign]}" if sign in _SIGNS_MEANT else _NO_PLACE.get(sign, "")
    if not meant and sign.isalpha():
        meant = "names have the letters a to z only, without accents"
    shown = repr(sign) if sign.isprintable() and sign.isascii() else f"{sign!r} (U+{ord(sign):04X})"
    raise LawError(f"{shown} has no place in a law", text, place, place + 1, meant)


class _Parser:
    """Reads by the binding of operators (Pratt 1973)."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = list(_tokens(text))
        self.place = self.depth = self.count = 0

    @property
    def next(self) -> _Token:
        return self.tokens[self.place]

    def take(self) -> _Token:
        token = self.next
        self.place += 1
        return token

    def fail(self, problem: str, at: Node | _Token, advice: str = "") -> NoReturn:
        raise LawError(problem, self.text, at.start, at.end, advice)

    def law(self) -> Node:
        root = self.number(self.expression(0))
        if self.next.kind != "end":
            self.fail(f"{self.next.text!r} cannot follow here", self.next, self.advice_to_follow())
        _check_constants(root, self.text)
        return root

    def advice_to_follow(self) -> str:
        if self.next.text == ")":
            return "there is no ( that it closes"
        if self.next.kind == "operator":
            return ""
        return "an operator is missing: + - * / ^ (a name with spaces stands in `…`)"

    def expression(self, least: int) -> Node:
        self.depth += 1
        if self.depth > DEEPEST:
            self.fail(f"nested deeper than {DEEPEST}", self.next)
        left = self.term()
        while self.next.kind != "end" and _BINDING.get(self.next.text, -1) >= least:
            left = self.joined(left)
        self.depth -= 1
        return left

    def joined(self, left: Node) -> Node:
        operator = self.next.text
        binding = _BINDING[operator]
        if operator in COMPARE:
            return self.comparison(left)
        self.take()
        if operator in WORDS:
            right = self.condition(self.expression(binding + 1))
            return self.made(Logic(left.start, right.end, operator, (self.condition(left), right)))
        # a^b^c is a^(b^c).
        right = self.number(self.expression(binding + (operator != "^")))
        if operator == "^":
            self.check_power(right)
        return self.made(Arithmetic(left.start, right.end, operator, self.number(left), right))

    def comparison(self, left: Node) -> Node:
        operators, terms = [], [self.number(left)]
        while self.next.text in COMPARE:
            operators.append(self.take().text)
            terms.append(self.number(self.expression(_BINDING["<"] + 1)))
        return self.made(Relation(left.start, terms[-1].end, tuple(operators), tuple(terms)))

    def term(self) -> Node:  # noqa: PLR0911 - one for each kind of term
        token = self.take()
        match token.kind, token.text:
            case "number", _:
                return self.made(Number(token.start, token.end, self.value(token)))
            case "name", "not":
                inner = self.condition(self.expression(_NOT))
                return self.made(Logic(token.start, inner.end, "not", (inner,)))
            case "name", name if name not in WORDS:
                return self.called(token) if self.next.text == "(" else self.named(token)
            case "quoted", name:
                return self.made(Name(token.start, token.end, name))
            case "operator", "-":
                inner = self.number(self.expression(_SIGN))
                return self.made(Negative(token.start, inner.end, inner))
            case "operator", "+":
                inner = self.number(self.expression(_SIGN))
                return replace(inner, start=token.start)
            case "operator", "(":
                inner = self.expression(0)
                return replace(inner, start=token.start, end=self.close(token).end)
        return self.fail("a number, a name or ( is missing here", token)

    def value(self, token: _Token) -> float:
        value = float(token.text)
        if not math.isfinite(value):
            self.fail("too large a number", token)
        return value

    def named(self, token: _Token) -> Node:
        if token.text in CONSTANTS:
            return self.made(Number(token.start, token.end, CONSTANTS[token.text]))
        if token.text in FUNCTIONS:
            self.fail(f"{token.text} is a function", token, f"write {token.text}(…)")
        return self.made(Name(token.start, token.end, token.text))

    def called(self, token: _Token) -> Node:
        if token.text not in FUNCTIONS:
            self.fail(
                f"there is no function {token.text}{nearest(token.text, FUNCTIONS)}",
                token,
                f"functions: {', '.join(FUNCTIONS)}",
            )
        opening = self.take()
        arguments: list[Node] = []
        if self.next.text != ")":
            arguments.append(self.expression(0))
        while self.next.text == ",":
            self.take()
            arguments.append(self.expression(0))
        end = self.close(opening).end
        function = FUNCTIONS[token.text]
        if not function.least <= len(arguments) <= function.most:
            takes = str(function.least) if function.least == function.most else f"{function.least} or more"
            self.fail(
                f"{token.text} takes {takes} argument{'s' * (takes != '1')}, not {len(arguments)}",
                _Token("call", "", token.start, end),
                "where(condition, value if it holds, value if not)" if token.text == "where" else "",
            )
        for place, argument in enumerate(arguments):
            (self.condition if (token.text, place) == ("where", 0) else self.number)(argument)
        return self.made(Call(token.start, end, token.text, tuple(arguments)))

    def close(self, opening: _Token) -> _Token:
        if self.next.text != ")":
            if self.next.kind == "end":
                self.fail("this ( is never closed", opening)
            self.fail(f"{self.next.text!r} cannot follow here", self.next, self.advice_to_follow())
        return self.take()

    def made(self, node: Node) -> Node:
        self.count += 1
        if self.count > LARGEST:
            self.fail(f"more than {LARGEST} numbers, names and operators", node)
        return node

    def number(self, node: Node) -> Node:
        if isinstance(node, Relation | Logic):
            self.fail("a condition stands where a number must be", node, "use where(condition, a, b)")
        return node

    def condition(self, node: Node) -> Node:
        if not isinstance(node, Relation | Logic):
            self.fail("a number stands where a condition must be", node, "such as slip > 0.2")
        return node

    def check_power(self, exponent: Node) -> None:
        if any(names(exponent)):
            return
        value = float(evaluate(exponent, {}))
        if not abs(value) <= HIGHEST_POWER:
            self.fail(f"a power is between −{HIGHEST_POWER:g} and {HIGHEST_POWER:g}", exponent)


def _check_constants(root: Node, text: str) -> None:
    """Refuse what is no number whatever the data: 1/0, log(0), 1e300^2."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        if any(names(node)) or isinstance(node, Relation | Logic):
            waiting.extend(children(node))
        elif not math.isfinite(evaluate(node, {})):
            raise LawError("this is no finite number", text, node.start, node.end)
