"""Refits: models with something added, fitted to all of the data, and their held-out predictions."""

import copy
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from terrain_cli.comparison import (
    comparison_criteria,
    held_out,
    residual_noise,
    smoothed_fit,
    smoothed_model,
    whitening,
)
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.comparison.smoothed_fit import Solution
from terrain_cli.comparison.smoothed_model import SmoothedData
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.estimation.wheel_fit import normal_equations
from terrain_cli.estimation.wheel_fit.fit_data import level
from terrain_cli.estimation.wheel_fit.gauss_newton import inside, limits
from terrain_cli.estimation.wheel_fit.late_channels import PASSES, nearest_lags, settled
from terrain_cli.estimation.wheel_fit.unknowns import Unknowns, present, unknowns
from terrain_cli.mechanics.past import Past
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.windows.joined_inputs import with_inputs


@dataclass(frozen=True, kw_only=True)
class Ground:
    """The data of a diagnosis, in one way of joining segments to soils, with the base fitted."""

    wheels: list[FittedWheel]
    rows: list[Index]  # Usable samples of each wheel that are taken
    block: list[Index]  # Block of each of these
    data: list[SmoothedData]
    base: list[Solution]
    whole: list[SmoothedData]  # All samples of each wheel, along which a late channel is late
    felt: list[float]  # Share of what the load of a sample is off its neighbours that each wheel answers to

    @cached_property
    def neutral(self) -> list[Solution]:
        """The base of each wheel on the soil expected before anything is known."""
        soils = (
            smoothed_fit.neutral(one.model, one.unknowns, smoothed_fit.rough(part), one.common)
            for one, part in zip(self.base, self.data, strict=True)
        )
        return [replace(one, t=t) for one, t in zip(self.base, soils, strict=True)]

    @property
    def blocks(self) -> int:
        return 1 + max(int(one.max(initial=-1)) for one in self.block)


@dataclass(frozen=True, kw_only=True)
class Refit:
    """A model fitted to the data of a ground."""

    id: str  # Of the hypothesis; empty for the base
    solutions: list[Solution]  # Of each wheel
    # shape (n, c): of each wheel, held out, in units of the noise; 0 where not known or of no use
    residuals: list[Array]
    predicted: list[dict[str, Array]]  # shape (n,): of each wheel, by channel, held out
    loss: Array  # shape (blocks,): sum over the block
    heldout: dict[str, float]  # Channel → root mean square of the held-out error, SI

    def at_bound(self, hypothesis: Hypothesis, *, shape: bool = False) -> bool:
        """Tell whether a parameter of an effect, or of its `shape`, ran to the end of what it can be."""
        fitted = (one for s in self.solutions for one in zip(s.unknowns.shared, s.common, strict=True))
        own = ((u.own, u.value(t)) for u, t in fitted if u.name in hypothesis.parameters)
        return any(p is not None and p.shape == shape and p.at_bound(float(value)) for p, value in own)


