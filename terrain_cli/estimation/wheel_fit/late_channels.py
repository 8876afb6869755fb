"""Fits of models in which a channel is late: behind what a fit before predicts."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from terrain_cli.estimation.wheel_fit.fit_result import Fit
from terrain_cli.mechanics.past import Past
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.arrays import Array

#: Times at most that a model is fitted behind what it predicts, and the share of its standard error by which
#: a parameter moves that is settled. A pull late by 0.4 s came out as 0.51, 0.39, 0.40.
PASSES, _CLOSE = 6, 0.1


def behind(
    fitted: Callable[[Mapping[str, Any], Fit | None], Fit], past_of: Callable[[Fit], Mapping[str, Any]]
) -> Fit:
    """Fit a model; where it has late channels, again behind what it predicts, until that is settled.

    `fitted` fits it with the past of some channels, from where a fit ended that had nearly the same, and
    `past_of` returns what a fit predicts along whole stretches, without what it has late.
    """
    found, near = fitted({}, None), None
    for _ in range(PASSES if found.model.remembers else 0):
        past = past_of(found)
        if not past:
            break
        found = fitted(past, near)
        if near is not None:
            names = found.shared.keys() & near.shared.keys()
            values, before, errors = (
                np.array([one[name] for name in names])
                for one in (found.shared, near.shared, found.shared_errors)
            )
            if settled(values - before, errors):
                break
        near = found
    return found


def settled(moved: Array, errors: Array) -> bool:
    """Tell whether no parameter moved by more than does not matter beside its standard error."""
    return bool(np.all(np.abs(moved) <= _CLOSE * errors))


def nothing_late(model: Model, channels: Mapping[str, Any]) -> dict[str, float]:
    """Return the values at which nothing is late, where no past is known that would tell; else none."""
    if not model.remembers or any(isinstance(column, Past) for column in channels.values()):
        return {}
    late = [effect for effect in model.effects if effect.remembers]
    return {effect.qualified(p): p.null for effect in late for p in effect.parameters}
