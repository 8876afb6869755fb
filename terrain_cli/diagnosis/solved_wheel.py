"""A wheel with another model: fitted anew, or with the parameters of a refit in the place of its own."""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import held_out, smoothed_covariance
from terrain_cli.comparison.fit_settings import FitSettings
from terrain_cli.comparison.fitted_wheel import FittedWheel

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from terrain_cli.comparison.smoothed_fit import Solution
    from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
    from terrain_cli.vocabulary.arrays import Array, Index


#: What a wheel computes once from its parameters.
_COMPUTED = ("read", "measured", "predicted", "residuals", "noise")


def of(wheel: FittedWheel, solution: Solution, fixed: Mapping[str, float]) -> FittedWheel:
    """Return a wheel with what a refit found, and with parameters that it held."""
    solved = copy.copy(wheel)
    for name in _COMPUTED:
        solved.__dict__.pop(name, None)
    local, shared = solution.unknowns.local, solution.unknowns.shared
    solved.model, solved.sought = solution.model, solution.unknowns
    solved.soil, solved.common = tuple(u.name for u in local), tuple(u.name for u in shared)
    solved.logarithmic = frozenset(u.name for u in (*local, *shared) if u.logarithm)
    solved.prior = {u.name: u.sd for u in (*local, *shared)}
    held = {name: np.full(len(wheel.windows), value) for name, value in fixed.items()}
    solved.parameters = {**wheel.parameters, **held, **smoothed_covariance.parameters(solution)}
    return solved


def fitted(wheel: FittedWheel, one: Hypothesis) -> FittedWheel:
    """Fit a hypothesis to a wheel as `compare` fits a model."""
    known = wheel.settings
    fixed = {name: value for name, value in known.fixed.items() if name not in one.priors}
    settings = FitSettings({**fixed, **one.fixed}, {**known.priors, **one.priors}, known.shared, known.noise)
    return FittedWheel(wheel.windows, one.model, settings, wheel.segment, wheel.further)


def _size(error: Array) -> float:
    """Return the root mean square of a residual, as something to divide by."""
    known = error[np.isfinite(error)]
    return max(float(np.sqrt(np.mean(known**2))), 1e-300) if len(known) else 1.0


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
        scale = {name: levels.get(name) or _size(wheel.residuals[name]) for name in wheel.measured}
        found = held_out.predict(wheel, own, scale)
        for name, measured in wheel.measured.items():
            error = measured - found[name]
            errors.setdefault(name, []).append(error[np.isfinite(error)])
    joined = {name: np.concatenate(some) for name, some in errors.items()}
    return {name: float(np.sqrt(np.mean(some**2))) for name, some in joined.items() if len(some)}
