"""Whether a channel wanders in time, as no noise of sensors does and no soil that stays the same.

Zeros of sensors drift, motors warm, and soils change little by little. Of each output of the model the
residuals are tested in every window for slow waves in time, all of them together (Rao 1948; see
`missing_effects`), when all that was fitted is fitted anew. What is constant in a window its soil takes up,
and no residual tells: it is as likely to be as large as the waves that show.

Waves of an output, or of c and tan φ, that need not show add to the covariance of what was fitted: by the
mean square that the data leave them, times their probability.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple, Self

import numpy as np

from terrain_cli.estimation.line.moments import segment_sum, window_products
from terrain_cli.estimation.wheel_fit.excess_scatter import exceeded, memory
from terrain_cli.estimation.wheel_fit.fit_data import BALANCE, FitData, level
from terrain_cli.estimation.wheel_fit.linearised import Equations, solve_lower
from terrain_cli.estimation.wheel_fit.normal_equations import arrow
from terrain_cli.estimation.wheel_fit.unknowns import Unknown
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
#: Probability before any data that something wanders, and by which shares of its size. Judged; of 35 rows
#: `ok` on soil whose c or φ changes along the drive 12 are off by more than three errors without it, and 3
#: of 33 with it (code, vehicles and soils of their own); of 50 clean drives the 45 `ok` stay.
_WANDERS, _SHARES = 0.3, 0.002 * 2.0 ** np.arange(7.0)
_STRESS = 10e3  # Pa; typical of wheels of rovers


class Wandering(NamedTuple):
    """What waves in time of an output, or of the soil, say of the windows' own unknowns."""

    moves: Array | None  # Shape (w, p): by how much they may be off; None where no waves are beyond chance
    covariance: Array  # Shape (w, p, p): what waves add to theirs, though they need not show


def wandering(
    parts: list[Equations], data: FitData, t: Array, local: Sequence[Unknown], second: float
) -> Iterator[Wandering]:
    """Yield it of each output, then of cohesion and friction, which change with the place.

    `parts` are the last equations at what was fitted, `t`, shape (w, p): values of `local`.
    """
    residual = np.concatenate([one.residual for one in parts], axis=1)
    design = np.concatenate([one.design for one in parts], axis=2)[:, : t.shape[1]]
    factor = np.concatenate([one.factor for one in parts], axis=2)
    waves = _waves(data.count, second)
    lasting = np.ones(len(t))
    for row, name in enumerate(data.outputs):
        added = np.zeros((len(residual), len(waves) + 1, len(data.seen[row])))
        added[row, :-1], added[row, -1] = waves * data.seen[row], data.seen[row]
        both = _Both.of(residual, design, solve_lower(factor, added), data, t)
        found = _of_waves(both, residual[row], row, data)
        lasting = np.maximum(lasting, found.lasting)
        moves = None
        if found.free and found.squares > exceeded(found.free, _RARELY):
            moves = np.einsum("wpq,wq->wp", both.own, both.information[:, : t.shape[1], -1]) * found.size
        size = level(data.channels["load"] if name == BALANCE else data.measured[row])
        yield Wandering(moves, both.allowed(found.lasting, size))
    for place, size in _of_soil(t, local):
        both = _Both.of(residual, design, design[:, [place]] * waves, data, t)
        yield Wandering(None, both.allowed(lasting, size))


def _of_soil(t: Array, local: Sequence[Unknown]) -> Iterator[tuple[int, float]]:
    """Yield where tan φ and c stand, and how large they are, in prior standard deviations.

    That of c is the strength under a stress of some 10 kPa: what changes is told by the strength.
    """
    at = {one.name: place for place, one in enumerate(local)}
    for name, share in (("tan_phi", 1.0), ("cohesion", _STRESS)):
        if name in at and "tan_phi" in at:
            friction = local[at["tan_phi"]]
            size = share * level(friction.value(t[:, at["tan_phi"]]))
            yield at[name], size / local[at[name]].sd


class _Waves(NamedTuple):
    squares: float  # χ² of all waves of all windows, and its degrees of freedom
    free: int
    size: float  # Root mean square of all waves of a window in the output's unit, beyond chance
    lasting: Array  # Shape (w,): samples of the noise that make an independent one


