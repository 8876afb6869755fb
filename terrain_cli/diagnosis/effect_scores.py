"""Scores of everything that may be missing, without a refit.

Of the residual e of the fitted model, its derivatives J by what was fitted and the signature g of a
candidate, all in units of the noise, only the part ĝ of g that no change of the fit imitates can show;
the score of a block is the sum of ĝ e over it (Rao 1948, with the projection of Neyman 1959). Each window
has parameters of its own: they are eliminated window by window.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison.bootstrap import DRAWS, max_test
from terrain_cli.estimation.wheel_fit import normal_equations

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


@dataclass(frozen=True)
class Scores:
    """Scores of the columns of one wheel."""

    blocks: Array  # shape (blocks, m)
    cross: Array  # shape (m, m): products of what is left of the signatures
    surviving: Array  # shape (m,): share of the square of each that is left
    shrunk: float  # Standard deviation of the residuals over that of the noise, for what was fitted to them

    @property
    def total(self) -> Array:
        """Sum over the blocks."""
        return np.asarray(self.blocks.sum(axis=0))

    def fit(self, columns: Index, precision: float = 0.0) -> tuple[Array, Array, float]:
        """Fit some columns together, to first order, with a prior about the null of some `precision`.

        Returns the change and its covariance in typical sizes, and what it takes off the sum of squares.
        """
        matrix = self.cross[np.ix_(columns, columns)] + precision * np.eye(len(columns))
        covariance = normal_equations.pseudo_inverse(matrix)
        change = covariance @ self.total[columns]
        return change, covariance, float(change @ self.total[columns])


def scores(
    residual: Array, soil: Array, columns: Array, window: Index, block: Index, blocks: int
) -> tuple[Scores, Array]:
    """Score columns, shape (n, c, m), against the residual of one wheel, shape (n, c).

    Both are in units of the noise; a residual is 0 where not known. `soil`, shape (n, c, q), has the
    derivatives by what was fitted, window by window. Also returns what is left of the columns when the soil
    is fitted anew.
    """
    windows = int(window.max(initial=-1)) + 1
    found = normal_equations.eliminate(
        normal_equations.products(soil, soil, window, windows),
        normal_equations.products(soil, columns, window, windows),
        normal_equations.pseudo_inverse,
    )
    rest = columns.copy()
    for label, gain in enumerate(found.gain):
        rest[window == label] += soil[window == label] @ gain
    result = normal_equations.products(rest, residual[..., None], block, blocks)[..., 0]
    cross, squares = np.tensordot(rest, rest, axes=((0, 1), (0, 1))), (columns**2).sum(axis=(0, 1))
    fitted = soil.shape[2] * len(np.unique(window))
    known = int(np.count_nonzero(residual))
    return (
        Scores(
            result,
            cross,
            np.diag(cross) / np.where(squares > 0.0, squares, np.inf),
            float(np.sqrt(max(1.0 - fitted / max(known, 1), 0.1))),
        ),
        rest,
    )


def test(
    several: Sequence[Scores], testable: Sequence[NDArray[np.bool_]], chance: Sequence[Array], *, seed: int
) -> list[tuple[Array, Array]]:
    """Test all columns of all wheels, over the same blocks, together against chance.

    `chance` has the scores of what the strongest candidate leaves, shape (blocks, m). Of each wheel: t and
    p-value of every column; 0 and 1 where it is not tested.
    """
    table, left = (
        np.concatenate([np.where(use, one, 0.0) for one, use in zip(tables, testable, strict=True)], axis=1)
        for tables in ([one.blocks for one in several], chance)
    )
    shrunk = min(one.shrunk for one in several)
    found = max_test(table, shrunk=shrunk, draws=DRAWS, seed=seed, chance=left)
    ends = np.cumsum([one.blocks.shape[1] for one in several])[:-1]
    return list(zip(np.split(found.t, ends), np.split(found.p_values, ends), strict=True))
