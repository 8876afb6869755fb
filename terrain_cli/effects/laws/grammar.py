"""The language of a user's law: arithmetic, comparisons and a few functions, and nothing else.

Its words are checked one by one, and rewritten so that Python's own parser reads no more than their order
(`terrain_cli.effects.laws.expression`); no text is ever executed. Bounds on its length, nesting, size and
powers let a hostile law be refused before it costs anything.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any, NamedTuple, NoReturn

from terrain_cli.effects.laws.expression import (
    CONSTANTS,
    FUNCTIONS,
    Node,
    children,
    evaluate,
    is_condition,
    names,
    span,
)
from terrain_cli.errors import ConfigurationError, nearest

#: Bounds: characters, nested brackets, parts in all, powers, characters of a number or name.
LONGEST = 1000
DEEPEST = 40
LARGEST = 200
HIGHEST_POWER = 20.0
_LONGEST_WORD = 60
_SHOWN = 72  # Characters of a law that an error shows
#: What a law can name.
NAME_FORM = f"one line of up to {_LONGEST_WORD} characters without backticks"
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

WORDS = ("and", "or", "not")
RESERVED = {*WORDS, *FUNCTIONS, *CONSTANTS}

#: What can stand behind a term.
_JOINING = {*("or", "and", "<", "<=", ">", ">=", "==", "!=", "+", "-", "*", "/", "^", ")", ",")}
_NO_NUMBER, _WHERE = "a condition stands where a number must be", "use where(condition, a, b)"
_WIDTH = 4  # Characters that each token has in what Python parses, so that its place there is its number

_TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    rf"|(?P<operator>(?:{'|'.join(WORDS)})(?![A-Za-z0-9_])|\*\*|[<>=!]=|[-+*/^<>(),])"
    # With its bracket.
    rf"|(?P<function>{NAME.pattern})[ \t\r\n]*\("
    rf"|(?P<name>{NAME.pattern})"
    r"|`(?P<quoted>[^`\n]+)`"
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
    ".": "a law has no attributes: a full stop stands in numbers only",
    "_": "a name begins with a letter",
    **dict.fromkeys("\"'", "a law has no texts; put a name with other characters into `…`"),
    "`": "a name in `…` is not closed",
    **dict.fromkeys("[]{}", "a law has round brackets only"),
}


class LawError(ConfigurationError):
    """Something wrong at one place of a law, from `start` to `end`, and the advice what to do about it."""

    def __init__(self, problem: str, text: str, start: int, end: int, advice: str = "") -> None:
        self.problem, self.text, self.start, self.end = problem, text, start, end
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

    @property
    def sign(self) -> str:
        return self.text if self.kind == "operator" else ""

    @property
    def ends(self) -> bool:
        """Whether a term ends with it."""
        return self.kind in {"number", "name", "quoted"} or self.sign == ")"


def written(name: str) -> str:
    """Return how a law names a channel or a column, in backticks if need be; nothing where it cannot."""
    if name in RESERVED or len(name) > _LONGEST_WORD:
        return ""
    if not name.strip() or not name.isprintable() or "`" in name:
        return ""
    return name if NAME.fullmatch(name) else f"`{name}`"


class Law:
    """A law read from a text; `factors` make what it reads of further columns SI."""

    def __init__(self, text: str, factors: Mapping[str, float] | None = None) -> None:
        self.text, self.factors = text, dict(factors or {})
        self.tree = parse(text)
        self.reads = tuple(dict.fromkeys(name.id for name in names(self.tree)))

    def __reduce__(self) -> tuple[type[Law], tuple[str, dict[str, float]]]:
        """Travel between processes as text."""
        return Law, (self.text, self.factors)

    def __call__(self, q: Mapping[str, Any]) -> Any:
        """Evaluate it, of arrays or numbers with derivatives; NaN where it is no number."""
        if self.factors:
            q = {name: q[name] * self.factors.get(name, 1.0) for name in self.reads}
        return evaluate(self.tree, q)


def parse(text: str) -> Node:
    """Read a law: a number, not a condition."""
    if len(text) > LONGEST:
        raise LawError(f"a law has at most {LONGEST} characters, not {len(text)}", text, LONGEST, LONGEST)
    tokens = list(_tokens(text))
    _check_order(tokens, text)
    _check_brackets(tokens, text)
    try:
        root = ast.parse(_python(tokens), mode="eval").body
    except (SyntaxError, RecursionError, MemoryError):
        raise LawError(f"nested deeper than {DEEPEST}", text, 0, len(text)) from None
    nodes = _placed(root, tokens, text)
    if len(nodes) > LARGEST:
        raise LawError(f"more than {LARGEST} numbers, names and operators", text, *span(nodes[LARGEST]))
    # Of several mistakes the first that a reader meets.
    for node in sorted(nodes, key=lambda node: (span(node)[1], -node.col_offset)):
        _check(node, text)
    _check_number(root, text)
    _check_constants(root, text)
    return root


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


def _check_order(tokens: list[_Token], text: str) -> None:
    """Let a number stand where one must, and nothing else."""
    for index, token in enumerate(tokens):
        # Before the first token stands the last, which is the end.
        before = tokens[index - 1]
        if before.ends:
            if token.kind != "end" and token.sign not in _JOINING:
                _refuse_next(token, text)
        elif token.kind in {"operator", "end"} and token.sign not in {"(", "-", "+", "not"}:
            # A call without arguments is told below what it takes.
            if (before.kind, token.sign) != ("function", ")"):
                raise LawError("a number, a name or ( is missing here", text, token.start, token.end)
        elif token.sign == "not" and before.sign not in {"", "(", ",", *WORDS}:
            raise LawError(_NO_NUMBER, text, token.start, token.end, _WHERE)


def _check_brackets(tokens: list[_Token], text: str) -> None:
    opened: list[_Token] = []
    for token in tokens:
        if token.kind == "function" or token.sign == "(":
            opened.append(token)
        elif token.sign == ")" and opened:
            opened.pop()
        elif token.sign == ")" or (token.sign == "," and not (opened and opened[-1].kind == "function")):
            _refuse_next(token, text)
        if len(opened) > DEEPEST:
            raise LawError(f"nested deeper than {DEEPEST}", text, token.start, token.end)
    if opened:
        raise LawError("this ( is never closed", text, opened[-1].end - 1, opened[-1].end)


def _python(tokens: list[_Token]) -> str:
    """Write tokens for Python's parser: names without meaning, 0 for every number, no + before a term."""
    pieces = []
    for before, token in pairwise([tokens[-1], *tokens[:-1]]):
        if token.kind == "operator":
            piece = "" if token.sign == "+" and not before.ends else token.sign.replace("^", "**")
        elif token.kind == "number" or (token.kind == "name" and token.text in CONSTANTS):
            piece = "0"
        else:
            piece = "_(" if token.kind == "function" else "_"
        pieces.append(f"{piece:<{_WIDTH}}")
    return f"({''.join(pieces)})"