class _Both(NamedTuple):
    """Normal equations of the windows with what is added, m columns, beside their own unknowns."""

    design: Array  # Shape (outputs, p + m, n)
    information: Array  # Shape (w, p + m, p + m)
    own: Array  # Shape (w, p, p): covariance of their own unknowns alone
    gain: Array  # Shape (w, p, m): change of these with what is added
    left: (
        Array  # Shape (w, m, m) and (w, m): information on what is added, and its score, all else fitted anew
    )
    score: Array

    @classmethod
    def of(cls, residual: Array, design: Array, added: Array, data: FitData, t: Array) -> Self:
        local = t.shape[1]
        both = np.concatenate([design, added], axis=1)
        information = window_products(both, both, data.bounds)
        score = segment_sum(np.einsum("apn,an->pn", both, residual), data.bounds).T
        found, _ = arrow(information, local, np.eye(both.shape[1]))
        left = information[:, local:, local:] + information[:, local:, :local] @ found.gain
        score = score[:, local:] + np.einsum("wpm,wp->wm", found.gain, score[:, :local] - t)
        return cls(both, information, found.own, found.gain, left, score)

    def allowed(self, lasting: Array, size: float) -> Array:
        """Return what is added to the covariance by something of an unknown share of a size, or by nothing.

        Each share is as likely as the next one beforehand, and the same in all windows.
        """
        known, axes = np.linalg.eigh(self.left)
        score = np.einsum("wmk,wm->wk", axes, self.score) / lasting[:, None]
        variance = (_SHARES * size)[:, None, None] ** 2
        grown = 1.0 + np.maximum(known, 0.0) / lasting[:, None] * variance
        likely = 0.5 * np.sum(score**2 * variance / grown - np.log(grown), axis=(1, 2))
        odds = np.append(likely + np.log(_WANDERS / len(_SHARES)), np.log1p(-_WANDERS))
        odds = np.exp(odds - odds.max())
        odds = odds[:-1] / odds.sum()
        left, own = variance / grown, self.gain @ axes
        mean = np.einsum("wpk,swk->swp", own, score * left)
        found = np.einsum("wpk,s,swk,wqk->wpq", own, odds, left, own)
        return np.asarray(found + np.einsum("s,swp,swq->wpq", odds, mean, mean))


def _of_waves(both: _Both, residual: Array, row: int, data: FitData) -> _Waves:
    """Test the waves of an output, without the constant that stands last."""
    local = both.own.shape[1]
    left, score = both.left[:, :-1, :-1], both.score[:, :-1]
    power = np.einsum("wmm->wm", both.information)[:, local:-1]
    scale = np.where(power > 0.0, np.sqrt(power), np.inf)
    size, axes = np.linalg.eigh(left / (scale[:, :, None] * scale[:, None, :]))
    told = size > _LEFT
    along = np.where(told, np.einsum("wmk,wm->wk", axes, score / scale), 0.0)
    held = np.where(told, size, 1.0)
    sizes = np.einsum("wmk,wk->wm", axes, along / held) / scale
    # What the waves leave of the channel is noise, which may last.
    moved = np.concatenate([np.einsum("wpm,wm->wp", both.gain[:, :, :-1], sizes), sizes], axis=1)
    rest = residual - np.einsum("pn,np->n", both.design[row, :-1], np.repeat(moved, data.count, axis=0))
    free = told.sum(axis=1)
    lasting = memory(rest[None], data.bounds, taken=free.astype(float))[0]
    squares = float(np.sum(along**2 / held / lasting[:, None]))
    # Of the waves that the fit leaves all alike: each with a mean square of a half.
    known = float(np.sum(np.einsum("wmm->w", left) / lasting))
    power = 0.5 * free.mean() * max(squares - free.sum(), 0.0) / known if known > 0.0 else 0.0
    return _Waves(squares, int(free.sum()), float(np.sqrt(power)), lasting)


def _waves(count: Index, second: float) -> Array:
    """Return half waves from the start to the end of each window, shape (m, n); 0 beyond those it has."""
    n = int(count.sum())
    place = (np.arange(n) - np.repeat(np.cumsum(count) - count, count) + 0.5) / np.repeat(count, count)
    most = np.minimum(count / (_LASTS * second), count / _SAMPLES)
    number = np.arange(1, _WAVES + 1)[:, None]
    return np.where(number <= np.repeat(most, count), np.cos(np.pi * number * place), 0.0)
