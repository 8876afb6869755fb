"""How large the parameters of an effect are, over all wheels, and on each where they differ."""

from collections.abc import Mapping, Sequence

import numpy as np

from terrain_cli.comparison import distributions, smoothed_fit
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis, Size
from terrain_cli.diagnosis.refit_ranking import absent
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.estimation import prediction
from terrain_cli.models.model_file import SOIL_UNITS
from terrain_cli.telemetry import unit_doubts
from terrain_cli.vocabulary.arrays import Array, Index

Known = tuple[float, float]


def of_refit(one: Hypothesis, data: Ground, refit: Refit) -> dict[str, Size]:
    """Average what came with a hypothesis over the wheels, by errors; NaN where the data leave it open."""
    names = list(one.parameters or one.priors)
    places = [(wheel.windows.samples.source, wheel.windows.samples.wheel) for wheel in data.wheels]
    several = len({wheel for _, wheel in places}) < len(places)
    pairs: dict[str, dict[str, list[Known]]] = {}
    bounded: set[str] = set()
    for place, part, solution in zip(places, data.data, refit.solutions, strict=True):
        covariance, _ = smoothed_fit.covariance(part, solution)
        sought = solution.unknowns
        for column, unknown in enumerate((*sought.local, *sought.shared)):
            if unknown.name not in names:
                continue
            own = column < len(sought.local)
            t = solution.t[:, column] if own else solution.common[[column - len(sought.local)]]
            error = np.sqrt(covariance[:, column, column]) if own else np.sqrt(covariance[:1, column, column])
            told = (error < criteria.LEFT_OPEN * unknown.sd) | unknown.logarithm
            known = zip(unknown.value(t)[told].tolist(), error[told].tolist(), strict=True)
            of_wheel = pairs.setdefault(unknown.name, {}).setdefault(" ".join(place[not several :]), [])
            of_wheel.extend(known)
            if unknown.own and any(map(unknown.own.at_bound, unknown.value(t).tolist())):
                bounded.add(unknown.name)
    sizes = {}
    for name in (name for name in names if name in pairs):
        own_parameter, found = one.model.parameters.get(name), pairs[name]
        every = [pair for of_wheel in found.values() for pair in of_wheel]
        factor = own_parameter.factor if own_parameter else 1.0
        value, se = (number / factor for number in (pooled(every) if every else (np.nan, np.nan)))
        wheels = tuple((wheel, own / factor, error / factor) for wheel, own, error in differing(found))
        unit = own_parameter.unit if own_parameter else SOIL_UNITS.get(name, "")
        sizes[own_parameter.name if own_parameter else name] = Size(value, se, unit, wheels, name in bounded)
    return sizes


def differing(found: Mapping[str, Sequence[Known]]) -> list[tuple[str, float, float]]:
    """Return the mean of each wheel, where wheels differ by more than their errors; else nothing."""
    means = [(wheel, *pooled(pairs)) for wheel, pairs in found.items() if pairs]
    if len(means) < 2:
        return []
    values, errors = np.transpose([pair for _, *pair in means])
    weight = errors**-2.0
    off = values - float(np.average(values, weights=weight))
    chance = distributions.chi_squared_tail(float(weight @ off**2), len(means) - 1)
    return means if chance < criteria.LEVEL else []


def pooled(found: Sequence[Known]) -> Known:
    """Average values with their standard errors.

    The error of the mean is larger by as much as the values differ by more than their errors (Birge, Physical
    Review 40, 1932): what one wheel has and the others have not is known of none of them.
    """
    values, errors = np.transpose(found)
    weight = np.where(np.isfinite(errors) & (errors > 0.0), errors, 1.0) ** -2.0
    mean = float(np.average(values, weights=weight))
    scatter = float(weight @ (values - mean) ** 2) / max(len(values) - 1, 1)
    return mean, float(weight.sum() ** -0.5) * max(scatter, 1.0) ** 0.5


def settles_pull(wheels: Sequence[FittedWheel], one: Hypothesis) -> bool:
    """Tell whether torque and pull change alike without an effect, where as measured they do not.

    Only what changes these themselves, and follows something recorded, settles that: a constant factor may
    just as well be that of a unit, and to a wrong unit a law of the soil can be fitted.
    """
    forces, settled = {"torque", "drawbar_pull"}, list[bool]()
    follow = all(effect.needs and effect.laws.keys() <= forces for effect in one.effects)
    for wheel in wheels if follow and one.effects else ():
        if not forces <= wheel.measured.keys():
            continue
        without, measured = _without(wheel, one), wheel.measured
        left = {name: measured[name] - wheel.predicted[name] + without[name] for name in measured}
        settled.append(_odd(wheel, measured) and not _odd(wheel, left))
    return bool(settled) and all(settled)


def _without(wheel: FittedWheel, one: Hypothesis) -> dict[str, Array]:
    """Predict a wheel with an effect absent, and everything else as it was fitted with it."""

    def parameters(rows: Index) -> dict[str, Array]:
        return absent(one, wheel.of_samples(rows))

    return prediction.values(wheel.model, wheel.geometry, wheel.read, parameters)


def _odd(wheel: FittedWheel, measured: Mapping[str, Array]) -> bool:
    """Tell whether pull and torque of a wheel change as if one of them were in another unit."""
    columns = [measured["drawbar_pull"], measured["torque"] / wheel.geometry.radius]
    columns += [wheel.channels[name] for name in ("load", "pitch") if name in wheel.channels]
    force, rim, *others = np.array(columns)[:, np.isfinite(columns).all(axis=0)]
    return unit_doubts.odd_changes(force, rim, others) is not None
