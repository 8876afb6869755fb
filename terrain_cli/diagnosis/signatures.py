"""What an effect would leave in the residuals (derivatives by its parameters at their nulls), with scores.

No refit is needed. Of the residual e of the fitted model, its derivatives J by what was fitted and the
signature g of a candidate, all in units of the noise, only the part ĝ of g that no change of the fit
imitates can show; the score of a block is the sum of ĝ e over it (Rao 1948, with the projection of Neyman
1959). Each window has parameters of its own: they are eliminated window by window.
"""

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison import comparison_criteria, whitening
from terrain_cli.comparison.blocks import DRAWS, joined, long_enough, max_test
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.comparison.smoothed_channels import inputs_known
from terrain_cli.comparison.whitening import Whitening
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.effects import Effect
from terrain_cli.estimation.prediction import derivatives
from terrain_cli.estimation.wheel_fit import normal_equations
from terrain_cli.mechanics.wheel_model import STRESSES, Model
from terrain_cli.vocabulary.arrays import Array, Index

#: Short blocks of which chance is drawn: what costs little. No score exceeds √blocks standard errors, however
#: large the effect.
_MOST_BLOCKS = 400


@dataclass(frozen=True)
class Signature:
    """Derivatives of the predictions by the parameters of an effect."""

    effect: Effect
    names: tuple[str, ...]  # Qualified names of the parameters, without those that only shape it
    tables: dict[str, Array]  # shape (n, len(names)): by channel; per typical size of each parameter


class SignatureEvidence(NamedTuple):
    """Residuals of some samples of a wheel, in units of their noise."""

    channels: dict[str, Array]  # shape (n,): without their own noise
    white: Whitening
    residual: Array  # shape (n, c): 0 where not known
    known: NDArray[np.bool_]  # shape (n, c)
    soil: Array  # shape (n, c, q): derivatives by the parameters that were fitted

    def whitened(self, tables: Mapping[str, Array], width: int) -> Array:
        """Whiten derivatives (n, width), which are 0 in channels that they do not reach, to (n, c, width)."""
        nothing = np.zeros((len(self.residual), width))
        return self.white({n: np.nan_to_num(tables.get(n, nothing)) for n in self.white.channels}, self.known)


def evidence(wheel: FittedWheel, rows: Index) -> SignatureEvidence:
    """Collect what the residuals of some usable samples of a wheel have to say."""
    channels, slopes = wheel.noiseless(rows)
    white = whitening.of_residuals(wheel.residuals, wheel.levels, wheel.record.group, wheel.memory)
    errors = {name: wheel.residuals[name][rows] for name in white.channels}
    known = np.stack([np.isfinite(error) & inputs_known(channels) for error in errors.values()], axis=1)
    residual = white({name: np.nan_to_num(error) for name, error in errors.items()}, known)
    found = SignatureEvidence(channels, white, residual, known, np.zeros(0))
    names = (*wheel.soil, *wheel.common)
    return found._replace(soil=found.whitened(slopes, len(names)))


def of_effects(
    wheel: FittedWheel, effects: Iterable[Effect], channels: Mapping[str, Array], rows: Index
) -> Iterator[Signature]:
    """Differentiate the predictions by the parameters of effects that the model does not have.

    One signature for each of several values of parameters that only shape an effect, and one for each other
    form of its laws.
    """
    together: list[Effect] = []
    alone: list[Effect] = []
    for effect in effects:
        shaped = any(parameter.shape for parameter in effect.parameters)
        (alone if shaped or STRESSES.intersection(effect.laws) else together).append(effect)
        alone.extend(effect.forms[1:])
    if together:
        tables = _tables(wheel, together, channels, rows, {})
        for effect in together:
            yield _of(effect, tables, together)
    for at, several in _passes(alone, channels):
        tables = _tables(wheel, several, channels, rows, at)
        for effect in several:
            yield _of(effect, tables, several)


