"""How many soils there are: segments are joined where one soil predicts them as well as several."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import blocks, held_out, smoothed_model
from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.vocabulary.quantities import the_wheel

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from terrain_cli.comparison.fitted_wheel import FittedWheel
    from terrain_cli.vocabulary.arrays import Array, Index


#: Parts of a log that are left out in turn.
_PARTS = 24


def as_few_as_predict(
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
        part = blocks.fine([len(wheel)], shortest, most=_PARTS)[0].astype(np.intp)
        difference = _loss(fewer, wheel, part) - _loss(wheel, wheel, part)
        if float(difference.sum()) <= criteria.AS_GOOD * blocks.error(difference):
            result.append(fewer)
            samples = wheel.windows.samples
            told.append(
                f"{samples.source}: {the_wheel(samples.wheel)}: one soil predicts as well as those of "
                f"{len(wheel.windows)} segments, which are taken as {len(fewer.windows)}"
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
    out = held_out.predict(wheel, part, scale)
    total = np.zeros(int(part.max(initial=0)) + 1)
    for name, measured in wheel.measured.items():
        error = (measured - out[name]) / scale[name]
        error = np.where(np.isfinite(measured) & ~np.isfinite(error), smoothed_model.NO_ANSWER, error)
        total += np.bincount(part, np.nan_to_num(smoothed_model.bounded(np.nan_to_num(error))), len(total))
    return total
