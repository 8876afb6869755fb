"""Torque and pull predicted from the conditions of a drive, for effects whose laws read them.

An effect may read what is to be explained: load-transfer the drawbar pull. Fed with the pull as it was
measured, a model would predict the noise of a pull, or soil that varies, from themselves, and every such
effect would seem to help. So an effect is given the part of them that slip, load, slope and acceleration
explain (instrumental variables; Wooldridge 2010, Econometric Analysis of Cross Section and Panel Data,
chapter 5).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from terrain_cli.vocabulary.arrays import Array, Index


#: Channels that change pull and torque in proportion, beside slip.
_CAUSES = ("load", "sinkage", "pitch", "acceleration")
#: Places between which pull and torque are straight in slip, at most; and samples for each.
_PLACES, _SAMPLES = 8, 40
#: Samples of a window that tell what to expect, and samples of which that is computed at a time.
_TELL, _SLAB = 4_000, 65_536


def from_conditions(values: Array, channels: Mapping[str, Array], window: Index) -> Array:
    """Return what a channel is on average under the conditions of each sample, shape (n,).

    `channels` are slip, and what else there is; each window has one soil. Values are NaN where not known;
    the result is NaN where slip is not known, or nothing is known of the window.
    """
    result = np.full(len(values), np.nan)
    if "slip" not in channels:
        return result
    slip = channels["slip"]
    # Where the load is known, sinkage follows from it.
    there = [name for name in _CAUSES if name in channels and not (name == "sinkage" and "load" in channels)]
    causes = [np.nan_to_num(channels[name]) for name in there]
    for label in range(int(window.max(initial=-1)) + 1):
        rows = np.flatnonzero((window == label) & np.isfinite(slip))
        known = rows[np.isfinite(values[rows])]
        if len(known) == 0:
            continue
        known = known[:: max(1, len(known) // _TELL)]
        count = int(np.clip(len(known) // _SAMPLES, 2, _PLACES))
        places = np.unique(np.quantile(slip[known], np.linspace(0.0, 1.0, count)))
        spans = [(float(np.mean(one[known])), float(np.std(one[known]))) for one in causes]
        varied = [(one, *span) for one, span in zip(causes, spans, strict=True) if span[1] > 0.0]
        found, *_ = np.linalg.lstsq(_table(slip, places, varied, known), values[known], rcond=1e-8)
        for start in range(0, len(rows), _SLAB):
            some = rows[start : start + _SLAB]
            result[some] = _table(slip, places, varied, some) @ found
    return result


def _table(slip: Array, places: Array, causes: Sequence[tuple[Array, float, float]], rows: Index) -> Array:
    """Return hats over slip, alone and times the first of the causes, and the causes."""
    hats = np.stack([np.interp(slip[rows], places, one) for one in np.eye(len(places))], axis=1)
    columns = [(one[rows] - middle) / deviation for one, middle, deviation in causes]
    crossed = [hats * columns[0][:, None]] if columns else []
    return np.concatenate([hats, *crossed, *(column[:, None] for column in columns[1:])], axis=1)
