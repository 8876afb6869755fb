"""Smoothed channels, what a model predicts from them, and the residuals.

Load, sinkage and slip are interpolated from neighbouring samples and count as exact; sinkage follows from
the load. What is left of torque, pull and sinkage is in units of its noise, and wild values are bounded
(Huber 1964). `smoothed_fit` fits models to them.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison.whitening import Whitening
from terrain_cli.estimation.wheel_fit.unknowns import Unknowns
from terrain_cli.mechanics.dual import slopes, value
from terrain_cli.mechanics.wheel_model import Model, Prediction, WheelGeometry, predict
from terrain_cli.vocabulary.arrays import Array, Index

BEND = 3.0  # Deviations of the noise beyond which a residual weighs less
NO_ANSWER = 10.0  # Residual, in deviations, where the model has no answer
#: Nodes on each arc while parameters are sought and differentiated: forces right to 1e-4.
ORDER = 6
_STIFFNESS = "stiffness"
_CARRIES = 0.2  # Share of the load by which what the soil carries may be off one step from a sinkage


@dataclass(frozen=True, kw_only=True)
class SmoothedData:
    """Samples of one wheel, and what is to be explained of them."""

    geometry: WheelGeometry
    # shape (n,): what a model predicts from, the sinkage only where it cannot be predicted
    inputs: Mapping[str, Array]
    measured: Mapping[str, Array]  # shape (n,)
    use: NDArray[np.bool_]  # shape (n,)
    white: Whitening  # Of the channels that are explained
    window: Index  # shape (n,)
    windows: int
    blocks: int

    @cached_property
    def seen(self) -> NDArray[np.bool_]:
        """Which channels are known of which samples, shape (n, c)."""
        return np.stack([np.isfinite(self.measured[n]) & self.use for n in self.white.channels], axis=1)


def with_noise_of(data: SmoothedData, left: Array, fewest: int) -> SmoothedData:
    """Take what a model leaves, (n, c), for the noise, if `fewest` samples are known in every channel."""
    seen = data.seen.all(axis=1)
    if np.count_nonzero(seen) < fewest:
        return data
    bounded_left = np.clip(left[seen], -BEND, BEND)
    root = np.linalg.cholesky(data.white.covariance)
    # No channel is taken for better than it was.
    size, axes = np.linalg.eigh(bounded_left.T @ bounded_left / len(bounded_left))
    scatter = (axes * np.maximum(size, 1.0)) @ axes.T
    return replace(data, white=replace(data.white, covariance=root @ scatter @ root.T))


def parameters(sought: Unknowns, t: Array, common: Array, window: Index) -> dict[str, Array]:
    """Return every parameter of some samples, (n,), from `t`, (n, q), and `common`, (m,) or (n, m)."""
    found = sought.values(t, common.T, 1, window)
    return {name: np.broadcast_to(number, (len(window),)) for name, number in found.items()}


def forecast(
    model: Model,
    data: SmoothedData,
    numbers: Mapping[str, Array],
    by: Sequence[str] = (),
    *,
    order: int | None = None,
    guess: Array | None = None,
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Predict the channels, NaN where not predictable, and differentiate them, (n, len(by)).

    `numbers` has every parameter of every sample; `order` is the number of nodes on each arc; `guess` has
    sinkages near those that are sought, in m, NaN where there is none; without it they are those measured.
    """
    names, n = data.white.channels, len(data.use)
    guess = data.measured.get("sinkage") if guess is None else guess
    given = "sinkage" if "sinkage" in data.inputs else "load"
    # The base linear takes both; so does what is to be compared with it.
    both = given == "sinkage" and "load" in data.inputs
    needed = {"slip", given, *(("load",) if both else ()), *model.needs} & data.inputs.keys()
    fine = _known(data, needed)
    if "sinkage" in needed:
        fine &= data.inputs["sinkage"] > 0.0
    found = {name: np.full(n, np.nan) for name in names}
    tables = {name: np.zeros((n, len(by))) for name in names}
    some = _rows(fine)
    # On its way a search meets soils that do not carry the load: no prediction, and no warning.
    inputs = {name: column[some] for name, column in data.inputs.items()}
    own = {name: column[some] for name, column in numbers.items()}
    with np.errstate(all="ignore"):
        if both and model.base == "wong-reece":
            part, along = _carrying(model, data, inputs, own, by, order)
        else:
            along = {}
            part = predict(
                model,
                data.geometry,
                inputs,
                own,
                given="sinkage" if given == "sinkage" else "load",
                by=by,
                order=order,
                start=None if guess is None else guess[some],
                forces=names != ("sinkage",),
            )
    for name in names:
        number = getattr(part, name)
        if number is None:
            continue
        found[name][some] = value(number)
        by_stiffness = slopes(number).get(_STIFFNESS, 0.0)
        for column, parameter in enumerate(by):
            slope = slopes(number).get(parameter)
            if slope is not None:
                tables[name][some, column] = slope + by_stiffness * along.get(parameter, 0.0)
    return found, {name: np.where(np.isfinite(table), table, 0.0) for name, table in tables.items()}


