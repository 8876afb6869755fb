"""The residuals of one wheel by sample, their noise, and the terms to be tested, summed in cells."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison.residual_scores import ScoreCell

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from terrain_cli.comparison.shapes import Shape
    from terrain_cli.vocabulary.arrays import Array, Index


#: Samples whose terms are computed at a time.
_SLAB = 8192


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
    therefore those at values interpolated from neighbouring samples (Durbin 1954), see `neighbours`.
    """

    # shape (n,): by channel, measured less predicted; NaN where one of them is not known
    residuals: Mapping[str, Array]
    slopes: Mapping[str, Slopes]
    drivers: Mapping[str, Array]  # shape (n,): labels by their codes; NaN where not known
    group: Index  # shape (n,): soil, counted over all wheels; samples of one group are contiguous
    block: Index  # shape (n,): counted over all wheels
    #: Values of shapes at the drivers, kept where they are few: every search of these samples asks for them
    #: again and again, and residuals do not change them.
    _kept: dict[tuple[Shape, ...], Array] = field(default_factory=dict, compare=False, repr=False)

    def __len__(self) -> int:
        return len(self.group)

    def terms(self, channel: str, shapes: Sequence[Shape], rows: slice) -> Array:
        """Evaluate derivatives by the common parameters, then shapes: (samples, m + shapes)."""
        return np.hstack([self.slopes[channel].common[rows], self._shaped(tuple(shapes), rows)])

    def _shaped(self, shapes: tuple[Shape, ...], rows: slice) -> Array:
        if shapes in self._kept:
            return self._kept[shapes]
        out = np.zeros((len(self.group[rows]), len(shapes)))
        for column, shape in enumerate(shapes):
            if shape.name == "constant":
                out[:, column] = 1.0
            elif shape.driver in self.drivers:
                out[:, column] = np.nan_to_num(shape(self.drivers[shape.driver][rows]))
        if len(self) <= _SLAB:
            self._kept[shapes] = out
        return out

    def cells(
        self, channel: str, shapes: Sequence[Shape], columns: Index, weight: float
    ) -> Iterator[ScoreCell]:
        """Yield the samples of a channel by block and group; `columns` places its terms among all."""
        residual = self.residuals.get(channel)
        if residual is None or len(self) == 0:
            return
        change = (self.group[1:] != self.group[:-1]) | (self.block[1:] != self.block[:-1])
        ends = np.append(np.flatnonzero(change) + 1, len(self))
        known = np.isfinite(residual)
        error = np.where(known, residual, 0.0)
        for start in range(0, len(self), _SLAB):
            stop = min(start + _SLAB, len(self))
            use = known[start:stop, None]
            terms = np.where(use, self.terms(channel, shapes, slice(start, stop)), 0.0)
            soil = np.where(use, self.slopes[channel].soil[start:stop], 0.0)
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
