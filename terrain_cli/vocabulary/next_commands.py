"""The commands that a verb says come next, ready to paste."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, replace

from terrain_cli.vocabulary.choices import BASES


@dataclass(frozen=True, kw_only=True)
class Asked:
    """What was asked of which files, as the next command has it too."""

    inputs: tuple[str, ...]
    model: str = "wong-reece"  # A base, or a model file
    options: tuple[str, ...] = ()  # Of reading and cutting, as they were given
    confirm: tuple[str, ...] = ()  # Another drive, that was to confirm an effect
    fresh: str = "model.toml"  # Where a model file may be made
    law: str = "law.toml"  # Where a law may be written

    @property
    def piped(self) -> bool:
        """Whether the data came on standard input, which a next command needs anew."""
        return "-" in self.inputs

    def where(self, condition: str) -> Asked:
        """Return the same of the samples that also satisfy a condition."""
        before = dict(zip(self.options, self.options[1:], strict=False)).get("--where")
        if before is None:
            return replace(self, options=(*self.options, "--where", condition))
        both = f"({before}) and ({condition})"
        return replace(self, options=tuple(both if word == before else word for word in self.options))

    @property
    def joined(self) -> Asked:
        """The same of all drives together."""
        return replace(self, inputs=(*self.inputs, *self.confirm))

    def looked(self, verb: str, *further: str) -> str:
        """Return the command of a verb that only looks at what was asked."""
        model = () if self.model == "wong-reece" else ("--model", self.model)
        return shlex.join(["terrain-est", verb, *self.inputs, *model, *self.options, *further])

    def removed(self, what: Sequence[str]) -> str:
        """Return the command that takes effects out of the model."""
        words = ["terrain-est", "model", "remove", self.model, *what, *self.options, "--data", *self.inputs]
        return shlex.join(words)

    def added(self, what: Sequence[str]) -> str:
        """Return the command that adds something to the model, which is a file from then on."""
        made = ""
        path = self.model
        if path in BASES:
            path = self.fresh
            base = () if self.model == "wong-reece" else ("--base", self.model)
            made = shlex.join(["terrain-est", "model", "new", path, *base]) + " && "
        words = ["terrain-est", "model", "add", path, *what, *self.options, "--data", *self.inputs]
        told = made + shlex.join(words)
        # Of two commands behind one pipe, only one in brackets gets the data.
        return f"({told})" if made and self.piped else told
