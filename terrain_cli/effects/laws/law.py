"""A law that was read from a text and is called like one written in Python."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from terrain_cli.effects.laws import expression, grammar

if TYPE_CHECKING:
    from collections.abc import Mapping


class Law:
    """A law read from a text: called with what it reads, it gives the changed quantity.

    `factors` are what the further columns of the data are multiplied by to become SI.
    """

    def __init__(self, text: str, factors: Mapping[str, float] | None = None) -> None:
        self.text, self.factors = text, dict(factors or {})
        self.tree = grammar.parse(text)
        self.reads = tuple(dict.fromkeys(name.id for name in expression.names(self.tree)))

    def __reduce__(self) -> tuple[type[Law], tuple[str, dict[str, float]]]:
        """Travel between processes as text."""
        return Law, (self.text, self.factors)

    def __call__(self, q: Mapping[str, Any]) -> Any:
        """Evaluate it, of arrays or numbers with derivatives; NaN where it is no number."""
        if self.factors:
            q = {name: q[name] * self.factors.get(name, 1.0) for name in self.reads}
        return expression.evaluate(self.tree, q)
