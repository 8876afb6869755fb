"""What is known of a model on some data, whichever verb found it out."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Self

from terrain_cli.comparison import Comparison, Finding, comparison_criteria
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis.diagnosis_outcome import (
    Candidate,
    Diagnosis,
    Verdict,
    above_noise,
    beyond_chance,
    leaves_much,
    noise_with,
    over_noise,
)
from terrain_cli.mechanics.effect import CERTAIN, Effect, Parameter
from terrain_cli.vocabulary.quantities import listed, short

#: Effects that change torque and sinkage much as another soil does.
_LIKE_A_SOIL = {
    "drivetrain-friction": "friction in the drive, a wrong zero of the torque",
    "gear-efficiency": "a wrong gain of the torque",
    "load-bias": "a wrong zero or gain of the load",
}


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What is known of a model on some data."""

    # Channel → held-out error over its noise; NaN where the noise is not known
    ratios: Mapping[str, float]
    blocks: int  # Independent stretches of data
    effects: tuple[str, ...] = ()  # Of the model
    raised: bool  # What is left is not random: by findings, by the scores of effects, or by a diagnosis
    tracked: bool = False  # By findings: it varies with what was recorded
    # By the strongest finding: beginning and end, in s, of a stretch that differs from all others
    stretch: tuple[float, float] | None = None
    doubted: tuple[str, ...] = ()  # Signs and units of channels that are improbable
    at_limit: tuple[str, ...] = ()  # Conditions of samples whose sensor is neither stuck nor at its limit
    verdict: Verdict | None = None  # Of a diagnosis; None where there was none
    family: tuple[str, ...] = ()  # Effects that explain what is left, the best first
    share: float = math.nan  # Of the misfit, that any of them, or else a law, explains at the most
    leaves: bool = False  # The best of them leaves much of an error, beyond the noise
    closest: str = ""  # Where the alarm is silent: an effect that explains most, by chance or not
    together: tuple[str, ...] = ()  # Two that belong together
    together_or: tuple[tuple[str, ...], ...] = ()  # Other pairs that explain nearly as much
    law: str = ""  # What follows which driver, where no effect explains what is left
    draft: str = ""  # File of that law, if it was written
    refused: tuple[str, ...] = ()  # Effects that were tried, and did not pay on held-out data
    unconfirmed: bool = False  # They did on these data, but another drive does not confirm it
    ended: bool = False  # --until-quiet found nothing more to add
    unrecorded: tuple[str, ...] = ()  # Channels that effects need, and nothing gives
    small: str = ""  # What chance does not explain, but is too small for an alarm, and how large it is
    drive: str = ""  # What would tell the best of the family from another, as a command to a person
    checks: tuple[str, ...] = ()  # Of sensors, where no drive tells the best of the family from another
    points: bool = False  # The data are steady test points, not drives
    unsorted: bool = False  # Rows of a table are not in the order of time
    soils: int = 0  # Of the comparison, of all wheels
    wheels: int = 1
    changes: tuple[str, ...] = ()  # Where one of these ends and another begins, though no label says so
    needed: bool = False  # No effect on fewer soils predicts as well
    instead: str = ""  # By a first check: what on fewer soils predicts as well
    #: Soils on which the ratios are, where the comparison has more and these stand for an effect.
    fewer: int = 0
    better: bool = False  # These more soils leave less than the best effect
    impossible: tuple[str, ...] = ()  # Properties of the fitted soil that no soil has, in words
    # Effects of the model that stand where nature has none, or as far as they can go, and how, in words
    beyond: Mapping[str, str] = field(default_factory=dict)
    # Effects of the model that the fit takes out: they are at a bound that is their null
    absent: tuple[str, ...] = ()
    # What chance does not explain, though it lowers no held-out error: an effect, and how often
    weak: str = ""
    noise_with: str = ""  # Channels of which the noise is that with an effect, and which one

    @classmethod
    def of_comparison(cls, comparison: Comparison, refused: tuple[str, ...] = ()) -> Self:
        """Collect what a comparison tells: its errors, its findings, and the scores of effects."""
        scores = comparison.scores() if comparison.scores else None
        tracked = any(_large(comparison, one) for one in comparison.failures)
        return cls(
            **_of_both(comparison, refused),
            ratios=over_noise(comparison),
            raised=tracked or (scores is not None and scores.raised),
            tracked=tracked,
            doubted=_doubted(comparison, settled=bool(scores and scores.settles)),
            unrecorded=scores.unrecorded if scores else (),
            needed=scores is not None and scores.instead is None,
            instead=scores.instead or "" if scores else "",
            weak=_weak(scores.effects[0], scores.p_value) if scores and scores.idle else "",
        )

    @classmethod
    def of_diagnosis(cls, found: Diagnosis, draft: str = "", refused: tuple[str, ...] = ()) -> Self:
        """Collect what a diagnosis tells."""
        law = found.unknown if found.verdict == "unknown" else None
        # What is doubted explains nothing, unless all that is left is doubted.
        doubted = {one.effect for one in found.candidates if one.doubt}
        family = tuple(name for name in found.family if name not in doubted) or found.family
        first = next((one for one in found.candidates if one.effect in family[:1]), None)
        credible = [one for one in found.candidates if not one.doubt]
        # Where several soils stand for an effect, it takes nothing off their errors.
        fewer = found.soils < found.comparison.soil_count
        several = over_noise(found.comparison)
        fits = not above_noise(several)
        alike = not fits and first is not None and _as_good(several, first, found.comparison)
        hidden = found.alarm.raised and fewer and (fits or alike)
        errors = found.heldout if hidden else {}
        best = found.pair or first
        noise = noise_with(found.comparison, best.noise if best is not None else {}, errors)
        ratios = over_noise(found.comparison, errors, noise)
        passed = [name for name, one in found.comparison.channels.items() if noise[name] < one.noise]
        passed = [name for name in (one.replace("_", " ") for one in passed) if name in above_noise(ratios)]
        leaves = first is not None and leaves_much(found.comparison, found.heldout, first)
        settled = first is not None and first.settles and not leaves
        # A score says of a large misfit what an effect would take off it, were that small.
        fitted = [one for one in credible if one.refitted] or credible
        likely = [one for one in fitted if one.explained > criteria.STEPS_SHARE]
        taken = [one.explained for one in found.candidates if one.effect in family]
        taken += [found.pair.explained] if found.pair else []
        # Nor is a drive worth while that only tells what explains it from what does not.
        drives = [one for one in found.next_drive if doubted.isdisjoint(one.pair) or family == found.family]
        return cls(
            **_of_both(found.comparison, refused),
            ratios=ratios,
            noise_with=f"{listed(passed)} as estimated with {best.effect}" if best and passed else "",
            raised=found.alarm.raised,
            tracked=any(_large(found.comparison, one) for one in found.comparison.failures),
            doubted=_doubted(found.comparison, settled=settled),
            verdict=found.verdict,
            family=family,
            share=max(taken, default=law.explained if law and not law.begins else math.nan),
            leaves=leaves,
            closest=max(likely, key=lambda one: one.explained).effect if likely else "",
            together=found.together,
            together_or=found.together_or,
            law=law.law if law else "",
            draft=draft if law else "",
            unrecorded=found.unrecorded,
            small=found.alarm.size if found.alarm.small else "",
            drive=next((one.manoeuvre for one in drives if one.settings), ""),
            # Of a pair it may be several.
            checks=tuple(dict.fromkeys(o for one in drives for o in one.check.split(" or ") if o)),
            needed=not fewer,
            fewer=found.soils if hidden else 0,
            better=leaves and not alike,
            weak=_weak(found.alarm.cause, found.alarm.p_value) if found.alarm.idle else "",
        )

    @property
    def above(self) -> dict[str, float]:
        """The ratios that are more than those of noise, and of test points than chance gives."""
        return beyond_chance(self.ratios, self.blocks, points=self.points)

    @property
    def vain(self) -> bool:
        """Whether a diagnosis names only what takes nothing off the errors: as printed, 0 %."""
        return self.verdict == "family" and not self.together and self.share < 0.005

    @property
    def misses(self) -> bool:
        """Whether an error is larger than noise."""
        return bool(self.above)

    @property
    def like_a_soil(self) -> list[str]:
        """Which errors that the model does not have the soil takes up nearly whole, without drawbar pull."""
        if "torque" not in self.ratios or "drawbar pull" in self.ratios:
            return []
        return [what for effect, what in _LIKE_A_SOIL.items() if effect not in self.effects]

    @property
    def fit_beside_pull(self) -> list[str]:
        """The other channels, where the drawbar pull alone is missed.

        Of a misfit that they share in part, as where a torque is cut off, the pull may only show most.
        """
        most = criteria.DRAFT_LEFT * (self.ratios.get("drawbar pull", math.nan) - 1.0)
        others = {name: ratio for name, ratio in self.ratios.items() if name != "drawbar pull"}
        alone = [*self.above] == ["drawbar pull"]
        alone = alone and all(ratio - 1.0 <= most for ratio in others.values())
        return [*others] if alone else []