def _known(data: SmoothedData, names: Iterable[str]) -> NDArray[np.bool_]:
    """Tell of which samples some of the inputs are known."""
    return np.asarray(np.all([np.isfinite(data.inputs[name]) for name in names], axis=0))


def _rows(fine: NDArray[np.bool_]) -> Index | slice:
    """Return which samples are fine: those without a gap are looked at, and not copied."""
    rows = np.flatnonzero(fine)
    whole = slice(rows[0], rows[-1] + 1) if len(rows) else slice(0, 0)
    return whole if whole.stop - whole.start == len(rows) else rows


def _carrying(
    model: Model,
    data: SmoothedData,
    inputs: Mapping[str, Array],
    numbers: Mapping[str, Array],
    by: Sequence[str],
    order: int | None,
) -> tuple[Prediction, dict[str, Array]]:
    """Predict from load and sinkage both: with the stiffness at which the soil carries that load there.

    From either alone, torque and pull would have the noise of it, and what the base linear predicts
    from both would look the better for that. The load carried is linear in the stiffness. Also returns the
    derivative of the stiffness by each parameter, for the total ones.
    """
    known = {**numbers, _STIFFNESS: np.maximum(numbers[_STIFFNESS], 1.0)}
    first = predict(model, data.geometry, inputs, known, by=(_STIFFNESS,), order=order).balance
    carrying = known[_STIFFNESS] - value(first) / slopes(first)[_STIFFNESS]
    known = {**known, _STIFFNESS: np.where(carrying > 0.0, carrying, np.nan)}
    every = tuple(dict.fromkeys((*by, _STIFFNESS)))
    part = predict(model, data.geometry, inputs, known, by=every, order=order)
    steep = slopes(part.balance)[_STIFFNESS]
    along = {name: -slopes(part.balance).get(name, 0.0) / steep for name in by}
    return part, along


def nearby(
    model: Model, data: SmoothedData, numbers: Mapping[str, Array], by: Sequence[str], guess: Array
) -> tuple[dict[str, Array], dict[str, Array], Array]:
    """Predict from sinkages close to those at which the soil carries the load, without seeking a root.

    With the load carried less the load there is b(z) at a guess z, the sinkage is z − b/b', and what
    follows from it moves along; derivatives are total ones. The base is wong-reece. `guess` is as the sensor
    would show it, NaN where there is no prediction; the better sinkages are returned last.
    """
    names, n = data.white.channels, len(data.use)
    found = {name: np.full(n, np.nan) for name in names}
    tables = {name: np.zeros((n, len(by))) for name in names}
    moved = np.full(n, np.nan)
    fine = _known(data, {"slip", "load", *model.needs} & data.inputs.keys())
    some = _rows(fine & np.isfinite(guess) & (guess > 0.0))
    begun = guess[some]
    with np.errstate(all="ignore"):
        part = predict(
            model,
            data.geometry,
            {**{name: column[some] for name, column in data.inputs.items()}, "sinkage": begun},
            {name: column[some] for name, column in numbers.items()},
            by=(*by, "sinkage"),
            order=ORDER,
        )
    steep = np.broadcast_to(slopes(part.balance).get("sinkage", 0.0), begun.shape)
    steep = np.where(np.abs(steep) > 0.0, steep, np.inf)
    step = np.clip(-value(part.balance) / steep, -0.5 * begun, begun)
    # So far from the load there may be no sinkage that carries it.
    near = np.abs(value(part.balance)) <= _CARRIES * np.abs(data.inputs["load"][some])
    # Nor one that bears less the deeper the wheel is.
    near &= steep > 0.0
    moved[some] = np.where(near, begun + step, np.nan)
    along = [-slopes(part.balance).get(p, 0.0) / steep for p in by]
    for name in names:
        if name == "sinkage":
            found[name][some] = begun + step
            for column, slope in enumerate(along):
                tables[name][some, column] = slope
            continue
        number = getattr(part, name)
        by_sinkage = slopes(number).get("sinkage", 0.0)
        found[name][some] = value(number) + by_sinkage * step
        for column, parameter in enumerate(by):
            tables[name][some, column] = slopes(number).get(parameter, 0.0) + by_sinkage * along[column]
    return found, {name: np.where(np.isfinite(table), table, 0.0) for name, table in tables.items()}, moved


