"""The language of laws: what it says."""

from __future__ import annotations

import ast
import math
import operator

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from terrain_cli.effects.laws import expression, grammar
from terrain_cli.effects.laws.grammar import Law, LawError
from terrain_cli.mechanics.dual import seed

NUMBERS = {"slip": 0.3, "load": 82.5, "x": -1.75, "torque_2": 7.0}


def value(text, **names):
    return float(expression.evaluate(grammar.parse(text), names or NUMBERS))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("10 - 4 - 3", 3.0),
        ("100 / 10 / 5", 2.0),
        ("2 ^ 3 ^ 2", 512.0),
        ("2 ** 3 ** 2", 512.0),
        ("-2 ^ 2", -4.0),
        ("2 ^ -1", 0.5),
        ("2 ^ -1 * 6", 3.0),
        ("--2", 2.0),
        ("+2 - +1", 1.0),
        (".5 + 1. + 2.5e-1 + 1E+1", 11.75),
        ("2 * pi", math.tau),
        ("log10(1000) + ln(exp(2)) + log(1)", 5.0),
        ("min(3, 1, 2) + max(3, 1, 2)", 4.0),
        ("sqrt(abs(-16)) * sign(-3)", -4.0),
        ("asin(1) + acos(1) + atan(0) + tanh(0)", math.pi / 2.0),
        ("sin(1)^2 + cos(1)^2 - tan(pi / 4)", 0.0),
        ("where(1 < 2, 5, 6)", 5.0),
        ("where(1 > 2 or 2 >= 2 and 3 != 3, 5, 6)", 6.0),
        ("where(not 1 == 2, 5, 6)", 5.0),
        ("where(not (1 < 2) or 2 <= 1, 5, 6)", 6.0),
        ("where(0 < slip <= 0.3 < 1, 5, 6)", 5.0),
        ("where(0 < slip < 0.2, 5, 6)", 6.0),
        ("load\n  + 1\t+ torque_2\r\n", 90.5),
        ("2 * `slip` + `torque_2`^2", 49.6),
    ],
)
def test_value(text, expected):
    assert value(text) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "column", "says", "advice"),
    [
        ("1 +", 4, "missing here", ""),
        ("", 1, "missing here", ""),
        ("load slip", 6, "'slip' cannot follow", "operator is missing"),
        ("2x", 2, "'x' cannot follow", "operator is missing"),
        ("belt tension", 6, "'tension' cannot follow", "a name with spaces stands in `…`"),
        ("2 * `belt tension", 5, "'`' has no place", "a name in `…` is not closed"),
        ("`" + "x" * 61 + "`", 1, "longer than 60 characters", ""),
        ("(1 + 2", 1, "never closed", ""),
        ("abs `(`-1)", 5, "'(' cannot follow", "operator is missing"),
        ("1 + 2)", 6, "')' cannot follow", "no ( that it closes"),
        ("sin(1, 2)", 1, "sin takes 1 argument, not 2", ""),
        ("min(1)", 1, "min takes 2 or more arguments, not 1", ""),
        ("where(slip, 1, 2)", 7, "a number stands where a condition must be", "slip > 0.2"),
        ("1 + (slip > 2)", 5, "a condition stands where a number must be", "where(condition, a, b)"),
        ("slip > 2", 1, "a condition stands where a number must be", "where(condition, a, b)"),
        ("sqroot(2)", 1, "no function sqroot; did you mean sqrt?", "functions: abs, sign, sqrt"),
        ("sqrt + 1", 1, "sqrt is a function", "write sqrt(…)"),
        ("foo(sin(1, 2)) + bar(1)", 5, "sin takes 1 argument, not 2", ""),
        ("load − 1", 6, "'−' (U+2212)", "write -"),
        ("slip²", 5, "'²' (U+00B2)", "write ^2"),
        ("where(slip = 1, 1, 2)", 12, "'='", "write =="),
        ("1e999", 1, "too large a number", ""),
        ("slip + 1/0", 8, "no finite number", ""),
        ("slip * log(0 * 3)", 8, "no finite number", ""),
        ("where(slip > log(-1), 1, 2)", 14, "no finite number", ""),
        ("1e300 ^ 20 * slip", 1, "no finite number", ""),
        ("slip ^ 21", 8, "a power is between -20 and 20", ""),
        ("x" * 61, 1, "longer than 60 characters", ""),
    ],
)
def test_error_points_at_its_place(text, column, says, advice):
    with pytest.raises(LawError) as error:
        grammar.parse(text)
    assert f"column {column}: " in str(error.value)
    assert says in str(error.value)
    assert advice in error.value.hint
    line, carets = error.value.pointer().split("\n")
    assert line == text.partition("\n")[0]
    assert carets.index("^") == column - 1