def _refuse_next(token: _Token, text: str) -> NoReturn:
    advice = "an operator is missing: + - * / ^ (a name with spaces stands in `…`)"
    if token.kind == "operator":
        advice = "there is no ( that it closes" if token.sign == ")" else ""
    raise LawError(f"{token.text!r} cannot follow here", text, token.start, token.end, advice)


def _placed(root: Node, tokens: list[_Token], text: str) -> list[Node]:
    """Give every part its name, its value and its place in the law, brackets around it included."""
    nodes: list[Node] = []
    waiting = [root]
    while waiting:
        node = waiting.pop()
        nodes.append(node)
        waiting.extend(reversed(children(node)))
        begin, end = span(node)
        first, last = (begin - 1) // _WIDTH, (end - 2) // _WIDTH
        token = tokens[first]
        match node:
            case ast.Name():
                if token.kind == "name" and token.text in FUNCTIONS:
                    problem = f"{token.text} is a function"
                    raise LawError(problem, text, token.start, token.end, f"write {token.text}(…)")
                node.id = token.text
            case ast.Call(func=ast.Name() as function):
                function.id = token.text
            case ast.Constant():
                node.value = CONSTANTS.get(token.text) or float(token.text)
                if not math.isfinite(node.value):
                    raise LawError("too large a number", text, token.start, token.end)
        while tokens[first - 1].sign == "(" and tokens[last + 1].sign == ")":
            first, last = first - 1, last + 1
        node.col_offset, node.end_col_offset = tokens[first].start, tokens[last].end
    return nodes


def _check(node: Node, text: str) -> None:
    """Refuse what one part cannot be made of."""
    match node:
        case ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
            for part in children(node):
                _check_condition(part, text)
        case ast.Call(func=ast.Name(id=name), args=arguments):
            _check_call(node, name, arguments, text)
        case _:
            for part in children(node):
                _check_number(part, text)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow) and not any(names(node.right)):
        power = float(evaluate(node.right, {}))
        if not abs(power) <= HIGHEST_POWER:
            problem = f"a power is between -{HIGHEST_POWER:g} and {HIGHEST_POWER:g}"
            raise LawError(problem, text, *span(node.right))


def _check_call(node: Node, name: str, arguments: list[Node], text: str) -> None:
    start, end = span(node)
    if name not in FUNCTIONS:
        problem = f"there is no function {name}{nearest(name, FUNCTIONS)}"
        raise LawError(problem, text, start, start + len(name), f"functions: {', '.join(FUNCTIONS)}")
    function = FUNCTIONS[name]
    if not function.least <= len(arguments) <= function.most:
        takes = str(function.least) if function.least == function.most else f"{function.least} or more"
        problem = f"{name} takes {takes} argument{'s' * (takes != '1')}, not {len(arguments)}"
        advice = "where(condition, value if it holds, value if not)" if name == "where" else ""
        raise LawError(problem, text, start, end, advice)
    for place, argument in enumerate(arguments):
        (_check_condition if (name, place) == ("where", 0) else _check_number)(argument, text)


def _check_number(node: Node, text: str) -> None:
    if is_condition(node):
        raise LawError(_NO_NUMBER, text, *span(node), _WHERE)


def _check_condition(node: Node, text: str) -> None:
    if not is_condition(node):
        raise LawError("a number stands where a condition must be", text, *span(node), "such as slip > 0.2")


def _check_constants(root: Node, text: str) -> None:
    """Refuse what is no number whatever the data: 1/0, log(0), 1e300^2."""
    waiting = [root]
    while waiting:
        node = waiting.pop()
        if any(names(node)) or is_condition(node):
            waiting.extend(children(node))
        elif not math.isfinite(evaluate(node, {})):
            raise LawError("this is no finite number", text, *span(node))