def _of_both(comparison: Comparison, refused: tuple[str, ...]) -> dict[str, Any]:
    """Return what a comparison tells, diagnosed or not."""
    return {
        "effects": tuple(comparison.model["effects"]),
        "blocks": comparison.blocks,
        "stretch": comparison.stretch,
        "refused": tuple(dict.fromkeys((*comparison.refused.names, *refused))),
        "ended": comparison.refused.ended,
        "points": comparison.points,
        "at_limit": comparison.at_limit,
        "unsorted": comparison.unsorted,
        "soils": comparison.soil_count,
        "wheels": len(comparison.wheels),
        "changes": tuple(comparison.soil_changes),
        "impossible": comparison.impossible,
        "beyond": _beyond(comparison),
        "absent": _absent(comparison),
    }


def _as_good(ratios: Mapping[str, float], one: Candidate, comparison: Comparison) -> bool:
    """Tell whether an effect leaves as large errors as the comparison has, in every channel."""
    left = over_noise(comparison, one.heldout)
    return all(
        max(left[name], ratio) <= comparison_criteria.ABOVE_NOISE * min(left[name], ratio)
        for name, ratio in ratios.items()
        if math.isfinite(ratio)
    )


def _doubted(comparison: Comparison, *, settled: bool) -> tuple[str, ...]:
    """Return what is doubted; if `settled` no more of how torque and pull change together."""
    of_pull = ("torque", "drawbar pull", "motor current")
    return tuple(one for one in comparison.doubted if not (settled and one.endswith(of_pull)))


