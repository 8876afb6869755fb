"""The language of laws: that it can say nothing else."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from terrain_cli.effects.laws import grammar
from terrain_cli.effects.laws.grammar import Law
from terrain_cli.errors import ConfigurationError

HOSTILE = [
    "load.__class__",
    "load.real",
    "().__class__.__bases__",
    "__import__('os').system('true')",
    "__builtins__",
    "import os",
    "open('/etc/passwd')",
    "eval('1')",
    "exec(load)",
    "getattr(load, slip)",
    "globals()",
    "load[0]",
    "[load for load in slip]",
    "{load: slip}",
    "lambda: 1",
    "lambda load: load",
    "(load := 1)",
    "load = 1",
    "load; slip",
    "load if slip else 1",
    "'text'",
    '"text"',
    'f"{load}"',
    "`load",
    "load @ slip",
    "load % 2",
    "load // 2",
    "load << 2",
    "load & slip",
    "load | slip",
    "~load",
    "!load",
    "1_000",
    "0x10",
    "1j",
    "load is slip",
    "load in slip",
    "*load",
    "min(*load)",
    "max(load, key=slip)",
    "...",
    "load # slip",
    "load \\\n + 1",
    "load\x00",
    "load\x0b+ 1",
    "lo\u0430d",  # Cyrillic a
    "ｌｏａｄ",
    "loa\u0064\u0301",
    "١ + ٢",
    "sin（1）",
    "9**9**9",
    "9^9^9^9^9^9^9^9",
    "load ** 9e99",
    "load ^ (10 * 3)",
    "exp(exp(exp(exp(9))))",
    "1e308 * 10",
    "9" * 400,
    "1e" + "9" * 50,
    "(" * 500 + "1" + ")" * 500,
    "(" * 999,
    "-" * 999,
    "not " * 240 + "1",
    "sin(" * 150 + "1" + ")" * 150,
    "1" + "^1" * 300,
    "1" + "+1" * 400,
    "min(" + "1," * 300 + "1)",
    "load + " * 100_000 + "1",
]


@pytest.mark.parametrize("text", HOSTILE, ids=lambda text: ascii(text[:30]))
def test_hostile_law_is_refused_at_once(text):
    start = time.process_time()
    with pytest.raises(ConfigurationError):
        grammar.parse(text)
    assert time.process_time() - start < 0.2


@given(st.text(max_size=60))
@example("where(a, b")
@example("((((")
def test_no_text_breaks_the_parser(text):
    try:
        law = Law(text)
    except ConfigurationError:
        return
    float(np.asarray(law(dict.fromkeys(law.reads, 0.5))))


LANGUAGE = st.lists(
    st.sampled_from(
        [
            *"()+-*/^<>,.12e_ \n",
            "**",
            "==",
            "!=",
            "<=",
            "0.5",
            "load",
            "slip",
            "where(",
            "and",
            "or",
            "not",
            "min(",
        ]
    ),
    max_size=40,
).map("".join)


@given(LANGUAGE)
def test_no_words_break_the_parser(text):
    try:
        law = Law(text)
    except ConfigurationError:
        return
    result = law({name: np.array([-1.0, 0.0, 0.5]) for name in law.reads})
    assert np.broadcast_to(result, 3).dtype == float
