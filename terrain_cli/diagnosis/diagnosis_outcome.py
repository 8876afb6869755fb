"""The result of a diagnosis."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Mapping

    from terrain_cli.comparison import Comparison
    from terrain_cli.effects import Effect
    from terrain_cli.mechanics.effect import Parameter
    from terrain_cli.mechanics.prior import Prior
    from terrain_cli.mechanics.wheel_model import Model

Verdict = Literal["none", "effect", "family", "unknown"]


@dataclass(frozen=True, kw_only=True)
class Hypothesis:
    """Something that the model may lack, and the model that has it.

    Parameters
    ----------
    fixed : mapping of str to float
        Parameters held in it, in SI units.
    effects : tuple of Effect
        That it adds; none where an assumption of the base is lifted instead.
    others : tuple of Hypothesis
        Other ways to lift an assumption.
    """

    id: str
    title: str
    model: Model
    fixed: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, Prior] = field(default_factory=dict)
    effects: tuple[Effect, ...] = ()
    others: tuple[Hypothesis, ...] = ()

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
    def free(self) -> int:
        """Number of parameters that come with it."""
        return sum(name not in self.fixed for name in (self.parameters or self.priors))


class Size(NamedTuple):
    """A parameter of an effect, as the data have it.

    Parameters
    ----------
    value, se : float
        In `unit`; NaN where the data do not tell.
    unit : str
        In which a person reads it.
    """

    value: float
    se: float
    unit: str


@dataclass(frozen=True)
class Alarm:
    """Whether anything is missing at all.

    Parameters
    ----------
    p_value : float
        How often chance gives a score as strong for any candidate, or any channel and driver.
    level : float
        Below which it is raised, if the held-out error agrees.
    gain, gain_se : float
        What the strongest candidate takes off the held-out loss, in units of the noise's variance,
        summed over all blocks; and its standard error.
    """

    raised: bool
    p_value: float
    level: float
    gain: float
    gain_se: float


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """An effect that may be what is missing.

    Parameters
    ----------
    effect, title : str
        Its id, and what it is called.
    score : float
        Largest |t| of its parameters' scores, without a refit.
    p_value : float
        How often chance gives such a score for any candidate.
    surviving : float
        Share of the square of its signature that is left when the soil is fitted anew.
    explained : float
        Part of the misfit beyond noise that it accounts for when all is fitted together; NaN where
        there is none.
    loss : float
        Held-out loss relative to that of the model without it: mean over samples, in units of the
        noise's variance; negative is better.
    heldout : dict of str to float
        Channel → root mean square of the held-out error with it, SI.
    sizes : dict of str to Size
        Its parameters.
    refitted : bool
        Whether it was fitted together with everything else; else all is to first order.
    """

    effect: str
    title: str
    score: float
    p_value: float
    surviving: float
    explained: float
    loss: float
    loss_se: float
    heldout: dict[str, float]
    sizes: dict[str, Size]
    refitted: bool
    in_family: bool = False


@dataclass(frozen=True, kw_only=True)
class UnknownEffect:
    """What no effect of the catalogue explains.

    Parameters
    ----------
    channel, driver : str
        `driver` is empty where it follows none.
    form : str
        Shape in which it follows: "linear", "saturating", "step", …
    explained : float
        Part of the misfit beyond noise.
    draft : str
        A TOML file of an effect that `model add` takes.
    """

    channel: str
    driver: str
    form: str
    explained: float
    sentence: str
    draft: str


@dataclass(frozen=True)
class NextDrive:
    """A drive that tells two effects apart.

    Parameters
    ----------
    manoeuvre : str
        For a person: what to drive.
    power : float
        Probability that it names the right one of the two, were it driven for as long as said.
    settings : dict
        The same for the program: what `terrain-est simulate` takes, as far as it can be said so.
    """

    pair: tuple[str, str]
    manoeuvre: str
    power: float
    settings: dict[str, Any] = field(default_factory=dict)


class NotTestable(NamedTuple):
    """An effect of which these data can say nothing."""

    effect: str
    because: str


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """What a model lacks, as far as the data can tell.

    Parameters
    ----------
    comparison : Comparison
        Of the model as it is.
    verdict : {"none", "effect", "family", "unknown"}
    effect : str or None
        One name, only where the data support one.
    family : tuple of str
        Those that the data cannot tell apart, the best first.
    candidates : list of Candidate
        The best first.
    sentence : str
        The verdict for a person.
    together : tuple of str
        Two effects that, both added, predict better than any alone, and than any draft; else none.
    fitted, heldout : dict of str to float
        Channel → root mean square of the error of the model as it is, SI: fitted, and held out. Found as
        those of the candidates are.
    """

    comparison: Comparison
    alarm: Alarm
    verdict: Verdict
    effect: str | None
    family: tuple[str, ...]
    candidates: list[Candidate]
    unknown: UnknownEffect | None
    next_drive: list[NextDrive]
    not_testable: list[NotTestable]
    warnings: list[str]
    sentence: str
    together: tuple[str, ...] = ()
    fitted: Mapping[str, float] = field(default_factory=dict)
    heldout: Mapping[str, float] = field(default_factory=dict)
