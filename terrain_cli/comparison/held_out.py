"""Predictions of blocks by fits to the others; and by them, whether one soil is as good as several."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison import blocks, smoothed_model
from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.estimation import prediction
from terrain_cli.estimation.wheel_fit import normal_equations
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.quantities import the_wheel

#: Parts in turn left out of a segment that is a single block, and of a log to tell one soil from several.
PARTS, _PARTS_OF_LOG = 4, 24
FARTHEST = 2.0  # Farthest that a parameter moves when a block is left out, in widths of its prior
_FAR = 0.05  # Mean square of a change, in units of the noise, from which on it is looked at twice


def folds(window: Index, block: Index) -> Index:
    """Cut windows into what is left out in turn: blocks, or parts of a window that is a single block.

    Arrays are of shape (n,); the samples of a window are contiguous.
    """
    fold = block.copy()
    free = int(block.max(initial=0)) + 1
    change = np.flatnonzero(np.diff(window)) + 1
    for low, high in pairwise([0, *change.tolist(), len(window)]):
        if high - low > 1 and np.all(block[low:high] == block[low]):
            parts = min(PARTS, high - low)
            fold[low:high] = free + (np.arange(high - low) * parts) // (high - low)
            free += parts
    return np.unique(fold, return_inverse=True)[1].astype(np.intp)


def cells(window: Index, fold: Index) -> tuple[Index, Index, Index]:
    """Return the window and the fold of each cell, shape (cells,), and the cell of each sample."""
    count = int(fold.max(initial=0)) + 1
    code, cell = np.unique(window * count + fold, return_inverse=True)
    return code // count, code % count, cell.astype(np.intp)


def predict(wheel: FittedWheel, block: Index, scale: Mapping[str, float]) -> dict[str, Array]:
    """Predict every sample, by channel and of shape (n,), by a fit of the other blocks.

    The fit without a block is one step of Gauss and Newton away from the fit of all: exactly so for
    a model that is linear in its parameters. The prediction is the model's at that place, or, where that
    has left a curved valley of the fit, the linear one, which follows the valley (`nearer`).

    `scale` is the standard deviation that weighs the residuals of a channel.
    """
    fold = folds(wheel.window, block)
    cell, moved, tables = _without(wheel, fold, scale)
    names, whole = (*wheel.soil, *wheel.common), wheel.predicted

    def parameters(rows: Index) -> dict[str, Array]:
        found = wheel.of_samples(rows)
        for column, name in enumerate(names):
            width = FARTHEST * wheel.prior[name]
            move = np.clip(moved[cell[rows], column], -width, width)
            found[name] = found[name] * np.exp(move) if name in wheel.logarithmic else found[name] + move
            if name in wheel.model.parameters:
                own = wheel.model.parameters[name].under(*wheel.under)
                found[name] = np.clip(found[name], own.lower, own.upper)
        if "sinkage_exponent" in found:
            found["sinkage_exponent"] = np.maximum(found["sinkage_exponent"], 0.1)
        return found

    there = tuple(wheel.measured)
    near = whole.get("sinkage")
    out = prediction.values(wheel.model, wheel.geometry, wheel.read, parameters, there, near)
    change = {name: np.nan_to_num((out[name] - whole[name]) / scale[name]) for name in there}
    far = np.flatnonzero(_per_fold(change, fold)[fold] > _FAR)
    if len(far):
        step = moved[cell[far]]
        linear = {
            name: np.nan_to_num(np.einsum("np,np->n", tables[name][far], step) / scale[name])
            for name in there
        }
        chosen = nearer(linear, {name: column[far] for name, column in change.items()}, fold[far])
        for name in there:
            out[name][far[chosen]] = (whole[name][far] + linear[name] * scale[name])[chosen]
    return out


def nearer(linear: Mapping[str, Array], change: Mapping[str, Array], fold: Index) -> NDArray[np.bool_]:
    """Tell for which samples a prediction linear in the parameters is the better one without their fold.

    Where parameters make up for one another the fit lies in a valley, which is curved. A step along its
    tangent leaves it, and the model predicts there what no fit of the other blocks would; the linear
    prediction stays. So the one that changes less over a fold is taken. The changes, linear and the model's
    own, are by channel, shape (n,), in units of the noise.
    """
    return (_per_fold(linear, fold) < _per_fold(change, fold))[fold]


def _per_fold(change: Mapping[str, Array], fold: Index) -> Array:
    """Return the mean square of a change over the samples and channels of each fold."""
    squares = np.asarray(sum(column**2 for column in change.values()))
    count = len(change) * np.bincount(fold)
    return np.asarray(np.bincount(fold, squares) / np.maximum(count, 1))


def _without(
    wheel: FittedWheel, fold: Index, scale: Mapping[str, float]
) -> tuple[Index, Array, dict[str, Array]]:
    """Return the cell of each sample, and how far a cell's parameters move when its fold is left out.

    In the unit sought: logarithms of parameters that are positive. Also the slopes of predictions by them.
    """
    names = (*wheel.soil, *wheel.common)
    window_of, fold_of, cell = cells(wheel.window, fold)
    tables = wheel.slopes(wheel.read, np.arange(len(wheel)))
    for table in tables.values():
        for column, parameter in enumerate(names):
            if parameter in wheel.logarithmic:
                table[:, column] *= wheel.parameters[parameter][wheel.window]
    error = np.stack([wheel.residuals[name] / scale[name] for name in tables], axis=1)
    design = np.stack([table / scale[name] for name, table in tables.items()], axis=1)
    unknown = ~np.isfinite(error)
    error[unknown], design[unknown] = 0.0, 0.0
    information = normal_equations.products(design, design, cell, len(fold_of))
    score = normal_equations.products(design, error[..., None], cell, len(fold_of))[..., 0]
    prior = np.diag([wheel.prior[name] ** -2.0 for name in names])
    own = wheel.model.parameters
    low, high = (
        np.array([getattr(own[name], side) if name in own else end for name in wheel.common])
        for side, end in (("lower", -np.inf), ("upper", np.inf))
    )
    # All samples have the same ones; of a positive one the logarithm moves, which no bounds end.
    here = np.array([wheel.of_samples(slice(0, 1))[name][0] for name in wheel.common])
    farthest = FARTHEST * np.array([wheel.prior[name] for name in wheel.common])
    reach = (np.maximum(low - here, -farthest), np.minimum(high - here, farthest))
    moved = normal_equations.leave_out(information, score, window_of, fold_of, prior, len(wheel.soil), reach)
    return cell, moved, tables


def join_segments(
    wheels: Sequence[FittedWheel], progress: Callable[[str], None] = lambda _: None
) -> tuple[list[FittedWheel], list[str]]:
    """Join the segments of wheels of which one soil for each terrain predicts no worse.

    A model without something that follows the drive needs a new soil at every turn; with it, one is
    enough, and that shows only where the soils are joined. Also returned is what has to be said about it.
    """
    result, told = [], []
    for wheel in wheels:
        progress(f"one soil or several under {the_wheel(wheel.windows.samples.wheel)}")
        one = wheel.one_soil
        # Samples in another order would be in other blocks than those of the model compared with.
        if one is None or np.any(np.diff(one[1]) != 1):
            result.append(wheel)
            continue
        fewer = one[0]
        shortest = criteria.BLOCK_SAMPLES if wheel.ordered else 1
        part = blocks.fine([len(wheel)], shortest, most=_PARTS_OF_LOG)[0].astype(np.intp)
        difference = _loss(fewer, wheel, part) - _loss(wheel, wheel, part)
        if float(difference.sum()) <= criteria.AS_GOOD * blocks.error(difference):
            result.append(fewer)
            samples = wheel.windows.samples
            told.append(
                f"{samples}: one soil predicts as well as one for "
                f"each of {len(wheel.windows)} segments; these are fitted as {len(fewer.windows)}"
            )
        else:
            result.append(wheel)
    return result, told


def _loss(wheel: FittedWheel, like: FittedWheel, part: Index) -> Array:
    """Return the held-out loss by part, in units of what the second wheel leaves."""
    scale = {}
    for name, error in like.residuals.items():
        level = like.noise[name].deviation
        rms = float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else 1.0
        least = max(level, criteria.LEAST_NOISE_OF_SCALE * rms) if np.isfinite(level) else rms
        scale[name] = max(least, 1e-300)
    out = predict(wheel, part, scale)
    total = np.zeros(int(part.max(initial=0)) + 1)
    for name, measured in wheel.measured.items():
        error = (measured - out[name]) / scale[name]
        error = np.where(np.isfinite(measured) & ~np.isfinite(error), smoothed_model.NO_ANSWER, error)
        total += np.bincount(part, np.nan_to_num(smoothed_model.bounded(np.nan_to_num(error))), len(total))
    return total
