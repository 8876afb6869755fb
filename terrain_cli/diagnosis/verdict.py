"""The verdict: from the findings to a decision, and from that to sentences for a person."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

from terrain_cli.comparison import Finding, comparison_criteria
from terrain_cli.comparison.findings import missed
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.diagnosis_outcome import (
    Candidate,
    Diagnosis,
    Size,
    Verdict,
    above_noise,
    hardly_explain,
    over_noise,
    too_few,
)
from terrain_cli.models import STRESSES
from terrain_cli.vocabulary.quantities import listed, short


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The verdict, and what is told beside it."""

    verdict: Verdict
    family: tuple[str, ...]  # The best first; `effect` alone where one name is given
    together: tuple[str, ...] = ()  # Two that belong together
    tells_law: bool = True  # A drafted law is told, alone or beside the family
    # "family" or "on_full_stresses" or "": which of the findings the next drive has to tell apart
    rivals: str = "family"

    @property
    def effect(self) -> str | None:
        """The one name, where one is earned."""
        return self.family[0] if self.verdict == "effect" else None


def decide(
    *,
    family: tuple[str, ...] = (),
    earned: bool = False,
    clear: bool = False,
    law_alone: bool = False,
    pair: tuple[str, ...] = (),
    pair_is_best: bool = False,
    on_full_stresses: tuple[str, ...] = (),
) -> Decision:
    """Weigh what was found once the alarm was raised.

    The strongest statement wins: effects that predict best once the stresses of the base linear are replaced,
    then a pair of effects, then a drafted law that stands alone, then a single name that was earned, then a
    family, of which the first is `clear` if it leaves little.
    """
    if on_full_stresses:
        every = (STRESSES, *on_full_stresses)
        return Decision(
            verdict="family", family=every, together=every[:2], tells_law=False, rivals="on_full_stresses"
        )
    if pair and not clear:
        return Decision(verdict="family", family=family or pair, together=pair, tells_law=False)
    if pair:
        joined = pair if pair_is_best else tuple(dict.fromkeys((*pair, *family)))
        rivals = "" if pair_is_best else "family"
        return Decision(verdict="family", family=joined, together=pair, tells_law=False, rivals=rivals)
    if law_alone:
        return Decision(verdict="unknown", family=(), rivals="")
    return Decision(verdict="effect" if earned else "family", family=family)


def weighed(decision: Decision, listed: Sequence[Candidate], *, leaves: bool) -> Decision:
    """Weigh a decision by the errors that are printed, of which the first one listed may leave much."""
    if decision.verdict == "effect" and leaves:
        # As much is left for another effect, which may be all there is.
        return replace(decision, verdict="family")
    if not decision.together:
        return decision
    # Beside two that explain it, what hardly lowers an error alone is no cause.
    idle = hardly_explain(listed) - {*decision.together}
    return replace(decision, family=tuple(n for n in decision.family if n not in idle) or decision.family)


OFFER = "--draft FILE.toml writes the law."  # How a verdict ends where a law of its own was drafted


def sentence(diagnosis: Diagnosis, failures: Sequence[Finding], changed: Collection[str] = ()) -> str:
    """Say the verdict to a person, and what to do next.

    `failures` are of the model on the soils of the diagnosis, the strongest first; `changed` are the channels
    that what is most likely missing changes by itself, without the soil.
    """
    if diagnosis.verdict == "none" and diagnosis.alarm.small:
        small = f"{diagnosis.alarm.size[:1].upper()}{diagnosis.alarm.size[1:]}"
        least = f"less than the {100 * diagnosis.alarm.smallest_share:.2g} % that an alarm needs"
        return f"{small}. That is not chance, but {least}."
    seen = _seen(diagnosis, failures, changed)
    if diagnosis.verdict == "none":
        return _nothing(diagnosis, seen)
    if diagnosis.verdict == "unknown" and diagnosis.unknown is not None:
        return f"{seen}{diagnosis.unknown.sentence} {OFFER}"
    named = {one.effect: one for one in diagnosis.candidates}
    first = named[diagnosis.family[0]]
    if diagnosis.verdict == "effect":
        return f"{seen}Most likely cause: {_told(first)}."
    return seen + _family(diagnosis, first)


def _family(diagnosis: Diagnosis, first: Candidate) -> str:
    """Say what remains of several effects, or of one that is not sure."""
    doubts = {one.effect: one.doubt for one in diagnosis.candidates if one.doubt}
    # What is doubted explains nothing, unless all that is left is doubted.
    credible = [name for name in diagnosis.family if name not in doubts] or diagnosis.family
    shares = (one.explained for one in diagnosis.candidates if one.in_family and one.effect in credible)
    most = max(shares, default=math.nan)
    better = f" {diagnosis.unknown.sentence} {OFFER}" if diagnosis.unknown else ""
    if most <= criteria.STEPS_SHARE and not diagnosis.together:
        least = listed(credible, "or")
        return f"No effect explains most of the misfit: {least} explains at most {most:.0%}.{better}"
    told = _told(first)
    named = {name: f"{name} ({doubts[name]})" if name in doubts else name for name in diagnosis.family[1:]}
    doubtful = [name for name in named if name in doubts and first.effect not in doubts]
    others = [text for name, text in named.items() if name not in doubtful]
    if doubtful:
        alone = " alone" * bool(diagnosis.together)
        better = f" Not credible{alone}: {listed([named[name] for name in doubtful])}.{better}"
    if diagnosis.together:
        worse = hardly_explain(diagnosis.candidates)
        single = {first.effect: told, **{name: named[name] for name in named if name not in doubtful}}
        single = {name: text for name, text in single.items() if name not in worse}
        return _together(diagnosis, told, [*single.values()], better)
    if others:
        return f"Possible causes: {listed([told, *others], 'or')}; these data cannot tell which.{better}"
    if doubtful:
        return f"Probable cause: {told}.{better}"
    blocks = diagnosis.comparison.blocks
    doubt = (
        f"{too_few(blocks)} to be sure"
        if blocks < comparison_criteria.FEWEST_BLOCKS
        else "another effect may be missing too, or this drive does not rule out all others"
    )
    return f"Probable cause: {told}, but {doubt}.{better}"


