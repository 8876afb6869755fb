"""The result of a change of a model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from terrain_cli.comparison import Comparison, comparison_criteria
from terrain_cli.comparison.blocks import Interval
from terrain_cli.diagnosis import diagnosis_criteria
from terrain_cli.diagnosis.diagnosis_outcome import NextDrive
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.improvement import improvement_criteria as criteria
from terrain_cli.models import ModelFile

Action = Literal["add", "remove"]
Proof = Literal["same data", "stretches kept aside", "another drive"]


@dataclass(frozen=True, kw_only=True)
class ChannelChange:
    """The held-out error of a channel, before and after; SI."""

    name: str
    unit: str
    # before, after: root mean square; NaN where the model does not predict the channel
    before: Interval
    after: Interval
    noise: float  # What no model could predict
    difference: Interval  # After less before, on the same blocks

    @property
    def fell(self) -> bool:
        """Whether the error is less than before, beyond chance and by more than it takes to count."""
        return self.difference.high < 0.0 and self.share > criteria.LEAST_CHANGE

    @property
    def rose(self) -> bool:
        """Whether it is more than before, likewise."""
        return self.difference.low > 0.0 and self.share > criteria.LEAST_CHANGE

    @property
    def certainty(self) -> float:
        """How many times its 95 % interval reaches from 0."""
        value, low, high = self.difference
        return abs(value) / max(high - value, value - low)

    @property
    def misses(self) -> bool:
        """Whether the greater error is more than noise.

        Where it is not, the lesser one comes of a soil that passes less of the noise on, and is no better.
        """
        return not max(self.before.value, self.after.value) <= criteria.NOISE * self.noise

    @property
    def share(self) -> float:
        """By which share of the lesser error the greater one exceeds it."""
        return abs(self.difference.value) / min(self.before.value, self.after.value)


@dataclass(frozen=True, kw_only=True)
class Estimated:
    """A parameter of an effect under one wheel, in the unit of the model file."""

    source: str
    wheel: str
    name: str
    value: float
    se: float
    unit: str
    determined: bool  # By the data, rather than by what was known beforehand
    remark: str = ""  # Why its value is to be doubted


@dataclass(frozen=True)
class Shift:
    """How far c or φ moved, over all segments, in standard errors."""

    name: str  # "c" or "phi"
    # largest, median: NaN where neither model determines it
    largest: float
    median: float
    where: tuple[str, str, int] | None  # Source, wheel and segment (counted from 1) of the largest


class Idle(NamedTuple):
    """An effect that a model had before a change, and that may as well be absent now."""

    effect: str
    p_value: float  # Chance that its parameters are as far from their null values although it is absent


class Lost(NamedTuple):
    """A segment whose c and φ could be estimated before, and cannot be any more."""

    source: str
    wheel: str
    segment: int  # Counted from 1
    # before, after: status
    before: str
    after: str


@dataclass(frozen=True)
class HeldOutEvidence:
    """What held-out blocks say of two models."""

    # Ratio of the held-out error after to that before, over all channels: geometric mean, weighted by samples
    overall: Interval
    blocks: int  # Independent stretches that it rests on
    lost: float  # Share of the samples predicted before that cannot be predicted afterwards
    aside: int = 0  # Samples kept aside, on which alone it rests; 0 where it rests on all
    too_short: bool = False  # Whether an input is too short for stretches that were to be kept aside


@dataclass(frozen=True, kw_only=True)
class Step:
    """A change of a model, tried on data."""

    action: Action
    changed: tuple[str, ...]  # Ids of effects, or of assumptions that are lifted or made again
    before: ModelFile
    after: ModelFile
    # first, second: of the model before and after, on the same blocks
    first: Comparison
    second: Comparison
    # compared_before, compared_after: each on blocks of its own, as `compare` has them
    compared_before: Comparison
    compared_after: Comparison
    channels: list[ChannelChange]
    evidence: HeldOutEvidence
    parameters: list[Estimated] = field(default_factory=list)  # Of what is changed, where the model has it
    shifts: list[Shift] = field(default_factory=list)  # Of c, then of φ
    # Parameters that the data determined before, or are new, and that they leave open afterwards
    undetermined: tuple[str, ...] = ()
    lost: list[Lost] = field(default_factory=list)
    sources: tuple[str, ...] = ()
    # Chance that its parameters, all together, are as far from their null values although it is absent
    # (Wald's test); NaN where it has none
    absent: float = math.nan
    # Parameters of what is changed that came out, beyond doubt, as nature does not have them: they stand for
    # something else
    imitates: tuple[Estimated, ...] = ()
    idle: tuple[Idle, ...] = ()  # Effects of the model before that the change has made needless
    # Effects that the data do not tell from it, by the diagnosis that proposed it
    rivals: tuple[str, ...] = ()
    next_drive: NextDrive | None = None  # The drive that would
    confirmation: Step | None = None  # The same change, tried on a drive that did not choose it
    kept: bool = False

    @property
    def held(self) -> dict[str, float]:
        """Parameters by which it chooses the form of an effect, SI."""
        return {
            name: value
            for name, value in self.after.fixed.items()
            if name not in self.before.fixed and name.partition(".")[0] in self.changed
        }

    @property
    def confirmed(self) -> bool:
        """Whether no other drive speaks against it."""
        return self.confirmation is None or self.confirmation.pays

    @property
    def proof(self) -> Proof:
        """On what it was judged."""
        if self.confirmation is not None:
            return "another drive"
        return "stretches kept aside" if self.evidence.aside else "same data"

    @property
    def testable(self) -> bool:
        """Whether there are enough independent stretches to tell anything from chance."""
        return self.evidence.blocks >= criteria.BLOCKS_OF_CHANGE

    @property
    def there(self) -> bool:
        """Whether it is there, by its parameters or by an error that plainly differs.

        A fit may gain a little from it by what sensors' noise does; and much, where the data leave its
        parameters open, by what it does to the soil.
        """
        _, low, high = self.evidence.overall
        plain = high < criteria.PLAIN or low > 1.0 / criteria.PLAIN
        known = not self.parameters or any(one.determined for one in self.parameters)
        return not self.absent > diagnosis_criteria.LEVEL or (plain and known)

    @property
    def fell(self) -> list[ChannelChange]:
        return [one for one in self.channels if one.fell]

    @property
    def rose(self) -> list[ChannelChange]:
        return [one for one in self.channels if one.rose]

    @property
    def pays(self) -> bool:
        """Whether the error fell, and not by what nature does not have."""
        return self.better and not self.imitates

    @property
    def better(self) -> bool:
        """Whether the held-out error fell, and no rise outweighs that."""
        enough = self.testable and self.there and self.evidence.lost <= comparison_criteria.UNPREDICTED
        return enough and _differs(self.evidence.overall, self.fell, self.rose)

    @property
    def costs(self) -> bool:
        """Whether the way back would pay, it rose and no fall outweighs that; or it rose and nothing fell."""
        value, low, high = self.evidence.overall
        rose = _differs(Interval(1.0 / value, 1.0 / high, 1.0 / low), self.rose, self.fell)
        # That a rise may be chance is no reason to be without what made it fall.
        rose = rose or (not self.fell and (bool(self.rose) or value > 1.0 + criteria.LEAST_CHANGE))
        lost = self.evidence.lost > comparison_criteria.UNPREDICTED
        return self.testable and ((self.there and rose and not self.imitates) or lost)


def _differs(overall: Interval, some: Sequence[ChannelChange], others: Sequence[ChannelChange]) -> bool:
    """Tell whether errors are less beyond chance, where some channels' are less and those of others more.

    Over all channels and in one of them; plainly over all, though few blocks leave each of them open; or
    in one so certainly that what chance does in others, none of which is off, is no matter.
    """
    if _outweighs(others, some):
        return False
    if overall.high < 1.0:
        return bool(some) or overall.high < criteria.PLAIN
    certain = any(one.certainty > criteria.CERTAIN for one in some)
    return certain and not others and overall.value < criteria.PLAIN


def _outweighs(some: Sequence[ChannelChange], others: Sequence[ChannelChange]) -> bool:
    """Tell whether some channels' change speaks against that of others, which goes the other way."""
    some = [one for one in some if one.misses]
    against, in_favour = (sum(math.log1p(one.share) for one in those) for those in (some, others))
    return any(one.share > criteria.MUCH for one in some) and against > criteria.TRADED * in_favour


@dataclass(frozen=True)
class Stopped:
    """Where the loop ended."""

    file: ModelFile
    silent: bool  # Whether the alarm is
    because: str
    # evidence, comparison: what is known of the model as it is at last, and its comparison with the data
    evidence: Evidence
    comparison: Comparison