def _passes(
    effects: Iterable[Effect], channels: Mapping[str, Array]
) -> Iterator[tuple[dict[str, float], list[Effect]]]:
    """Share the shapes of effects out to as few passes as there can be, each with values of all its shapes.

    In a pass an effect has one shape, and all effects need the same channels: samples that lack one have none
    of its signatures.
    """
    passes: dict[Hashable, tuple[dict[str, float], list[Effect]]] = {}
    turn: Counter[Hashable] = Counter()
    for effect in effects:
        kind = bool(STRESSES.intersection(effect.laws)), effect.needs
        shapes = [p for p in effect.parameters if p.shape]
        for values in zip(*(p.tried([channels]) for p in shapes), strict=True) if shapes else [()]:
            turn[effect.id, kind] += 1
            at, several = passes.setdefault((kind, turn[effect.id, kind]), ({}, []))
            at.update({effect.qualified(p): value for p, value in zip(shapes, values, strict=True)})
            several.append(effect)
    yield from passes.values()


def leading(effect: Effect) -> list[str]:
    """Name the parameters of an effect that do not only shape it."""
    return [effect.qualified(p) for p in effect.parameters if not p.shape]


def _tables(
    wheel: FittedWheel,
    effects: Sequence[Effect],
    channels: Mapping[str, Array],
    rows: Index,
    at: Mapping[str, float],
) -> dict[str, Array]:
    model = Model(wheel.model.base, (*wheel.model.effects, *effects))
    absent = {**model.nulls(), **at}
    names = [name for effect in effects for name in leading(effect)]

    def parameters(some: Index) -> dict[str, Array]:
        known = wheel.of_samples(rows[some])
        return {**{name: np.asarray(value) for name, value in absent.items() if name not in known}, **known}

    with np.errstate(all="ignore"):
        found = derivatives(model, wheel.geometry, channels, parameters, names)
    scales = np.array([model.parameters[name].under(*wheel.under).scale for name in names])
    return {channel: table * scales for channel, table in found.items()}


def _of(effect: Effect, tables: Mapping[str, Array], effects: Sequence[Effect]) -> Signature:
    names = [name for one in effects for name in leading(one)]
    own = leading(effect)
    place = [names.index(name) for name in own]
    return Signature(effect, tuple(own), {channel: table[:, place] for channel, table in tables.items()})


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
    rest = beyond_soil(columns, soil, window)
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


def beyond_soil(columns: Array, soil: Array, window: Index) -> Array:
    """Return what is left of columns, shape (n, c, m), when the soil of each window is fitted anew."""
    windows = int(window.max(initial=-1)) + 1
    found = normal_equations.eliminate(
        normal_equations.products(soil, soil, window, windows),
        normal_equations.products(soil, columns, window, windows),
        normal_equations.pseudo_inverse,
    )
    rest = columns.copy()
    for label, gain in enumerate(found.gain):
        rest[window == label] += soil[window == label] @ gain
    return rest


def short_blocks(wheel: FittedWheel, rows: Index, block: Index, blocks: int) -> tuple[Index, int]:
    """Cut samples into many blocks, and count these; where points or runs are blocks, they remain so.

    The number is the same for all wheels, whose scores are drawn together: some of the blocks may be empty.
    """
    run = wheel.windows.samples.labels.get("run")
    count = max(blocks, _MOST_BLOCKS)
    if not wheel.ordered or (run is not None and len(run.names) >= comparison_criteria.ENOUGH_RUNS):
        return block, count
    return np.arange(len(rows)) * _MOST_BLOCKS // max(len(rows), _MOST_BLOCKS), count


def without_memory(wheel: FittedWheel, rows: Index) -> Callable[[Array], Array]:
    """Return what takes off a table of samples what the noise of each has in common with the one before."""
    step = int(rows[1] - rows[0]) if len(rows) > 1 else 1
    memory = wheel.memory
    kept = comparison_criteria.FORGOTTEN ** (step / memory) if memory else 0.0
    place = np.stack([wheel.group[rows], wheel.window[rows]])
    first = np.concatenate([[True], (np.diff(place) != 0).any(axis=0)])[: len(rows)]

    def own(table: Array) -> Array:
        changed = table.copy()
        changed[1:] -= kept * table[:-1]
        changed[first] = np.sqrt(1.0 - kept**2) * table[first]
        return changed

    return own


