"""Fits of models in which a channel is late: behind what a fit before predicts."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from terrain_cli.estimation.wheel_fit.fit_result import Fit

#: Times at most that a model is fitted behind what it predicts, and the change of a parameter, in typical
#: sizes, below which that is settled: of a lag 0.5 ms. A pull late by 0.4 s came out as 0.51, 0.39, 0.40.
PASSES, CLOSE = 6, 5e-3


def behind(fitted: Callable[[Mapping[str, Any]], Fit], past_of: Callable[[Fit], Mapping[str, Any]]) -> Fit:
    """Fit a model; where it has late channels, again behind what it predicts, until that is settled.

    `fitted` fits it with the past of some channels, and `past_of` returns what a fit predicts along whole
    stretches, without what it has late.
    """
    found = fitted({})
    if not found.model.remembers:
        return found
    own, passes = found.model.parameters, 0
    while (past := past_of(found)) and passes < PASSES:
        before, found = found.shared, fitted(past)
        passes += 1
        moved = [abs(found.shared[name] - before[name]) / own[name].scale for name in before if name in own]
        if passes > 1 and max(moved, default=0.0) < CLOSE:
            break
    return found


def settled(common: Any, before: Any) -> bool:
    """Tell whether that is so of parameters in deviations of their priors, five typical sizes each."""
    return bool(np.abs(common - before).max(initial=0.0) < 0.2 * CLOSE)
