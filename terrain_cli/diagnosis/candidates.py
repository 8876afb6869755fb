"""Every effect that a diagnosis could test, with what it explains: the table of docs/diagnose.md."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from terrain_cli.comparison import blocks
from terrain_cli.comparison.compare import pooled_noise
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import effect_sizes, refit_ranking, refits
from terrain_cli.diagnosis.diagnosed_log import DiagnosedLog
from terrain_cli.diagnosis.diagnosis_outcome import (
    Candidate,
    Hypothesis,
    noise_with,
    over_noise,
    share_taken,
)
from terrain_cli.diagnosis.refits import Refit

Fitted = tuple[Hypothesis, Refit]


def table_of(
    log: DiagnosedLog,
    base: Refit,
    ranked: Sequence[Fitted],
    family: Sequence[str],
    anew: Sequence[FittedWheel] = (),
    pair: Candidate | None = None,
) -> list[Candidate]:
    """List every candidate that can be tested.

    The best comes first, then the rest of the family, the others, and those that were not fitted; each of
    these by their loss. What they explain is of the errors that are told, where these are more than noise.
    `anew` are the wheels with the best one as `compare` fits it, where known. Where a `pair` explains most,
    the noise is that with both.
    """
    data, found = log.data, log.found
    count = _samples(base)
    misfit = _misfit(base, [refit for _, refit in ranked])
    first = ranked[0][0].id if ranked else ""

    def candidate(one: Hypothesis, refit: Refit | None) -> Candidate:
        change = -found.explained[one.id] if refit is None else float((refit.loss - base.loss).sum())
        if one.id == first and refit is not None:
            # As `compare` and `model add` fit it; the others, in less time, with what the refit found.
            wheels = list(anew) or [refits.fitted_anew(wheel, one) for wheel in data.wheels]
        else:
            wheels = refits.on_wheels(data, one, refit) if refit is not None else []
        return Candidate(
            effect=one.id,
            title=one.title,
            score=found.scores[one.id],
            p_value=found.p_values[one.id],
            surviving=found.surviving[one.id],
            explained=float(np.clip(-change / misfit, 0.0, 1.0)),
            loss=change / count,
            loss_se=np.nan if refit is None else blocks.error(refit.loss - base.loss) / count,
            heldout=held_out_errors(log, wheels) if wheels else {},
            noise={name: pooled_noise(wheels, name) for name in base.heldout} if one.id == first else {},
            sizes=dict(found.sizes[one.id]) if refit is None else effect_sizes.of_refit(one, data, refit),
            refitted=refit is not None,
            in_family=refit is not None and one.id in family,
            doubt="" if refit is None else refit_ranking.doubt(data, one, refit),
            settles=one.id == first and effect_sizes.settles_pull(wheels, one),
        )

    fitted = {one.id: refit for one, refit in ranked}
    every = [one for one, _ in ranked]
    every += [one for one in log.hypotheses if one.id in found.p_values and one.id not in fitted]
    listed = [candidate(one, fitted.get(one.id)) for one in every]
    listed.sort(key=lambda one: (one.effect != first, not one.in_family, not one.refitted, one.loss))
    before, own = as_it_is(log) if ranked else {}, log.comparison
    noise = noise_with(own, pair.noise if pair else listed[0].noise if listed else {}, before)
    # The loss is weighed by the noise that the best leaves, of which a misfit may be a part.
    shares = [share_taken(own, before, one.heldout, noise) for one in listed]
    return [
        one if np.isnan(share) else replace(one, explained=share)
        for one, share in zip(listed, shares, strict=True)
    ]


def _samples(base: Refit) -> int:
    return max(sum(int(np.count_nonzero(one)) for one in base.residuals), 1)


def _misfit(base: Refit, better: Sequence[Refit]) -> float:
    """Return the loss beyond the noise, of which effects explain a share; NaN where all is noise."""
    beyond = float(base.loss.sum()) - _samples(base)
    if beyond <= 0.0:
        # What passes for noise, and is taken off all the same, was none.
        beyond = max((float((base.loss - refit.loss).sum()) for refit in better), default=0.0)
    return beyond if beyond > 0.0 else np.nan


def of_pair(log: DiagnosedLog, base: Refit, both: Hypothesis, refit: Refit) -> Candidate:
    """Return what two effects explain together, with the errors as `compare` and `model add` have them."""
    wheels = [refits.fitted_anew(wheel, both) for wheel in log.data.wheels]
    own, before, heldout = log.comparison, as_it_is(log), held_out_errors(log, wheels)
    noise = {name: pooled_noise(wheels, name) for name in own.channels}
    share = share_taken(own, before, heldout, noise_with(own, noise, before))
    of_loss = np.clip(float((base.loss - refit.loss).sum()) / _misfit(base, [refit]), 0.0, 1.0)
    return Candidate(
        effect=both.id,
        title=both.title,
        explained=float(of_loss) if np.isnan(share) else share,
        heldout=heldout,
        noise=noise,
        refitted=True,
        in_family=True,
    )


def as_it_is(log: DiagnosedLog) -> dict[str, float]:
    """Return the held-out errors of the model as it is, where the soils are others than the comparison's."""
    own = zip(log.comparison.wheels, log.data.wheels, strict=True)
    return (
        held_out_errors(log, log.data.wheels) if any(one.fit is not other.fit for one, other in own) else {}
    )


def held_out_errors(log: DiagnosedLog, wheels: Sequence[FittedWheel]) -> dict[str, float]:
    """Return the held-out errors of some wheels, by channel, as `compare` has them."""
    levels = {
        name: errors.noise if errors.noise > 0.0 else errors.rmse
        for name, errors in log.comparison.channels.items()
    }
    return refits.held_out_errors(wheels, log.block, levels)


def late_as_printed(log: DiagnosedLog, ranked: list[Fitted]) -> tuple[list[Fitted], bool]:
    """Put first, of what is late, that with which the errors that every verb prints are lowest.

    Smoothed channels lose what changes fast: what tells a lag in time from one in distance, and of a short
    one most. So what is late comes first, too, where it takes clearly more off the printed errors than all
    else does. Whether it comes first for that is returned as well.
    """
    late = [pair for pair in ranked if pair[0].late and not refit_ranking.doubt(log.data, *pair)]
    if not late or (ranked[0][0].late and ranked[0] is not late[0]):
        return ranked, False
    only = late[0] is not ranked[0]
    if only:
        before = as_it_is(log)

        def share(pair: Fitted) -> float:
            left = held_out_errors(log, refits.on_wheels(log.data, *pair))
            return float(np.nan_to_num(share_taken(log.comparison, before, left)))

        # The first is asked alone to begin with: beside one that takes nearly all nothing takes clearly more.
        if (least := share(ranked[0]) + criteria.DRAFT_LEFT) >= 1.0:
            return ranked, False
        most = max(map(share, late))
        others = (pair for pair in ranked[1:] if not pair[0].late)
        if most < least or any(share(pair) + criteria.DRAFT_LEFT > most for pair in others):
            return ranked, False

    def size(pair: Fitted) -> float:
        errors = held_out_errors(log, [refits.fitted_anew(wheel, pair[0]) for wheel in log.data.wheels])
        return float(np.nansum(np.square([*over_noise(log.comparison, errors).values()])))

    late = sorted(late, key=size) if len(late) > 1 else late
    return [*late, *(pair for pair in ranked if pair not in late)], only
