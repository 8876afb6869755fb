"""Message definitions and messages, drawn at random."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype

from formats.rosbag.definitions import CODES, DURATION, FILLER, TIME

NAMES = ("fl", "fr", "rl", "rr", "ä", "")
INTEGERS = [base for base in CODES if base not in {"bool", "float32", "float64"}]
base = st.sampled_from([*CODES, "string", "float64", "string"]).map(lambda name: (Nodetype.BASE, (name, 0)))
clock = st.sampled_from([TIME, DURATION]).map(lambda name: (Nodetype.NAME, name))


def members(inner):
    """Members of a message; `inner` are the types it may be made of."""
    element = st.one_of(base, clock, *([st.sampled_from(inner)] if inner else []))
    desc = st.one_of(
        element,
        st.tuples(st.just(Nodetype.SEQUENCE), st.tuples(element, st.just(0))),
        st.tuples(st.just(Nodetype.ARRAY), st.tuples(element, st.integers(1, 3))),
    )
    named = st.sampled_from(
        [
            [],
            [("name", (Nodetype.BASE, ("string", 0)))],
            [("name", (Nodetype.SEQUENCE, ((Nodetype.BASE, ("string", 0)), 0)))],
        ]
    )
    plain = st.lists(desc, min_size=1, max_size=5).map(lambda d: [(f"m{i}", x) for i, x in enumerate(d)])
    return st.tuples(named, plain, st.booleans()).map(lambda t: t[0] + t[1] if t[2] else t[1] + t[0])


@st.composite
def types(draw):
    made = {}
    for i in range(draw(st.integers(1, 3))):
        inner = [(Nodetype.NAME, name) for name in made]
        made[f"x_msgs/msg/T{i}"] = ([], draw(members(inner)))
    return made


class Values:
    """Random messages; `even` lists have one length per member, others one per message."""

    def __init__(self, store, seed, *, even_numbers, even_items):
        self.store = store
        self.random = np.random.default_rng(seed)
        self.even_numbers, self.even_items = even_numbers, even_items
        self.lengths = {}

    def length(self, key, *, even):
        drawn = int(self.random.integers(0, 4))
        return self.lengths.setdefault(key, drawn) if even else drawn

    def message(self, type_name, where=()):
        members = self.store.fielddefs[type_name][1]
        return self.store.types[type_name](
            *(self.member(desc, (*where, name)) for name, desc in members if name != FILLER)
        )

    def member(self, desc, where):
        kind, rest = desc
        if kind == Nodetype.NAME:
            return self.message(rest, where)
        if kind == Nodetype.BASE:
            return self.text(where) if rest[0] == "string" else self.numbers(rest[0], 1)[0].item()
        element, count = rest
        numbers = element[0] == Nodetype.BASE and element[1][0] != "string"
        if kind == Nodetype.SEQUENCE:
            count = self.length(where, even=self.even_numbers if numbers else self.even_items)
        if numbers:
            return self.numbers(element[1][0], count)
        return [self.member(element, (*where, i)) for i in range(count)]

    def text(self, where):
        if where[-1] == "name" or "name" in where[-2:]:
            return NAMES[self.random.integers(len(NAMES))]
        return "é" * self.length(where, even=self.even_numbers)

    def numbers(self, name, count):
        code = np.dtype(CODES[name])
        raw = self.random.integers(0, 256, count * code.itemsize, dtype=np.uint8).view(code)
        if name == "bool":
            return raw % 2 == 1
        if name in INTEGERS:
            return raw
        special = np.array([np.nan, np.inf, -0.0, 5e-324], dtype=code)
        return np.where(
            self.random.random(count) < 0.2,
            self.random.choice(special, count),
            self.random.normal(size=count).astype(code),
        )
