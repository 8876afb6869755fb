"""Refits in their order: which predicts better, and which has parameters that are physically possible."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import smoothed_covariance
from terrain_cli.diagnosis import diagnosis_criteria as criteria

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
    from terrain_cli.diagnosis.refits import Ground, Refit

    Array = NDArray[np.float64]


def error(difference: Array) -> float:
    """Return the standard error of a sum over blocks; infinite where there is but one."""
    return float(np.std(difference, ddof=1) * np.sqrt(len(difference))) if len(difference) > 1 else np.inf


def beats(one: Refit, other: Refit) -> bool:
    """Tell whether one model predicts better than another, beyond chance."""
    gain = other.loss - one.loss
    return float(gain.sum()) > criteria.BETTER * error(gain)


def as_good(one: Refit, other: Refit) -> bool:
    """Tell whether one model predicts no worse than another."""
    difference = one.loss - other.loss
    return float(difference.sum()) <= criteria.AS_GOOD * error(difference)


def at_bounds(hypothesis: Hypothesis, one: Refit) -> bool:
    """Tell whether a parameter of an effect ran to the end of what it can be."""
    own = hypothesis.parameters
    for solution in one.solutions:
        for column, unknown in enumerate(solution.unknowns.shared):
            parameter = own.get(unknown.name)
            if parameter is None or parameter.shape:
                continue
            if parameter.at_bound(float(unknown.value(solution.common[column]))):
                return True
    return False


def imitates(data: Ground, hypothesis: Hypothesis, one: Refit) -> bool:
    """Tell whether an effect went, beyond doubt, to where nature has none: friction that drives, say."""
    bounded = [effect for effect in hypothesis.effects if effect.limits]
    for part, solution in zip(data.data, one.solutions, strict=True) if bounded else ():
        _, covariance = smoothed_covariance.covariance(part, solution)
        fitted = zip(solution.unknowns.shared, solution.common, strict=True)
        values = {unknown.name: float(unknown.value(place)) for unknown, place in fitted}
        if any(any(effect.imitations(values, covariance)) for effect in bounded):
            return True
    return False


def incredible(data: Ground, hypothesis: Hypothesis, one: Refit) -> bool:
    """Tell whether an effect ran to the end of what it can be, or to where nature has none."""
    return at_bounds(hypothesis, one) or imitates(data, hypothesis, one)