# Trees of the language as text, in signs that Python shares, and their values by Python's own parser.

FUNCTIONS = {
    "abs": abs,
    "sign": lambda x: math.copysign(1.0, x) if x else x,
    "sqrt": math.sqrt,
    "exp": math.exp,
    "expm1": math.expm1,
    "log": math.log,
    "ln": math.log,
    "log10": math.log10,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "asin": math.asin,
    "acos": math.acos,
    "atan": math.atan,
    "tanh": math.tanh,
    "min": min,
    "max": max,
}
OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: math.pow,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


def reference(node):  # noqa: C901, PLR0911 - one for each kind of node
    match node:
        case ast.Expression(body=body):
            return reference(body)
        case ast.Constant(value=number):
            return float(number)
        case ast.Name(id=name):
            return NUMBERS[name]
        case ast.UnaryOp(op=ast.Not(), operand=inner):
            return not reference(inner)
        case ast.UnaryOp(op=sign, operand=inner):
            return -reference(inner) if isinstance(sign, ast.USub) else reference(inner)
        case ast.BinOp(op=op, left=left, right=right):
            return OPERATORS[type(op)](reference(left), reference(right))
        case ast.BoolOp(op=op, values=values):
            return (all if isinstance(op, ast.And) else any)([reference(inner) for inner in values])
        case ast.Compare(left=left, ops=ops, comparators=others):
            terms = [reference(term) for term in (left, *others)]
            pairs = zip(ops, terms[:-1], terms[1:], strict=True)
            return all(OPERATORS[type(op)](a, b) for op, a, b in pairs)
        case ast.Call(func=ast.Name(id="where"), args=[condition, a, b]):
            # Both are computed, as with arrays.
            chosen = reference(condition), reference(a), reference(b)
            return chosen[1] if chosen[0] else chosen[2]
        case ast.Call(func=ast.Name(id=name), args=args):
            return FUNCTIONS[name](*map(reference, args))
    raise AssertionError(ast.dump(node))


def trees():
    leaves = st.sampled_from(list(NUMBERS)) | st.sampled_from(["0", "1", "2", "0.5", ".25", "3e-1", "7."])

    def grown(inner):
        pairs = st.tuples(inner, st.sampled_from(["+", "-", "*", "/", " + ", " - "]), inner).map("".join)
        ones = st.sampled_from([name for name in FUNCTIONS if name not in {"min", "max"}])
        compared = st.tuples(inner, st.sampled_from([" < ", "<=", " > ", ">=", " == ", "!="]), inner).map(
            "".join
        )
        conditions = st.one_of(
            compared,
            st.tuples(compared, st.sampled_from([" and ", " or "]), compared).map("".join),
            compared.map("not {}".format),
        )
        return st.one_of(
            pairs,
            inner.map("({})".format),
            inner.map("-{}".format),
            st.tuples(inner, st.sampled_from(["2", "0.5", "-1", "3"])).map("({0[0]})**{0[1]}".format),
            st.tuples(ones, inner).map("{0[0]}({0[1]})".format),
            st.tuples(st.sampled_from(["min", "max"]), inner, inner).map("{0[0]}({0[1]}, {0[2]})".format),
            st.tuples(conditions, inner, inner).map("where({0[0]}, {0[1]}, {0[2]})".format),
        )

    return st.recursive(leaves, grown, max_leaves=12)