def _together(diagnosis: Diagnosis, told: str, alone: Sequence[str], doubtful: str) -> str:
    """Say what two effects explain, and which does anything `alone`; `told` is of the best single one."""
    if diagnosis.family[0] == STRESSES == diagnosis.together[0]:
        both = (
            f"{told} together with {listed(diagnosis.family[1:], 'or')} explain more than any effect alone."
        )
        return f"{both[0].upper()}{both[1:]}"
    both = listed(diagnosis.together)
    both = f"{both[0].upper()}{both[1:]} together explain more than any effect alone."
    if diagnosis.together_or:
        pairs = listed([" with ".join(pair) for pair in diagnosis.together_or], "or")
        both += f" Nearly as good: {pairs}. These data cannot tell which."
    if {*diagnosis.together} == {*diagnosis.family}:
        return both
    are = "s are" if len(alone) > 1 else " is"
    single = f" The best single effect{are} {listed(alone)}." if alone else ""
    return f"{both}{single}{doubtful}"


def _nothing(diagnosis: Diagnosis, seen: str) -> str:
    """Say that no effect shows, whatever is seen; of too few data, by how much the model is off."""
    blocks = diagnosis.comparison.blocks
    off = [
        f"{one.name.replace('_', ' ')} by {one.nrmse:.0%}"
        for one in diagnosis.comparison.channels.values()
        if not math.isfinite(one.noise) and one.nrmse > criteria.LARGE_ERROR
    ]
    if off and blocks < comparison_criteria.FEWEST_BLOCKS:
        table = "; the table shows what each effect would leave"
        table *= any(one.refitted for one in diagnosis.candidates)
        return f"The model misses {listed(off)} of its size, but {too_few(blocks)} to prove it{table}."
    if blocks < criteria.BLOCKS_OF_ALARM:
        return f"{too_few(blocks)} to tell whether the model misses something."
    if seen or above_noise(over_noise(diagnosis.comparison)):
        return f"{seen}No effect explains the misfit."
    if diagnosis.comparison.impossible:
        return "The fitted soil is physically impossible, and no effect explains it."
    if diagnosis.alarm.idle:
        cause = diagnosis.alarm.cause
        return f"The residuals look like {cause}, and not by chance, but no held-out error falls with it."
    few = blocks < comparison_criteria.FEWEST_BLOCKS
    doubt = f"No effect shows, but {too_few(blocks)} to rule one out."
    return doubt if few else "The data show no missing effect."


def with_draft(sentence: str, path: str) -> str:
    """Say where the law of a verdict is, once it was written."""
    return sentence.replace(OFFER, f"The law is in {path}.")


def _seen(diagnosis: Diagnosis, failures: Sequence[Finding], changed: Collection[str]) -> str:
    """Say where the model fails, in a channel where who looks at it finds it.

    The soil that is fitted spreads a misfit: what is wrong in one channel may be explained best by
    something in another, of a size that nobody measured there.
    """
    if not failures:
        return ""
    first = failures[0]
    ratios = {
        name: errors.heldout_rmse / errors.noise
        for name, errors in diagnosis.comparison.channels.items()
        if errors.noise > 0.0
    }
    most = max(ratios, key=lambda name: ratios[name], default="")
    if first.channel in changed or ratios.get(most, 0.0) < comparison_criteria.ABOVE_NOISE:
        told = [first]
    else:
        least = 1.0 + criteria.STANDS_OUT * (ratios[most] - 1.0)
        there = [one for one in failures if ratios.get(one.channel, math.inf) >= least]
        told = [one for one in there if one is first or one.share >= criteria.TOLD]
    if told:
        sentence = told[0].sentence
    else:
        sentence = missed(most, diagnosis.comparison.channels[most].heldout_rmse, ratios[most])
    return f"{sentence[0].upper()}{sentence[1:]}. "


def _told(one: Candidate) -> str:
    told = "; ".join(filter(None, [sizes_text(one, " = "), one.doubt]))
    return f"{one.effect} ({told})" if told else one.effect


def sizes_text(one: Candidate, sign: str = " ") -> str:
    """Write the parameters of a candidate, as far as the data tell them."""
    known = {name: size for name, size in one.sizes.items() if math.isfinite(size.value)}
    if one.sizes and not known:
        return f"{listed(list(one.sizes))} not determined"
    # What doubts an effect as a whole stands behind all of them.
    ends = {name: " at its bound" * (size.bounded and not one.doubt) for name, size in known.items()}
    return ", ".join(f"{name}{_text(size, sign)}{ends[name]}" for name, size in known.items())


def _text(size: Size, sign: str) -> str:
    unit = "" if size.unit in ("", "1") else f" {size.unit}"
    if size.wheels:
        each = [f"{wheel} {_plus_minus(*pair)}" for wheel, *pair in size.wheels]
        return f" differs between wheels: {listed(each)}{unit}"
    return f"{sign}{_plus_minus(size.value, size.se)}{unit}"


def _plus_minus(value: float, se: float) -> str:
    return f"{short(value)} ± {short(se, 2)}" if se == se else short(value)  # noqa: PLR0124 - NaN
