"""Torque, drawbar pull and sinkage of the measured samples, and their derivatives by what was fitted."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from terrain_cli.estimation.wheel_fit import Fit
from terrain_cli.mechanics import past
from terrain_cli.mechanics.dual import slopes, value
from terrain_cli.mechanics.wheel_model import Given, Model, Prediction, WheelGeometry, predict
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.windows.cut_windows import Windows

#: Power of the share of a change that is true, by which it counts in derivatives by a lag. Where half of it
#: was true, whole changes in these put lags that were 0 at −0.02 ± 0.002 s; where all of it was, without them
#: a lag was off by 0.009 s, and with them by 0.0008 s.
_SURE = 4.0
#: From samples, by their indices, to every parameter of the soil and of the effects of each.
Parameters = Callable[[NDArray[np.intp]], Mapping[str, Array]]


def compared(model: Model, channels: Mapping[str, Array]) -> tuple[str, ...]:
    """List the channels that are measured and that a model predicts from the others."""
    there = [name for name in ("torque", "drawbar_pull") if _known(channels, name)]
    if model.base == "wong-reece" and _known(channels, "sinkage") and _known(channels, "load"):
        there.append("sinkage")
    return tuple(there)


def _known(channels: Mapping[str, Array], name: str) -> bool:
    return name in channels and bool(np.isfinite(channels[name]).any())


def values(
    model: Model,
    wheel: WheelGeometry,
    channels: Mapping[str, Array],
    parameters: Parameters,
    wanted: Sequence[str] = (),
    near: Array | None = None,
) -> dict[str, Array]:
    """Predict the channels wanted, all that are `compared` by default; NaN where not predictable.

    Torque and drawbar pull follow from the sinkage as measured, or, where that is not, from the one at which
    the soil carries the load; the sinkage always from the load. `channels` are as measured, in SI units, and
    NaN where not known. Sinkages are sought from those `near` on, or else from those measured.
    """
    wanted = tuple(wanted) or compared(model, channels)
    given_sinkage = _known(channels, "sinkage")
    n = len(next(iter(channels.values())))
    from_sinkage = ("sinkage", "slip", *(("load",) if model.base == "linear" else ()))
    result = {name: np.full(n, np.nan) for name in wanted}
    for load_given, needed in ((False, from_sinkage), (True, ("load", "slip"))):
        names = [name for name in wanted if load_given == (name == "sinkage" or not given_sinkage)]
        if names:
            rows = _rows(model, channels, needed)
            start = channels.get("sinkage") if near is None else near
            found = _predict(
                model,
                wheel,
                channels,
                parameters,
                rows,
                given="load" if load_given else "sinkage",
                start=None if start is None else start[rows],
                forces=names != ["sinkage"],
            )
            for name in names:
                result[name][rows] = value(getattr(found, name))
    return result


def past_of_fit(
    whole: Windows,
    thinned: Windows,
    channels: Mapping[str, Array],
    fit: Fit,
    fixed: Mapping[str, ArrayLike],
) -> dict[str, Any]:
    """Return what a fit to the samples of `thinned` predicts of all, as those see it, without what is late.

    For a model with a late channel, to be fitted behind it. `channels` are of all usable samples; of steady
    test points there is nothing. As `past_of`.
    """
    samples, rows = whole.samples, whole.rows
    if samples.time is None:
        return {}
    own = {name: np.repeat(one, np.diff(whole.bounds)) for name, one in fit.of_windows(fixed).items()}
    measured = {name: samples.channels[name][rows] for name in compared(fit.model, channels)}
    velocity = samples.channels.get("velocity")
    velocity = None if velocity is None else velocity[rows]
    clock = samples.time[rows], samples.stretch[rows], velocity
    before = past_of(fit.model, samples.geometry.wheel, channels, own, clock, measured)
    return {name: column[np.searchsorted(rows, thinned.rows)] for name, column in before.items()}


def past_of(
    model: Model,
    wheel: WheelGeometry,
    channels: Mapping[str, Array],
    parameters: Mapping[str, Array],
    clock: tuple[Array, Index, Array | None],
    measured: Mapping[str, Array],
) -> dict[str, Any]:
    """Return what a model predicts along whole stretches, without what is late.

    Sinkage may itself be late: where the load tells it, all follows from that. Noise of the inputs is in a
    prediction too, and less of it where this is shifted or filtered, so that any lag would seem to help.
    What an input changes by from sample to sample is therefore taken for true by the share of it that is
    `measured` in the outputs too, each as late as the model has it: what is left to be off is independent of
    what is taken (regression calibration; Carroll et al. 2006, Measurement Error in Nonlinear Models, chapter
    4). Noise that is left in that is in the residual too: derivatives by a lag are of the smooth inputs, and
    of changes that are surely true.
    """
    told = model.base == "wong-reece" and _known(channels, "load")
    read = {name: column for name, column in channels.items() if not (told and name == "sinkage")}
    inputs = [name for name in ("load", "sinkage", "slip") if _known(read, name)]
    nowhere = np.full(len(clock[0]), np.nan)  # As in a fit, which begins at no measured one

    def predicted(some: Mapping[str, Array], near: Array) -> dict[str, Array]:
        def of(rows: Index) -> dict[str, Array]:
            return {name: column[rows] for name, column in parameters.items()}

        return values(model, wheel, {**read, **some}, of, tuple(measured), near)

    smooth = {name: past.smooth(*clock[:2], read[name]) for name in inputs}
    steady = predicted(smooth, nowhere)
    near = steady.get("sinkage", nowhere)
    each = [predicted({**smooth, name: read[name]}, near) for name in inputs]
    changes = [{name: column - steady[name] for name, column in one.items()} for one in each]
    base, *shown = (_late(model, parameters, past.along(*clock, one)) for one in (steady, *changes))
    gram, product = np.zeros((len(inputs), len(inputs))), np.zeros(len(inputs))
    for name, column in measured.items():
        table = np.reshape([one[name] for one in shown], (len(inputs), len(column)))
        left = column - base[name]
        known = np.isfinite(left) & np.isfinite(table).all(axis=0)
        if (power := float(left[known] @ left[known])) > 0.0:
            gram += table[:, known] @ table[:, known].T * (known.sum() / power)
            product += table[:, known] @ left[known] * (known.sum() / power)
    shares = np.clip(np.linalg.lstsq(gram, product, rcond=None)[0], 0.0, 1.0)
    whole, sure = (
        {
            name: sum((part * one[name] for part, one in zip(share, changes, strict=True)), column)
            for name, column in steady.items()
        }
        for share in (shares, shares ** (1.0 + _SURE))
    )
    return past.along(*clock, whole, sure)


def _late(model: Model, parameters: Mapping[str, Array], before: Mapping[str, past.Past]) -> dict[str, Array]:
    """Return predicted channels as late as a model has them."""
    found = {}
    for name, one in before.items():
        channel = name.removesuffix(past.SUFFIX)
        shown: Any = one.predicted
        for effect in model.changing.get(channel, ()):
            if effect.remembers:
                own = {p.name: parameters[effect.qualified(p)] for p in effect.parameters}
                shown = effect.laws[channel]({channel: shown, name: one, **own})
        found[channel] = np.asarray(shown)
    return found


def derivatives(
    model: Model,
    wheel: WheelGeometry,
    channels: Mapping[str, Array],
    parameters: Parameters,
    names: Sequence[str],
) -> dict[str, Array]:
    """Differentiate the predictions by parameters: by channel, (n, len(names)); 0 where not predictable.

    The derivative of the sinkage is that of the root: −(∂balance/∂p) / (∂balance/∂z) at the sinkage given, so
    that no root is sought.
    """
    wanted = compared(model, channels)
    given_sinkage = _known(channels, "sinkage")
    n = len(next(iter(channels.values())))
    result = {name: np.zeros((n, len(names))) for name in wanted}
    needed = ("slip", *(("sinkage",) if given_sinkage else ()))
    if "sinkage" in wanted or not given_sinkage or model.base == "linear":
        needed = (*needed, "load")
    rows = _rows(model, channels, needed)
    by = (*names, *(("sinkage",) if "sinkage" in wanted else ()))
    given: Given = "sinkage" if given_sinkage else "load"
    found = _predict(model, wheel, channels, parameters, rows, given=given, by=by)
    for name in wanted:
        number = found.balance if name == "sinkage" and given_sinkage else getattr(found, name)
        table = np.zeros((len(rows), len(names)))
        for column, parameter in enumerate(names):
            table[:, column] = slopes(number).get(parameter, 0.0)
        if name == "sinkage" and given_sinkage:
            steep = np.broadcast_to(slopes(number)["sinkage"], (len(rows),))
            table = -table / np.where(np.abs(steep) > 0.0, steep, np.inf)[:, None]
        result[name][rows] = np.where(np.isfinite(table), table, 0.0)
    return result


def _rows(model: Model, channels: Mapping[str, Array], needed: Sequence[str]) -> NDArray[np.intp]:
    """Return the samples of which everything is known that a prediction needs."""
    known = {*needed, *(name for name in model.needs if name in channels)}
    fine = np.all([np.isfinite(channels[name]) for name in known], axis=0)
    return np.flatnonzero(fine & (channels["sinkage"] > 0.0) if "sinkage" in needed else fine)


# An effect far from what it can be may leave no contact: no prediction, and no warning.
@np.errstate(all="ignore")
def _predict(
    model: Model,
    wheel: WheelGeometry,
    channels: Mapping[str, Array],
    parameters: Parameters,
    rows: NDArray[np.intp],
    **options: Any,
) -> Prediction:
    some = {name: column[rows] for name, column in channels.items()}
    return predict(model, wheel, some, parameters(rows), **options)
