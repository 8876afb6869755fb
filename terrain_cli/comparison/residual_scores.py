"""Score test of further terms, block by block, with the fitted parameters projected out.

The residual e of a fitted model is, to first order, noise + J δ + b a: parameters a little off, and
perhaps a further term b. What b adds is seen only in the part b̂ of it that no δ can imitate, and its
score is Σ b̂ w e. Parameters of the soil are each group's own, all others are common, which makes the
system an arrow: the groups are eliminated one by one, the common terms by what is left.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from terrain_cli.comparison.shapes import Shape
from terrain_cli.estimation.wheel_fit.normal_equations import eliminate, pseudo_inverse
from terrain_cli.vocabulary.arrays import Array, Index

#: Samples whose terms are computed at a time, and those of a wheel up to which these are kept.
_SLAB, _FEW = 8_192, 16_384


@dataclass(frozen=True, kw_only=True)
class ScoreCell:
    """Some samples of one channel, in one group and, unless blocks are of no matter, in one block."""

    group: int
    block: int
    columns: Index  # shape (m,): places of `terms` among all terms
    weight: float  # Of each sample: 1 over the variance of the channel's noise
    residual: Array  # shape (n,)
    soil: Array  # shape (n, q): derivatives of the prediction by the group's own parameters
    terms: Array  # shape (n, m)


@dataclass(frozen=True)
class Slopes:
    """Derivatives of one channel's prediction by the parameters that were fitted."""

    soil: Array  # shape (n, q): by those of which every group has its own
    common: Array  # shape (n, m): by those common to all


@dataclass(frozen=True, kw_only=True)
class ResidualEvidence:
    """Residuals of one wheel, and what they may follow.

    Slip, load and sinkage as measured carry noise, which is in the residual and in anything computed
    from them alike: the two would be correlated where nothing is missing. Derivatives and drivers are
    therefore those at values interpolated from neighbouring samples (Durbin 1954), see
    `smoothed_channels.from_neighbours`.
    """

    # shape (n,): by channel, measured less predicted; NaN where one of them is not known
    residuals: Mapping[str, Array]
    slopes: Mapping[str, Slopes]
    drivers: Mapping[str, Array]  # shape (n,): labels by their codes; NaN where not known
    group: Index  # shape (n,): soil, counted over all wheels; samples of one group are contiguous
    block: Index  # shape (n,): counted over all wheels
    #: Shapes and terms by channel and first sample, kept where they are few: every search of these samples
    #: asks for them again and again, and residuals do not change them.
    _kept: dict[tuple[str, int], tuple[Sequence[Shape], Array]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def __len__(self) -> int:
        return len(self.group)

    def terms(self, channel: str, shapes: Sequence[Shape], rows: slice) -> Array:
        """Evaluate derivatives by the common parameters, then shapes: (samples, m + shapes)."""
        kept = self._kept.get((channel, rows.start))
        if kept is not None and kept[0] is shapes:
            return kept[1]
        found = np.hstack([self.slopes[channel].common[rows], self._shaped(shapes, rows)])
        if len(self) <= _FEW:
            self._kept[channel, rows.start] = shapes, found
        return found

    def _shaped(self, shapes: Sequence[Shape], rows: slice) -> Array:
        for (_, start), (known, kept) in self._kept.items():
            if start == rows.start and known == shapes:
                return kept[:, kept.shape[1] - len(shapes) :]
        out = np.zeros((len(self.group[rows]), len(shapes)))
        for column, shape in enumerate(shapes):
            if shape.name == "constant":
                out[:, column] = 1.0
            elif shape.driver in self.drivers:
                out[:, column] = np.nan_to_num(shape(self.drivers[shape.driver][rows]))
        return out

    def cells(
        self, channel: str, shapes: Sequence[Shape], columns: Index, weight: float, *, by_block: bool = True
    ) -> Iterator[ScoreCell]:
        """Yield the samples of a channel by group, and block; `columns` places its terms among all."""
        residual = self.residuals.get(channel)
        if residual is None or len(self) == 0:
            return
        change = self.group[1:] != self.group[:-1]
        if by_block:
            change |= self.block[1:] != self.block[:-1]
        ends = np.append(np.flatnonzero(change) + 1, len(self))
        known = np.isfinite(residual)
        error = np.where(known, residual, 0.0)
        for start in range(0, len(self), _SLAB):
            stop = min(start + _SLAB, len(self))
            use = known[start:stop, None]
            terms = self.terms(channel, shapes, slice(start, stop))
            soil = self.slopes[channel].soil[start:stop]
            if not use.all():
                terms, soil = np.where(use, terms, 0.0), np.where(use, soil, 0.0)
            inside = ends[np.searchsorted(ends, start, side="right") : np.searchsorted(ends, stop)]
            for low, high in zip([start, *inside], [*inside, stop], strict=True):
                part = slice(low - start, high - start)
                yield ScoreCell(
                    group=int(self.group[low]),
                    block=int(self.block[low]),
                    columns=columns,
                    weight=weight,
                    residual=error[low:high],
                    soil=soil[part],
                    terms=terms[part],
                )

    def less(self, channel: str, shapes: Sequence[Shape], coefficients: Array, soil: Array) -> Array:
        """Take fitted terms, (m + shapes,), and changes of the soil, (groups, q), off a residual."""
        residual = self.residuals[channel].copy()
        for start in range(0, len(self), _SLAB):
            slab = slice(start, start + _SLAB)
            residual[slab] -= self.terms(channel, shapes, slab) @ coefficients
            residual[slab] -= np.einsum("nq,nq->n", self.slopes[channel].soil[slab], soil[self.group[slab]])
        return residual


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
        self.blocks = blocks
        self._squares = np.zeros(terms)
        self._soil: Array = np.asarray(precision[:, :, None] * np.eye(soil))
        self._mixed = np.zeros((groups, soil, terms))
        self._cross = np.zeros((terms, terms))

    def add(self, cells: Iterable[ScoreCell]) -> Self:
        """Collect the moments of all samples, eliminate the groups' own parameters, and return the system."""
        # Cells of one channel have one array of places: theirs are summed before they go among all terms.
        crosses: dict[tuple[int, float], tuple[Index, Array]] = {}
        for cell in cells:
            weight, columns = cell.weight, cell.columns
            self._soil[cell.group] += weight * cell.soil.T @ cell.soil
            self._mixed[cell.group][:, columns] += weight * (cell.soil.T @ cell.terms)
            if (id(columns), weight) not in crosses:
                crosses[id(columns), weight] = columns, np.zeros((len(columns), len(columns)))
            _, cross = crosses[id(columns), weight]
            # Of a table with itself half of the products are formed.
            cross += cell.terms.T @ cell.terms
        for (_, weight), (columns, cross) in crosses.items():
            self._cross[np.ix_(columns, columns)] += weight * cross
        self._squares = np.diag(self._cross).copy()
        self._groups = eliminate(self._soil, self._mixed, pseudo_inverse)
        self._cross -= self._groups.taken()
        return self

    def scores(self, cells: Iterable[ScoreCell]) -> Array:
        """Return the scores of every block and term, (blocks, terms)."""
        scores = np.zeros((self.blocks, len(self._squares)))
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
