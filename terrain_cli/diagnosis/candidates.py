"""Candidates as results: the score, p value, gain and parameters of each hypothesis, collected."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import smoothed_covariance
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import refit_ranking
from terrain_cli.diagnosis.diagnosis_outcome import Candidate, Size
from terrain_cli.models.model_file import SOIL_UNITS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
    from terrain_cli.diagnosis.refits import Ground, Refit
    from terrain_cli.diagnosis.screening import Screened


def listed(
    data: Ground,
    base: Refit,
    found: Screened,
    ranked: Sequence[tuple[Hypothesis, Refit]],
    hypotheses: Sequence[Hypothesis],
    family: Sequence[str],
) -> list[Candidate]:
    """List every candidate that can be tested: those ranked, then the others by what they explain."""
    count = max(sum(int(np.count_nonzero(one)) for one in base.residuals), 1)
    beyond = float(base.loss.sum()) - count
    # Where all is noise, there is nothing to explain a share of.
    misfit = beyond if beyond > 0.0 else np.nan

    def candidate(one: Hypothesis, refit: Refit | None) -> Candidate:
        change = -found.explained[one.id] if refit is None else float((refit.loss - base.loss).sum())
        return Candidate(
            effect=one.id,
            title=one.title,
            score=found.scores[one.id],
            p_value=found.p_values[one.id],
            surviving=found.surviving[one.id],
            explained=float(np.clip(-change / misfit, 0.0, 1.0)),
            loss=change / count,
            loss_se=np.nan if refit is None else refit_ranking.error(refit.loss - base.loss) / count,
            heldout=dict(base.heldout) if refit is None else refit.heldout,
            sizes=dict(found.sizes[one.id]) if refit is None else _sizes(one, data, refit),
            refitted=refit is not None,
            in_family=refit is not None and one.id in family,
        )

    done = {one.id for one, _ in ranked}
    rest = [candidate(one, None) for one in hypotheses if one.id in found.p_values and one.id not in done]
    return [
        *(candidate(one, refit) for one, refit in ranked),
        *sorted(rest, key=lambda one: one.loss),
    ]


def _sizes(one: Hypothesis, data: Ground, refit: Refit) -> dict[str, Size]:
    """Return the parameters that came with a hypothesis, averaged over the wheels by their errors.

    NaN where the data leave one open.
    """
    names = list(one.parameters or one.priors)
    pairs: dict[str, list[tuple[float, float]]] = {}
    for part, solution in zip(data.data, refit.solutions, strict=True):
        covariance, _ = smoothed_covariance.covariance(part, solution)
        sought = solution.unknowns
        for column, unknown in enumerate((*sought.local, *sought.shared)):
            if unknown.name not in names:
                continue
            own = column < len(sought.local)
            t = solution.t[:, column] if own else solution.common[[column - len(sought.local)]]
            error = np.sqrt(covariance[:, column, column]) if own else np.sqrt(covariance[:1, column, column])
            told = (error < criteria.LEFT_OPEN * unknown.sd) | unknown.logarithm
            known = zip(unknown.value(t)[told].tolist(), error[told].tolist(), strict=True)
            pairs.setdefault(unknown.name, []).extend(known)
    sizes = {}
    for name in (name for name in names if name in pairs):
        own_parameter, found = one.model.parameters.get(name), pairs[name]
        value, se = pooled(found) if found else (np.nan, np.nan)
        factor = own_parameter.factor if own_parameter else 1.0
        unit = own_parameter.unit if own_parameter else SOIL_UNITS.get(name, "")
        sizes[own_parameter.name if own_parameter else name] = Size(value / factor, se / factor, unit)
    return sizes


def pooled(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Average values with their standard errors.

    The error of the mean is larger by as much as the values differ by more than their errors (Birge, Physical
    Review 40, 1932): what one wheel has and the others have not is known of none of them.
    """
    values, errors = np.transpose(found)
    weight = np.where(np.isfinite(errors) & (errors > 0.0), errors, 1.0) ** -2.0
    mean = float(np.average(values, weights=weight))
    scatter = float(weight @ (values - mean) ** 2) / max(len(values) - 1, 1)
    return mean, float(weight.sum() ** -0.5) * max(scatter, 1.0) ** 0.5
