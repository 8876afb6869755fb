"""The result of a diagnosis."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple

from terrain_cli.comparison import Comparison, comparison_criteria
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.effects import Effect
from terrain_cli.mechanics.effect import Parameter, Prior
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.quantities import counted

Verdict = Literal["none", "effect", "family", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Something that the model may lack, and the model that has it."""

    id: str
    title: str
    model: Model
    fixed: Mapping[str, float] = field(default_factory=dict)  # Parameters held in it, in SI units
    priors: Mapping[str, Prior] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()  # That it adds; none where an assumption of the base is lifted instead
    others: tuple[Hypothesis, ...] = ()  # Other ways to lift an assumption

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Parameters of what it adds, by their qualified names."""
        return {effect.qualified(p): p for effect in self.effects for p in effect.parameters}

    @property
    def forms(self) -> tuple[Hypothesis, ...]:
        """The same with each form in which the law of an effect is written, or an assumption is lifted."""
        if len(self.effects) != 1:
            return (self, *self.others)
        (own,) = self.effects
        kept = self.model.effects[: -len(self.effects)]
        return tuple(
            replace(self, model=replace(self.model, effects=(*kept, form)), effects=(form,))
            for form in own.forms
        )

    @property
    def scored(self) -> bool:
        """Whether a score tells what it gains.

        An assumption has no signature. What is late follows no rate where the inputs change faster than that.
        """
        return bool(self.effects) and not self.late

    @property
    def late(self) -> bool:
        """Whether what is predicted follows what was predicted before."""
        return any(effect.remembers for effect in self.effects)

    @property
    def free(self) -> int:
        """Number of parameters that come with it."""
        return sum(name not in self.fixed for name in (self.parameters or self.priors))


class Size(NamedTuple):
    """A parameter of an effect, as the data have it."""

    # value, se: in `unit`; NaN where the data do not tell
    value: float
    se: float
    unit: str
    # Each wheel with its value and standard error, where they differ by more than their errors: then the
    # above are those of no wheel
    wheels: tuple[tuple[str, float, float], ...] = ()
    bounded: bool = False  # It ran to the end of what it can be, under some wheel


@dataclass(frozen=True, kw_only=True)
class Alarm:
    """Whether anything is missing at all."""

    raised: bool
    p_value: float  # How often chance gives a score as strong for any candidate, or any channel and driver
    level: float  # Below which it is raised, if the held-out error agrees
    # gain, gain_se: what the strongest candidate takes off the held-out loss, in units of the noise's
    # variance, summed over all blocks; and its standard error
    gain: float = 0.0
    gain_se: float = 0.0
    # cause: what predicts best; share: its size in `channel`, where that is largest, over the root mean
    # square of the channel; NaN where nothing was fitted
    cause: str = ""
    channel: str = ""
    share: float = math.nan
    smallest_share: float = 0.0  # Below which no alarm is raised

    @property
    def small(self) -> bool:
        """Whether chance does not explain it, but it is too small for an alarm."""
        return self.p_value < self.level and 0.0 < self.share < self.smallest_share

    @property
    def idle(self) -> bool:
        """Whether chance does not explain it, and yet it lowers no held-out error."""
        return self.p_value < self.level and self.share == 0.0

    @property
    def size(self) -> str:
        """Say what it is, and how large."""
        channel = self.channel.replace("_", " ")
        return f"{self.cause} is only {100 * self.share:.2g} % of the {channel}'s root mean square"


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect that may be what is missing."""

    # effect, title: its id, and what it is called
    effect: str
    title: str
    # Without a refit, NaN of a pair: largest |t| of its parameters' scores; how often chance gives such a
    # score for any candidate; share of the square of its signature that is left when the soil is fitted anew
    score: float = math.nan
    p_value: float = math.nan
    surviving: float = math.nan
    # Part of the misfit beyond noise that it accounts for when all is fitted together; NaN where there is
    # none
    explained: float
    # Held-out loss relative to that of the model without it: mean over samples, in units of the noise's
    # variance; negative is better
    loss: float = math.nan
    loss_se: float = math.nan
    # Channel → root mean square of the held-out error with it, SI; of the first
    heldout: dict[str, float]
    sizes: Mapping[str, Size] = field(default_factory=dict)
    refitted: bool  # Whether it was fitted together with everything else; else all is to first order
    # Channel → noise of what it leaves, SI, of the first: of a worse model, a misfit may pass for noise
    noise: Mapping[str, float] = field(default_factory=dict)
    in_family: bool = False
    doubt: str = ""  # Why its size is not to be believed
    settles: bool = False  # Without it torque and pull change alike; as measured, they do not


@dataclass(frozen=True, kw_only=True)
class UnknownEffect:
    """What no effect of the catalogue explains."""

    # channel, driver: `driver` is empty where it follows none
    channel: str
    driver: str
    form: str  # Shape in which it follows: "linear", "saturating", "step", …
    explained: float  # Part of the misfit beyond noise
    law: str  # What is off, and what it follows, in words
    sentence: str
    draft: str  # A TOML file of an effect that `model add` takes
    alternatives: tuple[str, ...] = ()  # Drivers of which this one is a function

    @property
    def begins(self) -> bool:
        """Whether it is that something began at some time, and stays."""
        return (self.driver, self.form) == ("time", "step")


@dataclass(frozen=True)
class NextDrive:
    """A drive that tells two effects apart."""

    pair: tuple[str, str]
    manoeuvre: str  # For a person: what to drive
    power: float  # Probability that it settles which of the two it is, driven for as long as said
    # The same for the program: what `terrain-est simulate` takes, as far as it can be said so
    settings: dict[str, Any] = field(default_factory=dict)
    check: str = ""  # Of a sensor, where no drive tells; a command to a person