@given(trees())
@example("-x**2 + 2**-slip")
@example("where(0 < slip <= 1, -load**2, x)")
@example("where(not slip > 1 and x < 0 or load < 1, 1, 2)")
def test_value_is_that_of_pythons_own_grammar(text):
    assume(len(text) < grammar.LONGEST)
    try:
        expected = reference(ast.parse(text, mode="eval"))
    except (ValueError, ZeroDivisionError, OverflowError):
        assume(False)
    assume(math.isfinite(expected))
    try:
        tree = grammar.parse(text)
    except LawError as error:
        # Python passes over the constant in a comparison that is decided before it.
        if "no finite number" not in error.problem:
            raise
        return
    assert float(expression.evaluate(tree, NUMBERS)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(trees())
def test_place_of_every_part_is_its_text(text):
    assume(len(text) < grammar.LONGEST)
    try:
        waiting = [grammar.parse(text)]
    except LawError:
        assume(False)
    while waiting:
        node = waiting.pop()
        waiting.extend(expression.children(node))
        if not expression.is_condition(node):
            try:
                own = grammar.parse(text[slice(*expression.span(node))])
            except LawError as error:
                # Within min(0, 1/0) a constant may be what it may not be alone.
                assert "no finite number" in error.problem  # noqa: PT017
                continue
            assert expression.evaluate(own, NUMBERS) == pytest.approx(
                expression.evaluate(node, NUMBERS), nan_ok=True
            )


@pytest.mark.parametrize(
    "text",
    [
        "x + 2 * x - x / 3",
        "x ^ 3 + x ^ 2 + 2 ^ x + x ^ x",
        "sqrt(x) * exp(-x) + log(x) + ln(x) + log10(x)",
        "sin(x) + cos(x) * tan(x) + tanh(x)",
        "asin(x / 2) + acos(x / 2) + atan(x)",
        "abs(x - 0.5) * sign(x) + min(x, 0.4) + max(x, 0.9, 0.2)",
        "where(x < 0.5, x ^ 2, 3 * x)",
    ],
)
def test_derivative(text):
    law = Law(text)
    x = np.array([0.15, 0.3, 0.7, 1.1])
    step = 1e-6
    expected = (law({"x": x + step}) - law({"x": x - step})) / (2.0 * step)
    result = law({"x": seed(x, "x")})
    np.testing.assert_allclose(result.value, law({"x": x}))
    np.testing.assert_allclose(result.slopes["x"], expected, rtol=1e-7)


def test_branch_that_is_not_chosen_spoils_no_derivative():
    result = Law("where(x > 0, sqrt(x), 0)")({"x": seed(np.array([0.0, 4.0]), "x")})
    assert result.slopes["x"].tolist() == [0.0, 0.25]


@pytest.mark.parametrize(
    "text", ["1 / x", "log(x)", "sqrt(x - 1)", "x ^ -1", "exp(1000 + x)", "asin(2 + x)", "x ^ 0.5"]
)
def test_no_number_is_no_warning(text):
    # Warnings are errors here.
    for q in ({"x": 0.0}, {"x": np.zeros(2)}, {"x": seed(np.array([0.0, -1.0]), "x")}):
        Law(text)(q)
    assert not np.isfinite(Law("1 / x")({"x": 0.0}))


def test_law_travels_as_text():
    import pickle

    law = pickle.loads(pickle.dumps(Law("load * " + " + ".join(["slip"] * 80), {"slip": 0.5})))  # noqa: S301
    assert law({"load": 2.0, "slip": 3.0}) == pytest.approx(2.0 * 1.5 + 79 * 1.5)


@pytest.mark.parametrize(
    "name", ["slip", "lambda", "None", "(", "Belt tension [N]", "2nd axle", "Größe", "a-b", "x" * 60]
)
def test_a_name_is_read_as_it_is_written(name):
    assert [place.id for place in expression.names(grammar.parse(grammar.written(name)))] == [name]


@pytest.mark.parametrize("name", ["sqrt", "pi", "and", "", " ", "a`b", "a\nb", "x" * 61])
def test_what_no_law_can_name(name):
    assert not grammar.written(name)
