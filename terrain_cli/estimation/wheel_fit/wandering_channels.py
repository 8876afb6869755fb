"""Whether a channel wanders in time, as no noise of sensors does and no soil that stays the same.

Zeros of sensors drift, motors warm, and soils change little by little. Of each output of the model the
residuals are tested in every window for slow waves in time, all of them together (Rao 1948; see
`missing_effects`), when all that was fitted is fitted anew. What is constant in a window its soil takes up,
and no residual tells: it is as likely to be as large as the waves that show.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum, window_products
from terrain_cli.estimation.wheel_fit.excess_scatter import exceeded, memory
from terrain_cli.estimation.wheel_fit.linearised import solve_lower
from terrain_cli.estimation.wheel_fit.normal_equations import arrow

if TYPE_CHECKING:
    from collections.abc import Iterator

    from terrain_cli.estimation.wheel_fit.fit_data import FitData
    from terrain_cli.estimation.wheel_fit.linearised import Equations
    from terrain_cli.vocabulary.arrays import Array, Index

#: Half waves in a window at the most, the s that each lasts at least, and its samples. Judged: noise of
#: sensors lasts up to 1 s, and zeros drift over tens of seconds.
_WAVES, _LASTS, _SAMPLES = 8, 5.0, 20
#: How rarely chance gives such waves over all windows: 3.1 standard deviations. In 88
#: clean drives of another simulator, noise that lasts up to 0.3 s among them, no row `ok` of 182 is lost by
#: it; of 1,359 windows of window_coverage_study (40 a row, seed 78500001; noise unknown and told) 3 are.
_RARELY = 1e-3
#: Share of a wave that the fit leaves, below which it tells nothing.
_LEFT = 1e-3


def wandering(parts: list[Equations], data: FitData, t: Array, second: float) -> Iterator[Array]:
    """Yield, of each output that wanders, by how much windows' own unknowns may be off for it, shape (w, p).

    `parts` are the last equations at what was fitted, `t`, shape (w, p).
    """
    residual = np.concatenate([one.residual for one in parts], axis=1)
    design = np.concatenate([one.design for one in parts], axis=2)[:, : t.shape[1]]
    factor = np.concatenate([one.factor for one in parts], axis=2)
    waves = _waves(data.count, second)
    for row in range(len(residual)):
        added = np.zeros((len(residual), 1 + len(waves), len(data.seen[row])))
        added[row, 0], added[row, 1:] = data.seen[row], waves * data.seen[row]
        added = solve_lower(factor, added)
        found = _of_waves(residual, design, added[:, 1:], data, t, row)
        if found.free and found.squares > exceeded(found.free, _RARELY):
            constant = segment_sum(np.einsum("apn,an->pn", design, added[:, 0]), data.bounds).T
            yield np.einsum("wpq,wq->wp", found.own, constant) * found.size


class _Waves(NamedTuple):
    squares: float  # χ² of all waves of all windows, and its degrees of freedom
    free: int
    size: float  # Root mean square of all waves of a window in the output's unit, beyond chance
    own: Array  # Shape (w, p, p): covariance of what was fitted


def _waves(count: Index, second: float) -> Array:
    """Return half waves from the start to the end of each window, shape (m, n); 0 beyond those it has."""
    n = int(count.sum())
    place = (np.arange(n) - np.repeat(np.cumsum(count) - count, count) + 0.5) / np.repeat(count, count)
    most = np.minimum(count / (_LASTS * second), count / _SAMPLES)
    number = np.arange(1, _WAVES + 1)[:, None]
    return np.where(number <= np.repeat(most, count), np.cos(np.pi * number * place), 0.0)


def _of_waves(residual: Array, design: Array, added: Array, data: FitData, t: Array, row: int) -> _Waves:
    """Fit what is added beside all unknowns of each window."""
    local, waves = t.shape[1], added.shape[1]
    both = np.concatenate([design, added], axis=1)
    information = window_products(both, both, data.bounds)
    score = segment_sum(np.einsum("apn,an->pn", both, residual), data.bounds).T
    found, _ = arrow(information, local, np.eye(local + waves))
    left = information[:, local:, local:] + information[:, local:, :local] @ found.gain
    score = score[:, local:] + np.einsum("wpm,wp->wm", found.gain, score[:, :local] - t)
    power = np.einsum("wmm->wm", information)[:, local:]
    scale = np.where(power > 0.0, np.sqrt(power), np.inf)
    size, axes = np.linalg.eigh(left / (scale[:, :, None] * scale[:, None, :]))
    told = size > _LEFT
    along = np.where(told, np.einsum("wmk,wm->wk", axes, score / scale), 0.0)
    held = np.where(told, size, 1.0)
    sizes = np.einsum("wmk,wk->wm", axes, along / held) / scale
    # What the waves leave of the channel is noise, which may last.
    moved = np.concatenate([np.einsum("wpm,wm->wp", found.gain, sizes), sizes], axis=1)
    rest = residual[row] - np.einsum("pn,np->n", both[row], np.repeat(moved, data.count, axis=0))
    free = told.sum(axis=1)
    lasting = memory(rest[None], data.bounds, taken=free.astype(float))[0]
    squares = float(np.sum(along**2 / held / lasting[:, None]))
    # Of the waves that the fit leaves all alike: each with a mean square of a half.
    known = float(np.sum(np.einsum("wmm->w", left) / lasting))
    power = 0.5 * free.mean() * max(squares - free.sum(), 0.0) / known if known > 0.0 else 0.0
    return _Waves(squares, int(free.sum()), float(np.sqrt(power)), found.own)