def ground(
    wheels: Sequence[FittedWheel], block: Sequence[Index], most: int, like: Ground | None = None
) -> Ground:
    """Fit the base to evenly thinned samples; with noise and load of `like`, so that losses compare."""
    step = max(1, -(-sum(len(wheel) for wheel in wheels) // most))
    rows, kept, datas, solutions, whole, felt = [], [], [], [], [], []
    blocks = 1 + max(int(one.max(initial=-1)) for one in block)
    for index, wheel in enumerate(wheels):
        white = like.data[index].white if like is not None else None
        data = replace(wheel.least_squares_data(white), blocks=blocks)
        some = np.arange(0, len(wheel), step)
        felt.append(like.felt[index] if like is not None else _felt(wheel, data, some))
        data = smoothed_model.with_own_load(data, wheel.channels.get("load"), felt[-1])
        thin = smoothed_model.thinned(data, some)
        t, common = wheel.beginning()
        solution = smoothed_fit.search(wheel.model, wheel.sought, thin, ((t, common), (None, common)))
        if white is None:
            data = replace(data, white=_noise(wheel, data, solution))
            thin = smoothed_model.thinned(data, some)
            solution = smoothed_fit.solve(wheel.model, wheel.sought, thin, solution.t, solution.common)
        thin = smoothed_model.thinned(_remembering(wheel, data, solution), some)
        whole.append(data)
        rows.append(some)
        kept.append(block[index][some])
        datas.append(thin)
        solutions.append(solution)
    return Ground(
        wheels=list(wheels), rows=rows, block=kept, data=datas, base=solutions, whole=whole, felt=felt
    )


def _remembering(wheel: FittedWheel, data: SmoothedData, solution: Solution) -> SmoothedData:
    """Add what a solution predicts along whole stretches, without what it has late."""
    inputs = {name: column for name, column in data.inputs.items() if not isinstance(column, Past)}
    # Of a drafted law the driver may be known at the samples taken alone.
    kept = tuple(e for e in solution.model.effects if e in wheel.model.effects or {*inputs} >= {*e.reads})
    late = wheel.past_of(inputs, (Model(solution.model.base, kept), solution.of_samples(data.window)))
    return replace(data, inputs={**inputs, **late})


def _settled(
    data: Ground, index: int, part: SmoothedData, solution: Solution
) -> tuple[SmoothedData, Solution]:
    """Fit a model anew behind what it predicts itself, until that is what it was behind."""
    wheel, rows = data.wheels[index], data.rows[index]
    widths = np.array([unknown.sd for unknown in solution.unknowns.shared])
    for _ in range(PASSES):
        before = solution.common
        every = _remembering(wheel, data.whole[index], solution).inputs
        late = {name: column[rows] for name, column in every.items() if isinstance(column, Past)}
        part = replace(part, inputs={**part.inputs, **late})
        solution = smoothed_fit.solve(solution.model, solution.unknowns, part, solution.t, before, rounds=1)
        errors = np.sqrt(np.diagonal(smoothed_fit.covariance(part, solution)[1]))
        if settled(widths * (solution.common - before), errors):
            break
    return part, solution


def _felt(wheel: FittedWheel, data: SmoothedData, rows: Index) -> float:
    """Return how much the wheel answers to what some samples' load is off their neighbours."""
    if not wheel.ordered or "load" not in data.inputs:
        return 0.0
    thin, load = smoothed_model.thinned(data, rows), wheel.channels["load"][rows]
    return smoothed_model.felt(wheel.model, thin, wheel.of_samples(rows), load)


def _noise(wheel: FittedWheel, data: SmoothedData, solution: Solution) -> whitening.Whitening:
    """Estimate the noise of what the base leaves, from all samples."""
    found, _ = smoothed_model.forecast(wheel.model, data, solution.of_samples(data.window))
    errors = {
        name: np.where(data.use, column - found[name], np.nan) for name, column in data.measured.items()
    }
    if wheel.ordered:
        noise = residual_noise.of_all(errors, wheel.group, wheel.second)
        levels = {name: level.deviation for name, level in noise.items()}
        # A misfit that lasts can hide the noise, which is not less than that of the channels themselves.
        least = whitening.of_channels(wheel.measured, wheel.group)
        for name, variance in zip(least.channels, np.diag(least.covariance), strict=True):
            levels[name] = float(np.fmax(levels[name], np.sqrt(variance)))
    else:
        levels = wheel.levels
    return whitening.of_residuals(errors, levels, wheel.record.group, wheel.memory)


def with_noise_of(data: Ground, best: Refit) -> Ground:
    """Take what the model that predicts best leaves for the noise, and fit the base anew."""
    parts, solutions = [], []
    for part, found, base, wheel in zip(data.data, best.solutions, data.base, data.wheels, strict=True):
        parts.append(smoothed_model.with_noise_of(part, found.residual, comparison_criteria.NOISE_SAMPLES))
        solutions.append(smoothed_fit.solve(wheel.model, base.unknowns, parts[-1], base.t, base.common))
    return replace(data, data=parts, base=solutions)


def misses(data: Ground, one: Refit) -> bool:
    """Tell whether a model leaves more than noise."""
    noise = sum(int(part.seen.sum()) for part in data.data)
    return float(one.loss.sum()) > comparison_criteria.ABOVE_NOISE**2 * noise


def weighed(data: Ground, one: Refit) -> Refit:
    """Weigh the held-out errors of a refit by the noise of `data`, without fitting again."""
    loss, residuals = np.zeros(data.blocks), []
    for index, part in enumerate(data.data):
        errors = smoothed_model.residual(part, one.predicted[index])
        loss += np.bincount(data.block[index], smoothed_model.bounded(errors).sum(axis=1), data.blocks)
        residuals.append(errors)
    return replace(one, loss=loss, residuals=residuals)


def refit(
    data: Ground,
    hypothesis: Hypothesis | None,
    extra: Sequence[dict[str, Array]] | None = None,
    begun: Sequence[Solution] | None = None,
    after: Sequence[Refit] = (),
) -> Refit:
    """Fit a model, or take the base where there is none, and predict every block from the others.

    `extra` has further channels of each wheel at the rows taken. The search begins at `begun`, of the same
    hypothesis, or at each of the refits `after`, of parts of it, and at all together.
    """
    solutions, residuals, predicted = [], [], []
    loss = np.zeros(data.blocks)
    squares: dict[str, tuple[float, int]] = {}
    for index, base in enumerate(data.base):
        part = data.data[index]
        if extra:
            part = replace(part, inputs={**part.inputs, **extra[index]})
        if hypothesis is None:
            solution = base
        elif begun:
            one = begun[index]
            solution = smoothed_fit.solve(hypothesis.model, one.unknowns, part, one.t, one.common)
        else:
            solution = _solved(data, index, part, hypothesis, [one.solutions[index] for one in after])
        if solution.model.remembers and hypothesis is not None:
            part, solution = _settled(data, index, part, solution)
        errors, out = _held_out(part, solution, data.block[index])
        loss += np.bincount(data.block[index], smoothed_model.bounded(errors).sum(axis=1), data.blocks)
        solutions.append(solution)
        residuals.append(errors)
        predicted.append(out)
        for name in part.white.channels:
            error = (part.measured[name] - out[name])[part.use]
            error = error[np.isfinite(error)]
            total, count = squares.get(name, (0.0, 0))
            squares[name] = total + float(error @ error), count + len(error)
    rms = {name: float(np.sqrt(total / count)) for name, (total, count) in squares.items() if count}
    return Refit(
        id=hypothesis.id if hypothesis else "",
        solutions=solutions,
        residuals=residuals,
        predicted=predicted,
        loss=loss,
        heldout=rms,
    )


def over_shapes(data: Ground, hypothesis: Hypothesis, one: Refit) -> Refit:
    """Fit a model anew where what only shapes an effect ran to the end of what it can be, and stuck there.

    With the shape held the search is plain: it is let go from the best of several, if that is better.
    """
    shapes = {name: p for name, p in hypothesis.parameters.items() if p.shape}
    if not one.at_bound(hypothesis, shape=True):
        return one
    tried = [one]
    channels = [wheel.channels for wheel in data.wheels]
    for values in product(*(p.tried(channels) for p in shapes.values())):
        value = dict(zip(shapes, values, strict=True))
        held = refit(data, replace(hypothesis, fixed={**hypothesis.fixed, **value}))
        begun = [_let_go(*pair, value) for pair in zip(held.solutions, one.solutions, strict=True)]
        tried.append(refit(data, hypothesis, begun=begun))
    return min(tried, key=lambda found: sum(solution.merit for solution in found.solutions))


def _let_go(held: Solution, free: Solution, value: Mapping[str, float]) -> Solution:
    """Return a solution with some parameters held in the terms of one that has them free."""
    t, common = _from([held], free.unknowns, len(held.t))
    for column, unknown in enumerate(free.unknowns.shared):
        if unknown.name in value:
            common[column] = (value[unknown.name] - unknown.mean) / unknown.sd
    return replace(free, t=t, common=common)


def _solved(
    data: Ground, index: int, part: SmoothedData, hypothesis: Hypothesis, after: Sequence[Solution]
) -> Solution:
    """Search from the base, or from its parts, and where each shape of it is present; keep the best."""
    wheel, base = data.wheels[index], data.base[index]
    settings = wheel.settings
    fixed = {n: value for n, value in settings.fixed.items() if n not in hypothesis.priors}
    sought = unknowns(
        hypothesis.model,
        fixed={**fixed, **hypothesis.fixed},
        priors={**settings.priors, **hypothesis.priors},
        shared=settings.shared,
        under=wheel.under,
    )
    if after:
        places = [*([one] for one in after), list(after), list(after)[::-1]]
        begun = [_from(several, sought, part.windows) for several in places]
        return smoothed_fit.search(hypothesis.model, sought, part, begun)
    t, common = _from([base], sought, part.windows)
    lags = nearest_lags(hypothesis.model, part.inputs, part.measured, sought.fixed)
    both = zip(sought.shared, common, strict=True)
    common = np.array([u.sought(lags[u.name]) if u.name in lags else number for u, number in both])
    names = hypothesis.parameters if any(p.shape for p in hypothesis.parameters.values()) else ()
    there = present(sought, common, wheel.channels, smoothed_fit.PRESENT, names)
    shared = [*there] or [common]
    # Where nothing is new but an effect, which is absent there, the neutral soil is that of the base.
    same = not hypothesis.priors and all(one is common for one in shared)
    neutral = _from([data.neutral[index]], sought, part.windows)[0] if same else None
    return smoothed_fit.search(hypothesis.model, sought, part, product((t, neutral), shared))


def _from(several: Sequence[Solution], sought: Unknowns, windows: int) -> tuple[Array, Array]:
    """Return solutions in the terms of another model: the first, and what others have besides."""
    local = {u.name: several[0].t[:, j] for j, u in enumerate(several[0].unknowns.local)}
    shared = {
        u.name: float(one.common[j]) for one in several[::-1] for j, u in enumerate(one.unknowns.shared)
    }
    t = [local.get(u.name, np.zeros(windows)) for u in sought.local]
    common = [
        shared.get(u.name, float(np.mean(local[u.name])) if u.name in local else 0.0) for u in sought.shared
    ]
    return np.stack(t, axis=1) if t else np.zeros((windows, 0)), np.array(common)


def _held_out(part: SmoothedData, solution: Solution, block: Index) -> tuple[Array, dict[str, Array]]:
    """Predict every sample by the parameters without its block, one step of Gauss and Newton away."""
    fold = held_out.folds(part.window, block)
    window_of, fold_of, cell = held_out.cells(part.window, fold)
    information, score = smoothed_fit.moments(solution.design, solution.residual, cell, len(fold_of))
    q, m = solution.t.shape[1], len(solution.common)
    prior = solution.spread * np.eye(q + m)
    sought = solution.unknowns
    low, high, _ = limits(sought.shared)
    farthest = held_out.FARTHEST
    reach = (np.maximum(low - solution.common, -farthest), np.minimum(high - solution.common, farthest))
    moved = np.clip(
        normal_equations.leave_out(information, score, window_of, fold_of, prior, q, reach),
        -farthest,
        farthest,
    )
    t = solution.t[part.window] + moved[cell][:, :q]
    common = solution.common[None] + moved[cell][:, q:]
    common = np.clip(common, low, high)
    t = inside(sought.local, t)
    found, _ = smoothed_model.forecast(
        solution.model,
        part,
        smoothed_model.parameters(sought, t, common, part.window),
        order=smoothed_model.ORDER,
        guess=solution.sinkage,
    )
    errors = smoothed_model.residual(part, found)
    change = np.einsum("ncp,np->nc", solution.design, moved[cell])
    names = part.white.channels
    straight = held_out.nearer(
        {name: change[:, column] for column, name in enumerate(names)},
        {name: (solution.residual - errors)[:, column] for column, name in enumerate(names)},
        fold,
    )
    straight &= np.isfinite(np.stack([found[name] for name in names], axis=1)).all(axis=1)
    errors[straight] = (solution.residual - change)[straight]
    for name, left in part.white.undone(errors, part.seen).items():
        known = straight & np.isfinite(part.measured[name])
        found[name][known] = (part.measured[name] - left)[known]
    return errors, found


def on_wheels(data: Ground, one: Hypothesis, refit: Refit) -> list[FittedWheel]:
    """Return the wheels with what a refit of a hypothesis found, and with parameters that it held."""
    found = []
    for wheel, solution in zip(data.wheels, refit.solutions, strict=True):
        if one.model.base != wheel.model.base:
            # That base predicts channels that were not fitted here.
            found.append(fitted_anew(wheel, one))
            continue
        solved = copy.copy(wheel)
        solved.forget()
        solved.model = solution.model
        solved.seek(solution.unknowns)
        held = {name: np.full(len(wheel.windows), value) for name, value in one.fixed.items()}
        solved.parameters = {**wheel.parameters, **held, **smoothed_fit.parameters(solution)}
        found.append(solved)
    return found


def fitted_anew(wheel: FittedWheel, one: Hypothesis) -> FittedWheel:
    """Fit a hypothesis to a wheel as `compare` fits a model."""
    known, windows = wheel.settings, wheel.windows
    if any(not windows.samples.drivers.keys() >= {*effect.reads} for effect in one.effects):
        # What a drafted law follows nothing asked for before.
        (windows,) = with_inputs([windows], one.effects)
    fixed = {name: value for name, value in known.fixed.items() if name not in one.priors}
    settings = FitSettings({**fixed, **one.fixed}, {**known.priors, **one.priors}, known.shared, known.noise)
    return FittedWheel(windows, one.model, settings, wheel.segment, wheel.further)


def held_out_errors(
    wheels: Iterable[FittedWheel], block: Sequence[Index], levels: Mapping[str, float]
) -> dict[str, float]:
    """Return the root mean square of the held-out error of each channel as `compare` has it, SI.

    Refits are weighed by predictions from smoothed channels, which have less noise and lose what changes
    fast. Here each sample is predicted from what was measured at it. `levels` weigh the channels.
    """
    errors: dict[str, list[Array]] = {}
    for wheel, own in zip(wheels, block, strict=True):
        # A model may predict a channel that the one compared has no answer for.
        scale = {
            name: levels.get(name) or max(level(wheel.residuals[name]), 1e-300) for name in wheel.measured
        }
        found = held_out.predict(wheel, own, scale)
        for name, measured in wheel.measured.items():
            error = measured - found[name]
            errors.setdefault(name, []).append(error[np.isfinite(error)])
    joined = {name: np.concatenate(some) for name, some in errors.items()}
    return {name: float(np.sqrt(np.mean(some**2))) for name, some in joined.items() if len(some)}
