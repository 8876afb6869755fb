"""Score test of further terms, block by block, with the fitted parameters projected out.

The residual e of a fitted model is, to first order, noise + J δ + b a: parameters a little off, and
perhaps a further term b. What b adds is seen only in the part b̂ of it that no δ can imitate, and its
score is Σ b̂ w e. Parameters of the soil are each group's own, all others are common, which makes the
system an arrow: the groups are eliminated one by one, the common terms by what is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.estimation.wheel_fit.normal_equations import eliminate, pseudo_inverse

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from terrain_cli.vocabulary.arrays import Array, Index


@dataclass(frozen=True, kw_only=True)
class ScoreCell:
    """Some samples of one channel, in one block and one group."""

    group: int
    block: int
    columns: Index  # shape (m,): places of `terms` among all terms
    weight: float  # Of each sample: 1 over the variance of the channel's noise
    residual: Array  # shape (n,)
    soil: Array  # shape (n, q): derivatives of the prediction by the group's own parameters
    terms: Array  # shape (n, m)


@dataclass(frozen=True)
class FittedTerms:
    """Coefficients of some terms and of every group's own parameters."""

    terms: Index  # shape (k,): places among all terms
    coefficients: Array  # shape (k,)
    soil: Array  # shape (groups, q): change of the group's parameters


class System:
    """All terms in the residuals of all channels, by block.

    `precision`, shape (groups, q), is what is known beforehand of how far the groups' own parameters may
    move: without it, where data tell little of one, it would move without end.
    """

    def __init__(self, precision: Array, blocks: int, terms: int) -> None:
        groups, soil = precision.shape
        self._blocks = blocks
        self._squares = np.zeros(terms)
        self._soil: Array = np.asarray(precision[:, :, None] * np.eye(soil))
        self._mixed = np.zeros((groups, soil, terms))
        self._cross = np.zeros((terms, terms))

    def add(self, cells: Iterable[ScoreCell]) -> System:
        """Collect the moments of all samples, eliminate the groups' own parameters, and return the system."""
        # Cells of one channel have one array of places: theirs are summed before they go among all terms.
        crosses: dict[int, tuple[Index, Array]] = {}
        for cell in cells:
            weighted, columns = cell.terms * cell.weight, cell.columns
            self._soil[cell.group] += cell.weight * cell.soil.T @ cell.soil
            self._mixed[cell.group][:, columns] += cell.soil.T @ weighted
            _, cross = crosses.setdefault(id(columns), (columns, np.zeros((len(columns), len(columns)))))
            cross += weighted.T @ cell.terms
        for columns, cross in crosses.values():
            self._cross[np.ix_(columns, columns)] += cross
        self._squares = np.diag(self._cross).copy()
        self._groups = eliminate(self._soil, self._mixed, pseudo_inverse)
        self._cross -= self._groups.taken()
        return self

    def scores(self, cells: Iterable[ScoreCell]) -> Array:
        """Return the scores of every block and term, (blocks, terms)."""
        scores = np.zeros((self._blocks, len(self._squares)))
        for cell in cells:
            error = cell.weight * cell.residual
            scores[cell.block, cell.columns] += cell.terms.T @ error
            scores[cell.block] += (cell.soil.T @ error) @ self._groups.gain[cell.group]
        return scores

    def beyond(self, terms: Sequence[int], scores: Array) -> tuple[Array, Array]:
        """Take some terms out of all others, and out of their scores, (blocks, terms).

        Also returns the products of what is left of the terms, (terms, terms).
        """
        chosen = np.asarray(terms, dtype=np.intp)
        if len(chosen) == 0:
            return scores, self._cross
        found = eliminate(self._cross[None, chosen][:, :, chosen], self._cross[None, chosen], pseudo_inverse)
        return scores + scores[:, chosen] @ found.gain[0], self._cross - found.taken()

    def surviving(self, cross: Array) -> Array:
        """Return the share of each term's square that is left, from the products that `beyond` returns."""
        return np.asarray(np.diag(cross) / np.where(self._squares > 0.0, self._squares, np.inf))

    def fit(self, terms: Sequence[int], cells: Iterable[ScoreCell]) -> FittedTerms:
        """Fit some terms and every group's own parameters to the residual together."""
        chosen = np.asarray(terms, dtype=np.intp)
        own, score = np.zeros(self._soil.shape[:2]), np.zeros(len(self._squares))
        for cell in cells:
            error = cell.weight * cell.residual
            own[cell.group] += cell.soil.T @ error
            score[cell.columns] += cell.terms.T @ error
        score += self._groups.pull(own)
        coefficients = pseudo_inverse(self._cross[np.ix_(chosen, chosen)]) @ score[chosen]
        every = np.zeros(len(score))
        every[chosen] = coefficients
        return FittedTerms(chosen, coefficients, self._groups.behind(own, every))