def of_short_blocks(
    wheel: FittedWheel, rows: Index, known: SignatureEvidence, columns: Array, block: Index, blocks: int
) -> tuple[Scores, Scores]:
    """Score columns in blocks that may be far shorter than the memory of the noise.

    What a sample's noise has in common with that of the sample before is taken off first, of residuals and
    signatures alike (Prais & Winsten 1954, Cowles Commission Discussion Paper 383).

    Second are the scores of the same columns where each block weighs 1 over 1 + what the effect, in the size
    that fits best, adds to its sum of squares: nearly all of a large effect may fall into a few blocks, which
    chance gives the same sign easily.
    """
    window, own = wheel.window[rows], without_memory(wheel, rows)
    residual, soil, own_columns = map(own, (known.residual, known.soil, columns))
    found, rest = scores(residual, soil, own_columns, window, block, blocks)
    power = np.zeros((blocks, rest.shape[2]))
    np.add.at(power, block, (rest**2).sum(axis=1))
    size = found.total / np.maximum(power.sum(axis=0), 1e-300)
    even = rest / (1.0 + size**2 * power)[block][:, None, :]
    return found, scores(residual, soil, even, window, block, blocks)[0]


def in_longer_blocks(found: Scores, left: Array) -> Scores | None:
    """Join short blocks if the scores `left` of these, in what an effect leaves, are related; else None."""
    label = long_enough(left, independent=criteria.UNRELATED_SHORT_SCORES)
    return None if label is None else replace(found, blocks=joined(found.blocks, label))


def test(
    several: Sequence[Scores], testable: Sequence[NDArray[np.bool_]], *, seed: int
) -> list[tuple[Array, Array]]:
    """Test all columns of all wheels, over the same blocks, together against chance.

    Of each wheel: t and p-value of every column; 0 and 1 where it is not tested.
    """
    table = np.concatenate(
        [np.where(use, one.blocks, 0.0) for one, use in zip(several, testable, strict=True)], axis=1
    )
    shrunk = min(one.shrunk for one in several)
    found = max_test(table, shrunk=shrunk, seed=seed)
    ends = np.cumsum([one.blocks.shape[1] for one in several])[:-1]
    return list(zip(np.split(found.t, ends), np.split(found.p_values, ends), strict=True))


def test_of_points(
    several: Sequence[tuple[SignatureEvidence, Index]], left: Sequence[Array], *, seed: int
) -> list[tuple[Array, Array]]:
    """Test what is `left` of the columns of wheels at a few steady points, each with its windows, as `test`.

    No draw of the signs of a few points tells chance: a column may take nearly all that the soil leaves of
    any of them. Drawn is normal noise in all channels, of which the soil takes its part as of the residual
    (Freedman & Lane 1983, Journal of Business & Economic Statistics 1, 292); the share of it that a column
    takes does not depend on its size.
    """
    rng = np.random.default_rng(seed)
    shares, free = [], []
    for (known, window), columns in zip(several, left, strict=True):
        noise = rng.standard_normal((*known.known.shape, DRAWS)) * known.known[..., None]
        every = beyond_soil(np.concatenate([known.residual[..., None], noise], axis=2), known.soil, window)
        size = np.sqrt((columns**2).sum(axis=(0, 1)))[:, None] * np.sqrt((every**2).sum(axis=(0, 1)))
        shares.append(np.tensordot(columns, every, axes=((0, 1), (0, 1))) / np.maximum(size, 1e-300))
        free.append(np.count_nonzero(known.known) - known.soil.shape[2] * len(np.unique(window)) - 1)
    most = np.max([np.abs(one[:, 1:]).max(axis=0, initial=0.0) for one in shares], axis=0, initial=0.0)
    tests = []
    for share, number in zip(shares, free, strict=True):
        own = share[:, 0]
        beyond = np.count_nonzero(most >= np.abs(own)[:, None] * (1.0 - 1e-12), axis=1)
        t = own * np.sqrt(max(number, 1) / np.maximum(1.0 - own**2, 1e-12))
        tests.append((t, (1.0 + beyond) / (1.0 + DRAWS)))
    return tests