def with_own_load(data: SmoothedData, load: Array | None, share: float) -> SmoothedData:
    """Add to the interpolated load a share of what the measured `load` of each sample is off it."""
    if load is None or share == 0.0:
        return data
    smooth = data.inputs["load"]
    return replace(data, inputs={**data.inputs, "load": smooth + share * np.nan_to_num(load - smooth)})


def felt(model: Model, data: SmoothedData, numbers: Mapping[str, Array], load: Array) -> float:
    """Return which share of what the measured `load` of samples is off their neighbours' a channel shows.

    Rough ground changes the load from sample to sample; so does noise, to which no wheel answers, and which
    lowers the slope of what is measured over what is predicted by as much (regression calibration, Carroll
    et al. 2006, Measurement Error in Nonlinear Models, chapter 4). A sensor that is late shows less of it:
    told is the channel that shows most, less two standard errors. Where that is not more than half,
    neighbours tell the load better, and the answer is 0.
    """
    smooth, rough = (forecast(model, with_own_load(data, load, share), numbers)[0] for share in (0.0, 1.0))
    # A torque that the model missed showed 0.8 ± 0.5 on smooth ground, where the others showed 0.3.
    sure, most = 0.0, 0.0
    for name in data.white.channels:
        change, off = rough[name] - smooth[name], data.measured[name] - smooth[name]
        known = data.use & np.isfinite(change) & np.isfinite(off)
        change, off = change[known], off[known]
        size = float(change @ change)
        share = float(change @ off) / size if size > 0.0 else 0.0
        # What a model misses is an error as well.
        error = math.sqrt(float(np.mean((off - share * change) ** 2)) / size) if size > 0.0 else 0.0
        least = share - 2.0 * error
        sure, most = max((sure, most), (least, share))
    return min(most, 1.0) if sure > 0.5 else 0.0


def residual(data: SmoothedData, predicted: Mapping[str, Array]) -> Array:
    """Return what is left of the channels, (n, c), in units of the noise; 0 where nothing is measured.

    `NO_ANSWER` in every channel that is measured, where one of them has no prediction.
    """
    seen = data.seen
    errors = {name: data.measured[name] - predicted[name] for name in data.white.channels}
    lost = seen & np.stack([~np.isfinite(errors[name]) for name in data.white.channels], axis=1)
    result = data.white({name: np.nan_to_num(error) for name, error in errors.items()}, seen)
    result[lost.any(axis=1)] = NO_ANSWER * seen[lost.any(axis=1)]
    return result


def bounded(errors: Array) -> Array:
    """Return squares that grow only in proportion beyond `BEND`."""
    size = np.abs(errors)
    return np.where(size < BEND, size**2, BEND * (2.0 * size - BEND))


def thinned(data: SmoothedData, rows: Index) -> SmoothedData:
    return replace(
        data,
        inputs={name: column[rows] for name, column in data.inputs.items()},
        measured={name: column[rows] for name, column in data.measured.items()},
        use=data.use[rows],
        window=data.window[rows],
    )