def _large(comparison: Comparison, finding: Finding) -> bool:
    """Tell whether a finding is, from end to end, a share of its channel that is worth an alarm."""
    errors = comparison.channels[finding.channel]
    size = errors.rmse / errors.nrmse if errors.nrmse > 0.0 else 0.0
    return not abs(finding.amplitude) < criteria.SMALLEST_SHARE * size


def _weak(cause: str, p_value: float) -> str:
    return f"{cause} (p {p_value:.2g})"


def _beyond(comparison: Comparison) -> dict[str, str]:
    """Say which effects of the model stand for something else, by where their parameters are."""
    found = {
        effect.id: f"{effect.qualified(own)} = {_size(own, value)}, which is its bound"
        for effect, own, value in _bounded(comparison)
        if not own.at_null(value)
    }
    every = comparison.wheels[0].model.effects if comparison.model["effects"] else ()
    for effect in (one for one in every if not one.made_up_by(every)):
        for _, names, value, _ in effect.imitations(comparison.limited(), CERTAIN, criteria.DRAFT_LEFT):
            own = next(one for one in effect.parameters if effect.qualified(one) == names[0])
            found[effect.id] = f"{' + '.join(names)} = {_size(own, value)}, which is physically impossible"
    return found


def _absent(comparison: Comparison) -> tuple[str, ...]:
    """Name the effects of the model that do nothing under any wheel, at a bound."""
    there = [effect.id for effect, own, value in _bounded(comparison) if own.at_null(value)]
    return tuple(name for name in dict.fromkeys(there) if there.count(name) == len(comparison.wheels))


def _bounded(comparison: Comparison) -> Iterator[tuple[Effect, Parameter, float]]:
    """Yield the parameters at a bound, under each wheel, of those that do not just shape an effect."""
    for wheel in comparison.wheels if comparison.model["effects"] else ():
        fit = wheel.fit
        for effect in wheel.model.effects:
            for parameter in effect.parameters:
                own, name = parameter.under(*fit.under), effect.qualified(parameter)
                sought = name in fit.shared and name in fit.undetermined
                if sought and not own.shape and own.at_bound(fit.shared[name]):
                    yield effect, own, fit.shared[name]


def _size(own: Parameter, value: float) -> str:
    return f"{short(value / own.factor)}{f' {own.unit}' * (own.unit != '1')}"
