"""Fits of models in which a channel is late: behind what a fit before predicts."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any, Literal

import numpy as np

from terrain_cli.estimation.wheel_fit.fit_data import Noise
from terrain_cli.estimation.wheel_fit.fit_result import Fit
from terrain_cli.mechanics.effect import Law, Parameter
from terrain_cli.mechanics.past import SUFFIX, Past
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.arrays import Array

#: Times at most that a model is fitted behind what it predicts, and the share of its standard error by which
#: a parameter moves that is settled: the next time it moves by less than a tenth of that. A pull late by
#: 0.4 s came out as 0.51, 0.39, 0.40; torque late by 0.3 s as 0.3016, 0.3007, 0.3008, with an error of 0.001.
PASSES, _CLOSE = 6, 0.3
_FARTHEST = 4.0  # Times the last move that a past is moved on at the most. Judged.
#: Lags that are tried at the most, every 10 ms up to 2 s, which takes less time than a fit; and standard
#: errors by which the best of them has to be better than none: of so many, one is by 3 by chance.
_TRIED, _SURE = 400, 4.0
_CLOCKS: dict[str, Literal["time", "way"]] = {"s": "time", "m": "way"}  # By the unit of a lag


def behind(
    fitted: Callable[[Mapping[str, Any], Fit | None], Fit],
    past_of: Callable[[Fit], Mapping[str, Any]],
    measured: Mapping[str, Any],
    held: Mapping[str, Any],
    whole: Callable[[Mapping[str, Any], Fit | None], Fit] | None = None,
) -> Fit:
    """Fit a model; where it has late channels, again behind what it predicts, until that is settled.

    `fitted` fits it with the past of some channels, from where a fit ended that had nearly the same, and
    `past_of` returns what a fit predicts along whole stretches, without what it has late. `measured` are the
    channels, and `held` the parameters that are not sought. Where errors take long, `fitted` has not all of
    them, and `whole` fits once more with them.
    """
    found = fitted({}, None)
    if not found.model.remembers or not (past := past_of(found)):
        return whole({}, found) if whole else found
    lags = nearest_lags(found.model, past, measured, held)
    # What it left was no noise. A channel that its base does not predict has a lag all the same.
    none = nothing_late(found.model, {})
    near = replace(found, shared={**none, **found.shared, **lags}, noise=Noise())
    before: Mapping[str, tuple[Past, Past]] = {}
    for number in range(PASSES):
        found = fitted(past, near)
        # Behind a fit without the lags none is settled.
        if number and settled(*_moved(found, near)):
            break
        near, to = found, past_of(found)
        each = {name: (past[name], one) for name, one in to.items()}
        past = {name: _onward(*before[name], *pair) if before else pair[1] for name, pair in each.items()}
        before = each
    return whole(past, found) if whole else found


def nearest_lags(
    model: Model, past: Mapping[str, Any], measured: Mapping[str, Any], held: Mapping[str, Any]
) -> dict[str, float]:
    """Return the lags, each alone, with which what was predicted is nearest to what is measured.

    Of what differs in every sample no slope leads from one delay to another: each of so many samples is
    tried.
    """
    found = {}
    for effect in model.effects if past else ():
        own = {effect.qualified(p): p for p in effect.parameters}
        usual = {p.name: held.get(name, p.null) for name, p in own.items()}
        late = [channel for channel in effect.laws if f"{channel}{SUFFIX}" in past and channel in measured]
        sought = {name: p for name, p in own.items() if name not in held and p.unit in _CLOCKS}
        for (name, parameter), channel in product(sought.items(), late if effect.remembers else ()):
            before, law = past[f"{channel}{SUFFIX}"], effect.laws[channel]
            known = {channel: before.predicted, f"{channel}{SUFFIX}": before, **usual}
            shown = partial(_shown, law, known, parameter.name)
            step = before.series.step(_CLOCKS[parameter.unit])
            # Of each channel there is one lag.
            if not np.array_equal(law(known), shown(step)):
                found[name] = _nearest(shown, measured[channel], parameter, step)
    return found


def _shown(law: Law, known: Mapping[str, Any], name: str, lag: float) -> Array:
    return np.asarray(law({**known, name: lag}))


def _nearest(shown: Callable[[float], Array], measured: Array, parameter: Parameter, step: float) -> float:
    """Return the lag at which what is shown is nearest to what is measured; none where that may be chance."""
    step = max(step, (parameter.upper - parameter.lower) / _TRIED)
    tried = step * np.arange(np.ceil(parameter.lower / step), np.floor(parameter.upper / step) + 1.0)

    def off(lag: float) -> Array:
        # Squares would let wild samples choose.
        return np.abs(measured - shown(lag))

    usual = off(parameter.null)
    known = np.isfinite(usual)
    if not known.any():
        return parameter.null
    best = float(min(tried, key=lambda lag: float(off(lag)[known].mean())))
    gain = (usual - off(best))[known]
    return best if gain.mean() > _SURE * gain.std() / np.sqrt(len(gain)) else parameter.null


def settled(moved: Array, errors: Array) -> bool:
    """Tell whether no parameter moved by more than matters beside its standard error."""
    return bool(np.all(np.abs(moved) <= _CLOSE * errors))


def _moved(found: Fit, near: Fit) -> tuple[Array, Array]:
    """Return by how much parameters moved, those of windows by the root mean square of them, and errors."""
    moved = []
    for name, errors in found.errors.items():
        # What is held has no error, and does not move.
        sought = errors > 0.0
        own = ((found.values[name] - near.values[name]) / np.where(sought, errors, 1.0))[sought]
        if len(own := own[np.isfinite(own)]):
            moved.append(np.sqrt(np.mean(own**2)))
    every = [found.shared[name] - near.shared[name] for name in found.shared]
    return np.array([*moved, *every]), np.array([*np.ones(len(moved)), *found.shared_errors.values()])


def _onward(past: Past, to: Past, last: Past, lead: Past) -> Past:
    """Return the past that leads to itself, from two, and what the fits behind them predict.

    Where much of a channel is filtered away, a fit moves by no more than half of what is left to move
    (Anderson 1965, Journal of the ACM 12, 547, with one step remembered).
    """
    first, after, second, ahead = (one.series.values for one in (past, to, last, lead))
    off = ahead - second
    change = off - (after - first)
    power = float(change @ change)
    share = -float(off @ change) / power if power > 0.0 else 0.0
    return lead.of(ahead + np.clip(share, 0.0, _FARTHEST) * (ahead - after))


def nothing_late(model: Model, channels: Mapping[str, Any]) -> dict[str, float]:
    """Return the values at which nothing is late, where no past is known that would tell; else none."""
    if not model.remembers or any(isinstance(column, Past) for column in channels.values()):
        return {}
    late = [effect for effect in model.effects if effect.remembers]
    return {effect.qualified(p): p.null for effect in late for p in effect.parameters}
