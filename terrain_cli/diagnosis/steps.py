"""The steps of a diagnosis from the alarm on, as docs/diagnose-method.md numbers them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from terrain_cli import effects as catalogues
from terrain_cli import models, processes
from terrain_cli.comparison import blocks, comparison_criteria
from terrain_cli.comparison.compare import pooled_noise
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import (
    alarm,
    drafted_laws,
    next_drive,
    outside_catalogue,
    pairs,
    refit_ranking,
    refits,
    screening,
)
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.candidates import Fitted, as_it_is, held_out_errors, late_as_printed
from terrain_cli.diagnosis.diagnosed_log import Case, DiagnosedLog
from terrain_cli.diagnosis.diagnosis_outcome import (
    Alarm,
    Candidate,
    Hypothesis,
    NextDrive,
    UnknownEffect,
    above_noise,
    hardly_explain,
    over_noise,
    share_taken,
)
from terrain_cli.diagnosis.pairs import Two
from terrain_cli.diagnosis.refits import Ground, Refit
from terrain_cli.diagnosis.verdict import Decision


@dataclass(frozen=True, kw_only=True)
class Ranked:
    """Every hypothesis and drafted law fitted, weighed by the noise that the best of them leaves."""

    log: DiagnosedLog
    base: Refit  # The model as it is
    several: list[Fitted]  # The best first
    drafts: list[outside_catalogue.Tried]  # Laws of one driver, the best first
    late_only: bool = False  # Only what is late comes near the first, by the errors that are printed

    @property
    def data(self) -> Ground:
        """The data, with the noise that the best of them leaves."""
        return self.log.data

    @property
    def best(self) -> Refit:
        """The best effect, or the model as it is where none was fitted."""
        return self.several[0][1] if self.several else self.base

    @cached_property
    def lowest(self) -> Fitted | None:
        """Whichever predicts best: the order has reasons besides."""
        return min(self.several, key=lambda pair: float(pair[1].loss.sum()), default=None)

    @cached_property
    def anew(self) -> list[FittedWheel]:
        """The wheels with that one, as `compare` fits a model."""
        return [refits.fitted_anew(wheel, self.lowest[0]) for wheel in self.data.wheels if self.lowest]

    @cached_property
    def first_anew(self) -> list[FittedWheel]:
        """The same with the first one."""
        if self.several and self.several[0] is self.lowest:
            return self.anew
        return [refits.fitted_anew(wheel, one) for one, _ in self.several[:1] for wheel in self.data.wheels]

    @property
    def taken(self) -> float:
        """What the best effect takes off the held-out loss."""
        return float((self.base.loss - self.best.loss).sum())


@dataclass(frozen=True, kw_only=True)
class Family:
    """The effects that cannot be told from the best one."""

    members: list[Fitted] = field(default_factory=list)  # The best first
    earned: bool = False  # The best one has earned a single name
    clear: bool = False  # It leaves little, if anything
    whole: bool = False  # It leaves nothing
    rival: outside_catalogue.Tried | None = None  # A sensor that predicts as well as a name else earned

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(one.id for one, _ in self.members)

    @property
    def open(self) -> list[Fitted]:
        """What a further drive has to tell apart: they, and a sensor that predicts as well as a name."""
        return [*self.members, *([(self.rival.hypothesis, self.rival.refit)] if self.rival else [])]

    @property
    def name(self) -> str:
        """The best one where it is clear, else nothing."""
        return self.ids[0] if self.clear else ""


def alarm_of_scores(case: Case, log: DiagnosedLog, base: Refit) -> Alarm:
    """Tell how often chance gives scores as strong; of too few blocks nothing is told."""
    if log.data.blocks < criteria.BLOCKS_OF_ALARM:
        return Alarm(raised=False, p_value=1.0, level=criteria.LEVEL)
    p_value = _of_scores(case, log)
    if p_value >= criteria.LEVEL:
        testable = [one for one in log.hypotheses if one.id in log.found.p_values]
        unscored, _ = alarm.of_unscored(log.data.wheels, log.block, testable, lambda: log.data)
        p_value = min(p_value, unscored)
    if p_value >= criteria.LEVEL:
        p_value = min(p_value, _of_laws(case, log, base))
    return Alarm(raised=p_value < criteria.LEVEL, p_value=p_value, level=criteria.LEVEL)


def _of_laws(case: Case, log: DiagnosedLog, base: Refit) -> float:
    """Return how often chance gives what a drafted law gains that leaves only noise of a large misfit.

    What changes as slowly as moisture is alike in block after block: joined, they are too few for scores.
    """
    # A model of which `compare` says that it fits is not doubted.
    if not above_noise(over_noise(log.comparison)) or not refits.misses(log.data, base):
        return 1.0
    drafts = [
        one.refit.loss
        for one in outside_catalogue.best(log.data, base, case.progress)
        if not one.like_soils(log.data) and not refits.misses(log.data, one.refit)
    ]
    p_values = (criteria.DRAFTS * alarm.of_gain_in_most(base.loss - loss) for loss in drafts)
    return min([1.0, *p_values])


def _of_scores(case: Case, log: DiagnosedLog) -> float:
    """Return how often chance gives such scores, such findings, or such an order of points."""
    every = [*log.found.p_values.values(), *(one.p_value for one in log.failures)]
    return min([1.0, *every, alarm.of_order(log.data, case.seed)])


def refitted(case: Case, log: DiagnosedLog) -> list[Fitted]:
    """Fit every hypothesis that may be a rival, in the form of its law that predicts best, the best first.

    What scores far less than the best explains far less once fitted too.
    """
    explained = log.found.explained
    least = criteria.SCORE_WORTH * max(explained.values(), default=0.0)
    testable = [
        one
        for one in log.hypotheses
        if one.id in log.found.p_values and (not one.scored or explained[one.id] >= least)
    ]

    def before(one: Hypothesis) -> None:
        case.progress(f"fitting with {one.id} ({testable.index(one) + 1} of {len(testable)})")

    several = processes.each(partial(_best_form, log.data), testable, before)
    return sorted(several, key=lambda pair: float(pair[1].loss.sum()))


def ranking(case: Case, log: DiagnosedLog, base: Refit) -> Ranked:
    """Fit every effect and draft laws, and weigh them anew by the noise that the best of them leaves.

    From neighbouring samples alone, noise that lasts would be taken for too small.
    """
    several = refitted(case, log)
    drafts = outside_catalogue.best(log.data, base, case.progress)
    leaders = [one for _, one in several[:1]] + [one.refit for one in drafts[:1]]
    if not leaders:
        return Ranked(log=log, base=base, several=several, drafts=drafts)
    data = refits.with_noise_of(log.data, min(leaders, key=lambda one: float(one.loss.sum())))
    base = refits.refit(data, None)
    again = processes.each(partial(_again, data), several[: criteria.RIVALS + 2])
    again = sorted(again, key=lambda pair: float(pair[1].loss.sum()))
    rest = [(one, refits.weighed(data, refit)) for one, refit in several[criteria.RIVALS + 2 :]]
    again, late_only = late_as_printed(replace(log, data=data), [*_in_order(data, base, again), *rest])
    drafts = [
        replace(one, refit=refits.refit(data, one.hypothesis, one.extra, one.refit.solutions))
        for place, one in enumerate(drafts)
        if place < 2 or one.draft.of_sensor
    ]
    log = replace(log, data=data)
    return Ranked(log=log, base=base, several=again, drafts=drafts, late_only=late_only)


def alarm_of_gain(case: Case, ranked: Ranked, before: Alarm) -> Alarm:
    """Hold the alarm against the gain of the best explanation on held-out blocks, and against its size."""
    best = ranked.lowest
    least = best[1] if best else ranked.base
    laws = [one for one in ranked.drafts[:1] if float((one.refit.loss - least.loss).sum()) < 0.0]
    gain = ranked.base.loss - (laws[0].refit if laws else least).loss
    told = next((one for one in laws if refit_ranking.beats(one.refit, least)), None)
    p_value = max(before.p_value, alarm.at_level(gain))
    shares = alarm.shares(ranked.data, ranked.base, told.refit if told else least)
    if best and best[0].effects and told is None and p_value < criteria.LEVEL:
        # A loss of smoothed channels may fall where no error does; or not, as with a lag, where errors do.
        # Without an assumption of the base other channels are predicted, and fitted, too.
        shares = alarm.printed_shares(ranked.data.wheels, ranked.anew, ranked.log.block) or shares
    channel = max(shares, key=lambda name: shares[name], default="")
    share = shares.get(channel, np.nan)
    return Alarm(
        raised=p_value < criteria.LEVEL and not share < case.smallest_share,
        p_value=p_value,
        level=criteria.LEVEL,
        gain=float(gain.sum()),
        gain_se=blocks.error(gain),
        cause=_law(told.draft) if told else least.id,
        channel=channel,
        share=share,
        smallest_share=case.smallest_share,
    )


def _law(draft: drafted_laws.Draft) -> str:
    """Say in a few words what a drafted law does."""
    follows = f"that follows {draft.driver}" if draft.driver else "that is always there"
    return f"a change of {draft.changes} {follows}".replace("_", " ")


def family(case: Case, ranked: Ranked) -> Family:
    """Find those that cannot be told from the best, and whether this has earned a single name."""
    near = [
        pair
        for pair in ranked.several[: criteria.RIVALS]
        if float((ranked.base.loss - pair[1].loss).sum()) > criteria.RIVAL_WORTH * ranked.taken
        and (pair[0].late or not ranked.late_only)
    ]
    if ranked.taken <= 0.0 or not near:
        return Family()
    case.progress("telling the best ones apart")
    judged = refit_ranking.judge(ranked.data, [one for _, one in near], [one for one, _ in near], case.seed)
    # A name that leaves something unexplained is not the whole story, and perhaps none of it.
    of_rest, left = alarm.follows(ranked.data, near[0][1], case.seed)
    clear = (of_rest >= criteria.LEVEL and left < ranked.taken) or left < criteria.SMALL_REST * ranked.taken
    # Nor is it where a law that nobody thought of predicts better.
    clear = clear and not outside_catalogue.beats(ranked.drafts, near[0][1])
    # Nor where its size is not to be believed.
    clear = clear and not refit_ranking.doubt(ranked.data, *near[0])
    earned = judged.earned and clear and ranked.data.blocks >= comparison_criteria.FEWEST_BLOCKS
    # Nor is it where it was only fitted, and no score stands out: a lag imitates much.
    earned = earned and (not near[0][0].effects or _of_scores(case, ranked.log) < criteria.LEVEL)
    # Nor is it where a soil that changes predicts better, or where another sensor's error would do.
    earned = earned and not ranked.log.soils_are_better
    rival = outside_catalogue.sensor(ranked.drafts, *near[0]) if earned else None
    earned = earned and rival is None
    # A second effect shows as soon as the first is in the model.
    silent = not earned or quiet_with(case, ranked, *near[0])
    return Family(
        members=[near[place] for place in judged.family],
        earned=earned and silent,
        clear=clear,
        whole=clear and silent and of_rest >= criteria.LEVEL,
        rival=rival,
    )


def outside_the_catalogue(ranked: Ranked, found: Family, two: Two) -> tuple[UnknownEffect | None, bool]:
    """Return a drafted law that explains what no effect does, and whether it stands alone."""
    same = outside_catalogue.same_drivers(ranked.data, ranked.drafts[0].draft.driver) if ranked.drafts else ()
    pair = two.fitted[0][1] if two.fitted else None

    def share(one: outside_catalogue.Tried | None) -> float:
        wheels = ranked.first_anew
        if one:
            wheels = [refits.fitted_anew(wheel, one.hypothesis) for wheel in ranked.data.wheels]
        elif not ranked.several:
            return math.nan
        return share_taken(ranked.log.comparison, as_it_is(ranked.log), held_out_errors(ranked.log, wheels))

    return outside_catalogue.verdict(
        share, ranked.base, ranked.best, ranked.drafts, found.ids, same, pair, found.rival
    )


def two_at_once(case: Case, ranked: Ranked, found: Family) -> Two:
    """Find two effects that explain more together than anything else does."""
    if found.whole or late_takes_most(ranked):
        return Two()
    fitted = pairs.best(ranked.data, ranked.log, ranked.several, case.progress, found.name)
    others = [ranked.best, *(one.refit for one in ranked.drafts[:1])]
    return pairs.two_of(fitted, others, found.name)


def on_full_stresses(case: Case, ranked: Ranked, two: Two) -> list[Fitted]:
    """Return the effects that go with the stresses of the full model, the best first.

    Together they predict better than any effect alone, and as well as all else: that the stresses of
    the base linear are not those under a wheel is known.
    """
    several = ranked.several
    stresses = next((refit for one, refit in several if one.id == models.STRESSES), None)
    if stresses is None or several[0][0].id == models.STRESSES:
        return []
    tried = pairs.on_full_stresses(ranked.data, case.file, case.effects, stresses, case.progress)
    if not tried:
        return []
    first = tried[0][1]
    further = [*(one.refit for one in ranked.drafts[:1]), *(one for _, one in two.fitted[:1])]
    better = all(refit_ranking.beats(first, one) for one in (several[0][1], stresses))
    if not better or not all(refit_ranking.as_good(first, one) for one in further):
        return []
    return [(one, refit) for one, refit in tried if refit_ranking.as_good(refit, first)]


def rivals(decision: Decision, members: Sequence[Fitted], listed: Sequence[Candidate]) -> list[Fitted]:
    """Return what a further drive has to tell apart: the causes, or the one from what is not believed.

    Among several causes no drive is worth while to rule out what is none.
    """
    idle = hardly_explain(listed) - {*decision.together} if decision.together else set()
    doubted = {one.effect for one in listed if one.doubt}
    left = [pair for pair in members if pair[0].id not in idle]
    credible = [pair for pair in left if pair[0].id not in doubted]
    return credible if len(credible) > 1 else left


def next_drives(case: Case, ranked: Ranked, members: Sequence[Fitted]) -> list[NextDrive]:
    """Find the drive that tells the members of a family apart."""
    if len(members) < 2:
        return []
    case.progress("looking for the drive that would settle it")
    return next_drive.suggest(ranked.data, members)


def _best_form(data: Ground, one: Hypothesis) -> Fitted:
    """Fit a hypothesis in the form of its law that predicts best."""
    plain, *others = [(form, refits.refit(data, form)) for form in one.forms]
    # Another form stands for the effect only where it fits by what the effect can be.
    forms = [plain, *(pair for pair in others if not refit_ranking.doubt(data, *pair))]
    return min(forms, key=lambda pair: float(pair[1].loss.sum()))


def _again(data: Ground, pair: Fitted) -> Fitted:
    one, before = pair
    return one, refits.over_shapes(data, one, refits.refit(data, one, begun=before.solutions))


def _in_order(data: Ground, base: Refit, ranked: list[Fitted]) -> list[Fitted]:
    """Put effects whose size is not to be believed behind all others that predict better than the base.

    In front is, of those that predict as well as the first, one of which no parameter is at its bound, with
    the fewest of them.
    """
    credible = [
        pair for pair in ranked if refit_ranking.beats(pair[1], base) and not refit_ranking.doubt(data, *pair)
    ]
    leading = credible or ranked
    if not leading:
        return []
    good = [pair for pair in leading if refit_ranking.as_good(pair[1], leading[0][1])]
    first = min(good, key=lambda pair: (pair[1].at_bound(pair[0], shape=True), pair[0].free))
    inside = [pair for pair in credible if pair is not first]
    return [first, *inside, *(pair for pair in ranked if pair not in credible and pair is not first)]


def late_takes_most(ranked: Ranked) -> bool:
    """Tell whether one that is late leads, and takes most off the errors that every verb prints."""
    if not ranked.several or not ranked.several[0][0].late:
        return False
    log, wheels = ranked.log, ranked.first_anew
    noise = {name: pooled_noise(wheels, name) for name in log.comparison.channels}
    share = share_taken(log.comparison, as_it_is(log), held_out_errors(log, wheels), noise)
    return share >= 1.0 - criteria.DRAFT_LEFT


def quiet_with(case: Case, ranked: Ranked, one: Hypothesis, refit: Refit) -> bool:
    """Tell whether nothing more shows once an effect is in the model: no other one, nor another size."""
    wheels = refits.on_wheels(ranked.data, one, refit)
    others = [
        other
        for other in ranked.log.hypotheses
        if other.id != one.id and other.effects and not catalogues.conflict(wheels[0].model, other.effects[0])
    ]
    found = screening.screen(wheels, ranked.log.block, others, case.seed)
    first = max(found.p_values, key=lambda name: found.explained[name], default="")
    if first and alarm.of_scores(found, first) < criteria.LEVEL:
        return False
    # More samples are scored than are fitted.
    more = sum(len(part.rows) for part in found.columns) / sum(map(len, ranked.data.rows))
    least = criteria.SMALL_REST * ranked.taken * more
    return alarm.of_sizes(found, wheels, one, least, case.seed) >= criteria.LEVEL
