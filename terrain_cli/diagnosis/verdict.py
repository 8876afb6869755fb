"""The verdict: one pure function of the evidence, with no computing of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from terrain_cli.diagnosis.diagnosis_outcome import Verdict


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What a diagnosis found once the alarm was raised."""

    family: tuple[str, ...] = ()  # Effects that cannot be told from the best one, which comes first
    earned: bool = False  # The best one was named again in the trials, and leaves nothing over
    clear: bool = False  # The best one leaves little, if anything
    law_alone: bool = False  # A drafted law predicts better than every effect, of which the best leaves much
    # Two effects that together predict better than anything else; empty if there are none, or if the best
    # one, being clear, is one of them
    pair: tuple[str, ...] = ()
    pair_is_best: bool = False  # The pair also predicts better than the best effect does with any other
    # Effects that predict better than anything else once the stresses of the base linear are replaced; empty
    # if none does
    on_full_stresses: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What is said of it."""

    verdict: Verdict
    family: tuple[str, ...]  # The best first; `effect` alone where one name is given
    together: tuple[str, ...] = ()  # Two that belong together
    tells_law: bool = True  # A drafted law is told, alone or beside the family
    # "family" or "on_full_stresses" or "": which of the findings the next drive has to tell apart
    rivals: str = "family"

    @property
    def effect(self) -> str | None:
        """The one name, where one is earned."""
        return self.family[0] if self.verdict == "effect" else None


def decide(found: Findings, stresses: str) -> Decision:
    """Weigh the findings.

    The strongest statement wins: what the base linear gets wrong, then a pair, then a law that stands
    alone, then a single name that was earned, then a family.
    """
    if found.on_full_stresses:
        both = (stresses, found.on_full_stresses[0])
        family = (stresses, *found.on_full_stresses)
        return Decision(
            verdict="family", family=family, together=both, tells_law=False, rivals="on_full_stresses"
        )
    if found.pair:
        if not found.clear:
            return Decision(
                verdict="family", family=found.family or found.pair, together=found.pair, tells_law=False
            )
        joined = found.pair if found.pair_is_best else tuple(dict.fromkeys((*found.pair, *found.family)))
        return Decision(verdict="family", family=joined, together=found.pair, tells_law=False, rivals="")
    if found.law_alone:
        return Decision(verdict="unknown", family=(), rivals="")
    return Decision(verdict="effect" if found.earned else "family", family=found.family)