class NotTestable(NamedTuple):
    """An effect of which these data can say nothing."""

    effect: str
    because: str


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What a model lacks, as far as the data can tell."""

    comparison: Comparison  # Of the model as it is
    alarm: Alarm
    verdict: Verdict
    effect: str | None = None  # One name, only where the data support one
    family: tuple[str, ...] = ()  # Those that the data cannot tell apart, the best first
    candidates: list[Candidate]  # The best first
    unknown: UnknownEffect | None = None
    next_drive: list[NextDrive] = field(default_factory=list)
    not_testable: list[NotTestable]
    warnings: list[str]
    sentence: str = ""
    # Two effects that, both added, predict better than any alone, and than any draft; else none
    together: tuple[str, ...] = ()
    together_or: tuple[tuple[str, ...], ...] = ()  # Other pairs that explain nearly as much
    pair: Candidate | None = None  # The two, both added
    unrecorded: tuple[str, ...] = ()  # Channels that effects need, and nothing gives
    # Channel → held-out error of the model as it is on the soils on which the candidates were fitted, where
    # they are others than those of `comparison`
    heldout: Mapping[str, float] = field(default_factory=dict)
    soils: int = 0  # On which effects were looked for: those of `comparison`, or fewer


def noise_with(
    comparison: Comparison, better: Mapping[str, float], errors: Mapping[str, float]
) -> dict[str, float]:
    """Return the noise by channel: `better`, that with another model, where a misfit has passed for noise.

    `errors` are those of the model as it is, where they are not those of the comparison.
    """
    noise = {}
    for name, one in comparison.channels.items():
        fits = not errors.get(name, one.heldout_rmse) > comparison_criteria.ABOVE_NOISE * one.noise
        less = one.noise > comparison_criteria.ABOVE_NOISE * better.get(name, math.nan)
        noise[name] = better[name] if fits and less else one.noise
    return noise


def over_noise(
    comparison: Comparison,
    errors: Mapping[str, float] | None = None,
    noise: Mapping[str, float] | None = None,
) -> dict[str, float]:
    """Return held-out errors over the noise; `errors` and `noise` are those of another model, by channel."""
    ratios = {}
    for name, one in comparison.channels.items():
        level = (noise or {}).get(name, one.noise)
        error = (errors or {}).get(name, one.heldout_rmse)
        ratios[name.replace("_", " ")] = error / level if level > 0.0 else math.nan
    return ratios


def share_taken(
    comparison: Comparison,
    before: Mapping[str, float],
    after: Mapping[str, float],
    noise: Mapping[str, float] | None = None,
) -> float:
    """Return the part of the held-out errors beyond the noise that a model takes off.

    `before` are the errors of the model as it is, where they are not those of the comparison. Squares are in
    units of what that leaves in each channel: what is missing may stand out of the noise most in another one
    than that which an effect mends. NaN where neither model has an error that is more than noise, or the
    noise is not known.
    """
    first, last = (over_noise(comparison, errors, noise) for errors in (before, after))
    above = above_noise(first)
    if not after or not above:
        # What leaves more than noise where there was none explains nothing.
        return 0.0 if after and above_noise(last) else math.nan
    # What fits before and after differs by chance alone.
    compared = [name for name in first if name in above or name in above_noise(last)]
    units = {name: max(first[name], 1.0) ** 2 for name in compared}
    beyond = [sum(max(each[n] ** 2 - 1.0, 0.0) / units[n] for n in compared) for each in (first, last)]
    return max(1.0 - beyond[1] / beyond[0], 0.0)


def hardly_explain(candidates: Sequence[Candidate]) -> set[str]:
    """Name the candidates that explain far less than the best of the family does."""
    most = max((one.explained for one in candidates if one.in_family), default=0.0)
    return {one.effect for one in candidates if one.explained <= criteria.RIVAL_WORTH * most}


def leaves_much(comparison: Comparison, before: Mapping[str, float], first: Candidate) -> bool:
    """Tell whether an effect leaves more than noise, by much of what the model as it is leaves.

    `before` is as for `share_taken`. The noise is that with the effect, as once it is in the model.
    """
    noise = {name: first.noise.get(name, one.noise) for name, one in comparison.channels.items()}
    missed, left = (over_noise(comparison, errors, noise) for errors in (before, first.heldout))
    above = beyond_chance(left, comparison.blocks, points=comparison.points).items()
    return any(ratio - 1.0 > criteria.DRAFT_LEFT * (missed[name] - 1.0) for name, ratio in above)


def above_noise(ratios: Mapping[str, float]) -> dict[str, float]:
    """Return the ratios that are more than those of noise."""
    return {name: ratio for name, ratio in ratios.items() if ratio > comparison_criteria.ABOVE_NOISE}


def beyond_chance(ratios: Mapping[str, float], blocks: int, *, points: bool) -> dict[str, float]:
    """Return the ratios that are more than those of noise, and of test points than chance gives."""
    # B pairs of points tell an error with a relative variance of 1/(4 B), and their noise with 1/(2 B).
    chance = math.exp(criteria.BETTER * math.sqrt(0.75 / max(blocks, 1))) if points else 1.0
    return above_noise({name: ratio for name, ratio in ratios.items() if ratio > chance})


def too_few(blocks: int) -> str:
    """Say that so many blocks are too few for what is named after it."""
    return f"{counted(blocks, 'independent stretch', 'es')} of data {'is' if blocks == 1 else 'are'} too few"
