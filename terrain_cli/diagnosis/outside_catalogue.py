"""What no effect of the catalogue explains: a channel, a driver, and a drafted law."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from terrain_cli import effects as catalogues
from terrain_cli import processes
from terrain_cli.comparison.drivers import functions_under_all
from terrain_cli.comparison.smoothed_channels import INTERPOLATED
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import drafted_laws, refit_ranking, refits, signatures
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis, UnknownEffect
from terrain_cli.diagnosis.drafted_laws import Draft
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.effects.laws import law_trial
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.telemetry.effect_inputs import sources
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.channels import CHANNELS

_MOST = 4_000  # Samples that are screened


@dataclass(frozen=True)
class Tried:
    draft: Draft
    refit: Refit
    hypothesis: Hypothesis
    extra: list[dict[str, Array]]  # Its driver, where that is no channel

    def like_soils(self, data: Ground) -> bool:
        """Tell whether it is a step, or may follow the time or the place, as a soil that changes does."""
        driver = self.draft.driver
        along = drafted_laws.ALONG.intersection((driver, *same_drivers(data, driver)))
        return self.draft.form == "step" or bool(along)


def best(data: Ground, base: Refit, progress: Callable[[str], None]) -> list[Tried]:
    """Find the laws with one driver that explain most, the best first; none that does not predict better."""
    progress("drafting laws")
    ranked: dict[tuple[str, str, str], float] = {}
    columns: dict[str, Array] = {}
    steps: dict[str, float] = {}
    for wheel in data.wheels:
        rows = np.arange(0, len(wheel), max(1, len(wheel) * len(data.wheels) // _MOST))
        known = signatures.evidence(wheel, rows)
        values = {
            name: known.channels[name] if name in INTERPOLATED and name in known.channels else column[rows]
            for name, column in drafted_laws.drivers(wheel).items()
        }
        for driver in values:
            if driver not in steps:
                steps[driver] = drafted_laws.step_of(wheel, driver, rows)
        # What a law takes off is the same however the samples are cut into blocks.
        one_block = np.zeros(len(rows), dtype=np.intp)
        screened = drafted_laws.screen(wheel, values, known.channels, rows, steps)
        for changes, drafts in screened:
            if not drafts:
                continue
            several = list(drafts.values())
            tables = {name: np.concatenate([one[name] for one in several], axis=1) for name in several[0]}
            white = known.whitened(tables, next(iter(tables.values())).shape[1])
            found, _ = signatures.scores(known.residual, known.soil, white, wheel.window[rows], one_block, 1)
            first = 0
            for (driver, form), own in drafts.items():
                width = next(iter(own.values())).shape[1]
                _, _, gain = found.fit(np.arange(first, first + width))
                key = (changes, driver, form)
                # Where a step is was chosen too.
                chosen = width + (form == "step")
                ranked[key] = ranked.get(key, 0.0) + gain - criteria.FURTHER_PARAMETER * chosen
                first += width
        for driver, column in values.items():
            columns.setdefault(driver, column)
    written: list[tuple[Draft, Hypothesis, list[dict[str, Array]]]] = []
    for changes, driver, form in _varied(ranked):
        size, step = _usual(data, changes), steps.get(driver, 0.0)
        unit = _unit(data, driver)
        draft = drafted_laws.write(changes, driver, form, columns.get(driver), unit, usual=size, step=step)
        if draft is None or catalogues.conflict(data.wheels[0].model, draft.effect):
            continue
        model = data.wheels[0].model
        one = Hypothesis(
            id=draft.effect.id,
            title=draft.effect.title,
            model=Model(model.base, (*model.effects, draft.effect)),
            fixed={draft.effect.qualified(p): p.null for p in draft.effect.parameters if p.held},
            effects=(draft.effect,),
        )
        written.append((draft, one, _extra(data, driver)))
    tried = processes.each(
        partial(_tried, data), written, lambda one: progress(f"fitting the draft {one[0].effect.id}")
    )
    tried = [one for one in tried if not refit_ranking.makes_soil_impossible(data, one.refit)]
    tried.sort(key=lambda one: float(one.refit.loss.sum()))
    return _plainest(tried, base)


def _tried(data: Ground, written: tuple[Draft, Hypothesis, list[dict[str, Array]]]) -> Tried:
    draft, one, extra = written
    return Tried(draft, refits.refit(data, one, extra), one, extra)


def _unit(data: Ground, driver: str) -> str:
    every = [drafted_laws.readable(wheel) for wheel in data.wheels]
    return next((one[driver].unit for one in every if driver in one), "")


def _usual(data: Ground, changes: str) -> float:
    every = [({**part.inputs, **part.measured}, part.use) for part in data.data]
    known = [channels[changes][use] for channels, use in every if changes in channels]
    return drafted_laws.usual(changes, np.concatenate(known) if known else np.empty(0))


def _extra(data: Ground, driver: str) -> list[dict[str, Array]]:
    """Return the driver where it is none of the channels that models read, nor what they predict."""
    every = [drafted_laws.readable(wheel) for wheel in data.wheels]
    return [
        {driver: one[driver].values[rows]}
        if driver in one and driver not in {*part.inputs, *part.measured}
        else {}
        for one, rows, part in zip(every, data.rows, data.data, strict=True)
    ]


def _varied(ranked: dict[tuple[str, str, str], float]) -> list[tuple[str, str, str]]:
    """Choose the best, of a quantity and a driver at most two forms, and sensors that explain as much."""
    chosen: list[tuple[str, str, str]] = []
    promising = sorted((key for key in ranked if ranked[key] > 0.0), key=lambda key: -ranked[key])
    for key in promising:
        changes, driver, _ = key
        near = ranked[key] >= (1.0 - criteria.DRAFT_LEFT) * ranked[promising[0]]
        room = len(chosen) < criteria.DRAFTS and sum(other[:2] == key[:2] for other in chosen) < 2
        if room or (near and driver in ("", changes)):
            chosen.append(key)
    return chosen


def _plainest(tried: list[Tried], base: Refit) -> list[Tried]:
    """Put in front a draft of a channel, or a plainer one, that explains nearly as much."""
    if not tried:
        return tried
    gains = [float((base.loss - one.refit.loss).sum()) for one in tried]
    if gains[0] <= 0.0:
        return []
    least = (1.0 - criteria.PLAINER_DRAFT) * gains[0]
    near = [one for one, gain in zip(tried, gains, strict=True) if gain >= least]
    first = min(
        near,
        key=lambda one: (
            one.draft.changes not in drafted_laws.SHOWN,
            one.draft.driver in drafted_laws.ALONG,
            drafted_laws.FORMS.index(one.draft.form),
        ),
    )
    return [first, *(one for one in tried if one is not first)]


def beats(tried: Sequence[Tried], effect: Refit) -> bool:
    """Tell whether the best draft predicts better than an effect, beyond chance."""
    return bool(tried) and refit_ranking.beats(tried[0].refit, effect)


def sensor(tried: Sequence[Tried], hypothesis: Hypothesis, effect: Refit) -> Tried | None:
    """Return a draft of a sensor that predicts as well as an effect, which says something else."""
    changed = {name: law_of for law_of in hypothesis.effects for name in law_of.laws}
    for one in tried:
        draft = one.draft
        # Zero and gain of a sensor can say all that an effect says of it; its zero, only what it is itself.
        same = draft.changes in changed and (
            draft.driver != "" or law_trial.shifts(changed[draft.changes], draft.changes)
        )
        if draft.of_sensor and not same and refit_ranking.as_good(one.refit, effect):
            return one
    return None


def same_drivers(data: Ground, driver: str) -> tuple[str, ...]:
    """Name the drivers of which one is a function under every wheel: a law of it may be theirs."""
    if driver == drafted_laws.ANGLE:
        return ()
    # The angle grows with all that grows, and no law but a periodic one is made of it.
    found = functions_under_all(driver, map(drafted_laws.drivers, data.wheels))
    return tuple(name for name in found if name != drafted_laws.ANGLE)


def verdict(
    share: Callable[[Tried | None], float],
    base: Refit,
    effect: Refit,
    tried: Sequence[Tried],
    family: Sequence[str],
    same: Sequence[str] = (),
    pair: Refit | None = None,
    rival: Tried | None = None,
) -> tuple[UnknownEffect | None, bool]:
    """Return a draft that predicts better than every effect, and whether it stands alone.

    `share` is that of the printed errors which a draft, or else the best effect, takes off; NaN where none is
    more than noise.
    `same` are the drivers of which that of the draft is a function. Where a `pair` of effects predicts as
    well as the draft, what is missing may be in the catalogue, though not all of it in one effect. `rival` is
    the draft of a sensor that predicts as well as the first of the family.
    """
    if not tried:
        return None, False
    count = sum(int(np.count_nonzero(one)) for one in base.residuals)
    misfit = float(base.loss.sum()) - min(count, float(min(effect.loss.sum(), tried[0].refit.loss.sum())))
    left = float((effect.loss - tried[0].refit.loss).sum())
    if misfit > 0.0 and left > 0.0 and (not family or beats(tried, effect)):
        channel = _channel(base, tried[0])
        errors = [one.heldout[channel] ** 2 for one in (base, effect, tried[0].refit)]
        # Where noise lasts, a misfit that lasts weighs little, and a small one that does not, as much.
        much = errors[1] - errors[2] >= criteria.DRAFT_LEFT * (errors[0] - errors[2])
        # What follows a column that is no channel, no effect of the catalogue can follow.
        much = much or not CHANNELS.keys() >= {*sources(tried[0].draft.driver or "time")}
        matched = pair is not None and refit_ranking.as_good(pair, tried[0].refit)
        # A loss of smoothed channels may fall where the errors that every verb prints do not.
        of_law, of_effect = share(tried[0]), share(None)
        if not np.isnan(of_effect) and of_law < max(criteria.DRAFT_LEFT, of_effect):
            return None, False
        # Nor is it alone where an effect takes nearly as much off them.
        matched = matched or of_effect >= (1.0 - criteria.DRAFT_LEFT) * of_law
        alone = not family or (left >= criteria.DRAFT_LEFT * misfit and much and not matched)
        # Effects that hardly take off any of them are nothing to tell beside it.
        alone = alone or of_effect <= criteria.RIVAL_WORTH * of_law
        better = "A sensor's error" if tried[0].draft.of_sensor else "A drafted law"
        head = "No effect of the catalogue explains it" if alone else f"{better} predicts better"
        return _told(of_law, base, tried[0], misfit, head, same), alone
    if rival is not None and misfit > 0.0:
        return _told(share(rival), base, rival, misfit, "A sensor's error predicts as well"), False
    return None, False


def _told(
    explained: float,
    base: Refit,
    one: Tried,
    misfit: float,
    head: str,
    same: Sequence[str] = (),
) -> UnknownEffect:
    draft = one.draft
    if np.isnan(explained):
        explained = float(np.clip((base.loss - one.refit.loss).sum() / misfit, 0.0, 1.0))
    channel = draft.changes if draft.changes in drafted_laws.SENSED else _channel(base, one)
    does = draft.in_words(same, draft.form)
    return UnknownEffect(
        channel=channel,
        driver=draft.driver,
        form=draft.form,
        explained=explained,
        law=draft.in_words(same) + ", or the soil varies along the drive" * draft.along,
        sentence=f"{head}: {does}, which explains {explained:.0%} of the misfit."
        + " A soil that varies along the drive looks much the same." * draft.along,
        draft=draft.text,
        alternatives=tuple(same),
    )


def _channel(base: Refit, one: Tried) -> str:
    """Return the channel that a draft changes, or else that whose held-out error falls most."""
    after = one.refit.heldout
    if one.draft.changes in after:
        return one.draft.changes
    falls = {name: base.heldout[name] / error for name, error in after.items() if error > 0.0}
    return max(falls, key=lambda name: falls[name])
