"""Search of the residuals for what a model leaves out: the strongest term, then the next beyond it."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison import distributions
from terrain_cli.comparison.blocks import DRAWS, max_test
from terrain_cli.comparison.drivers import ANGLE, PARTS
from terrain_cli.comparison.residual_scores import FittedTerms, ResidualEvidence, ScoreCell, System
from terrain_cli.comparison.shapes import Shape
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.channels import CHANNELS

_PLAIN = ("constant", "linear", "label", "step", "stretch", "saturating", "quadratic", "periodic")
#: Drivers that are named before others that varied alike, or of which nothing is known but the name of a
#: column, where these explain hardly more: what every drive is described by.
_USUAL = ("slip", "load")
_KNOWN = {"", ANGLE, *PARTS, *CHANNELS}


class Term(NamedTuple):
    """A shape in a channel."""

    channel: str
    shape: Shape


@dataclass(frozen=True, kw_only=True)
class Found:
    """One term beyond chance."""

    term: Term
    p_value: float
    coefficient: float  # Fitted with the model's parameters; of a periodic term that of its cosine
    other: float  # Of a periodic term that of its sine, else 0
    explained: float  # Part of the weighted sum of squares of all residuals that it accounts for
    alternatives: tuple[str, ...]  # Drivers whose terms in this channel are nearly the same


class Search:
    """Terms of all channels in the residuals of all wheels.

    `scale` has the standard deviation of each channel's residual, which weighs it; `precision` is that of
    `residual_scores.System`; `blocks` counts those of all wheels.
    """

    def __init__(
        self,
        wheels: Sequence[ResidualEvidence],
        shapes: Mapping[str, Sequence[Shape]],
        scale: Mapping[str, float],
        *,
        precision: Array,
        blocks: int,
    ) -> None:
        self.wheels, self.shapes, self.scale = list(wheels), shapes, scale
        first = next(iter(wheels[0].slopes.values()))
        self.common = first.common.shape[1]
        self.terms = [Term(channel, shape) for channel, each in shapes.items() for shape in each]
        self.columns: dict[str, Index] = {}
        start = self.common
        for channel, each in shapes.items():
            self.columns[channel] = np.r_[: self.common, start : start + len(each)]
            start += len(each)
        self.blocks, (self.groups, self.soil) = blocks, precision.shape
        self.system = System(precision, blocks, start).add(self._cells(by_block=False))

    def _cells(self, *, by_block: bool) -> Iterator[ScoreCell]:
        for wheel in self.wheels:
            for channel, shapes in self.shapes.items():
                weight = self.scale[channel] ** -2.0
                yield from wheel.cells(channel, shapes, self.columns[channel], weight, by_block=by_block)

    def scores(self) -> Array:
        """Return the scores of all terms in what is left of the residuals, (blocks, terms)."""
        return self.system.scores(self._cells(by_block=True))

    def join(self, label: Index) -> None:
        """Join blocks: `label`, shape (blocks,), is what each becomes part of."""
        self.wheels = [replace(wheel, block=label[wheel.block]) for wheel in self.wheels]
        self.blocks = self.system.blocks = 1 + int(label.max())

    def refit(self, chosen: Sequence[int]) -> FittedTerms:
        """Fit the model's parameters anew together with some terms, and take both off the residuals.

        The places of `chosen` count from the common parameters on, as those of the system do.
        """
        fitted = self.system.fit([*range(self.common), *chosen], self._cells(by_block=False))
        coefficients = np.zeros(self.common + len(self.terms))
        coefficients[fitted.terms] = fitted.coefficients
        self.wheels = [
            replace(
                wheel,
                residuals={
                    channel: wheel.less(
                        channel, self.shapes[channel], coefficients[self.columns[channel]], fitted.soil
                    )
                    for channel in wheel.residuals
                },
            )
            for wheel in self.wheels
        ]
        return fitted

    def forward(
        self,
        noise: Mapping[str, float],
        counts: Mapping[str, int],
        *,
        taken: Collection[tuple[str, str]] = (),
        level: float,
        seed: int = 0,
    ) -> list[Found]:
        """Find the terms beyond chance, the strongest first, each beyond those found before.

        `noise` has the standard deviation of each channel's noise, NaN where not known, and `counts` its
        samples. Terms of the channels and drivers in `taken` are fitted from the start, and not looked for.
        """
        chosen = [
            self.common + place
            for place, term in enumerate(self.terms)
            if (term.channel, term.shape.driver) in taken
        ]
        found: list[Found] = []
        need = np.array(
            [
                (criteria.SMALLEST_FINDING * np.nan_to_num(noise[t.channel])) ** 2 * counts[t.channel]
                for t in self.terms
            ]
        )
        need /= np.array([self.scale[t.channel] ** 2 for t in self.terms])
        self.refit(chosen)
        while len(found) < criteria.MOST_FINDINGS:
            fixed = [*range(self.common), *chosen]
            scores, cross = self.system.beyond(fixed, self.scores())
            testable = self.system.surviving(cross)[self.common :] > criteria.TERM_SURVIVES
            testable[np.array(chosen, dtype=int) - self.common] = False
            scores, power = scores[:, self.common :], np.where(testable, np.diag(cross)[self.common :], 1.0)
            test = max_test(
                np.where(testable, scores, 0.0),
                shrunk=self._shrunk(len(chosen)),
                seed=seed + len(found),
            )
            coefficient = np.where(testable, scores.sum(axis=0) / power, 0.0)
            explained = coefficient**2 * power
            # Neither tells what is rarer than one of the draws.
            p_values = np.minimum(test.p_values, np.maximum(self._by_share(explained, testable), 1.0 / DRAWS))
            best = self._strongest(explained, (p_values < level) & testable, need)
            if best is None:
                break
            strongest = self._pair(best)
            best = self._usual(best, explained, (p_values < level) & testable, testable, cross)
            pair = self._pair(best)
            term, size = self.terms[best], float(explained[list(pair)].sum())
            # What follows is worth a word only beside the first.
            need = np.maximum(need, criteria.FURTHER_FINDING * size) if not found else need
            found.append(
                Found(
                    term=Term(term.channel, self.terms[pair[0]].shape),
                    p_value=float(p_values[[*strongest, *pair]].min()),
                    coefficient=float(coefficient[pair[0]]),
                    other=float(coefficient[pair[1]]) if len(pair) > 1 else 0.0,
                    explained=size,
                    alternatives=self._alternatives(best, cross, testable),
                )
            )
            # All shapes of the driver: what is left of it would be the same finding again.
            chosen += [
                self.common + place
                for place, other in enumerate(self.terms)
                if (other.channel, other.shape.driver) == (term.channel, term.shape.driver)
                and (other.shape.name != "periodic" or place in pair)
            ]
            self.refit(chosen)
        return found

    def _by_share(self, explained: Array, testable: NDArray[np.bool_]) -> Array:
        """How often chance makes any term explain such a share of its channel, were each block one value.

        What is missing is in the scores that chance is drawn from too, and hides itself where it is most
        of the residual and the blocks are few. Bonferroni's bound on Student's t.
        """
        whole = {
            name: sum(float(np.nansum(w.residuals[name] ** 2)) for w in self.wheels if name in w.residuals)
            / size**2
            for name, size in self.scale.items()
        }
        every = np.array([whole[term.channel] for term in self.terms])
        share = np.divide(explained, every, out=np.zeros_like(explained), where=testable & (every > 0.0))
        free = max(self.blocks - 2.0 - self.groups * self.soil / len(self.scale), 1.0)
        share = np.minimum(share, 1.0 - 1e-12)
        p_values = 2.0 * distributions.student_tail(np.sqrt(free * share / (1.0 - share)), free)
        return np.asarray(np.minimum(p_values * max(int(np.count_nonzero(testable)), 1), 1.0))

    def _shrunk(self, chosen: int) -> float:
        """Return how much smaller residuals are than the noise, for what has been fitted to them."""
        known = sum(int(np.isfinite(e).sum()) for wheel in self.wheels for e in wheel.residuals.values())
        fitted = self.groups * self.soil + self.common + chosen
        return float(np.sqrt(max(1.0 - fitted / max(known, 1), 0.1)))

    def _pair(self, place: int) -> tuple[int, ...]:
        """Return a term, with its other half if it is periodic: cosine first."""
        shape = self.terms[place].shape
        if shape.name != "periodic":
            return (place,)
        return (place - 1, place) if shape.partner else (place, place + 1)

    def _strongest(self, explained: Array, beyond: NDArray[np.bool_], need: Array) -> int | None:
        """Choose the term that explains most, or a plainer one that explains nearly as much."""
        total = np.array([explained[list(self._pair(place))].sum() for place in range(len(self.terms))])
        candidates = np.flatnonzero(beyond & (total > need))
        if len(candidates) == 0:
            return None
        near = candidates[total[candidates] >= (1.0 - criteria.PLAINER_SHAPE) * total[candidates].max()]
        best = int(min(near, key=lambda place: (_PLAIN.index(self.terms[place].shape.name), -total[place])))
        # What is added to the torque is, over the radius, added to the drawbar pull: friction in the
        # drive is commoner than a load cell that is off.
        term = self.terms[best]
        twin = Term("torque", term.shape)
        if term.channel == "drawbar_pull" and any(self.terms[place] == twin for place in near):
            best = next(int(place) for place in near if self.terms[place] == twin)
        return best

    def _usual(
        self,
        best: int,
        explained: Array,
        beyond: NDArray[np.bool_],
        testable: NDArray[np.bool_],
        cross: Array,
    ) -> int:
        """Choose a usual driver in the place of one that varied alike, or of a further column."""
        channel, shape = self.terms[best]
        if shape.driver in _USUAL:
            return best
        alike = {*_USUAL}
        if shape.driver in _KNOWN or shape.name == "label":
            # The shape that is alike need not be that in which it explains as much.
            alike &= {*self._alternatives(best, cross, testable)}
        # With few blocks it need not be beyond chance by itself, where it explains about as much.
        near = beyond & (explained >= (1.0 - criteria.USUAL_DRIVER) * explained[best])
        near |= testable & (explained >= (1.0 - criteria.PLAINER_SHAPE) * explained[best])
        others = [
            place
            for place in np.flatnonzero(near).tolist()
            if self.terms[place].channel == channel and self.terms[place].shape.driver in alike
        ]
        return max(others, key=lambda place: explained[place], default=best)

    def _alternatives(self, best: int, cross: Array, testable: NDArray[np.bool_]) -> tuple[str, ...]:
        term = self.terms[best]
        if term.shape.name in ("constant", "periodic"):
            return ()
        power = np.diag(cross)
        row = best + self.common
        drivers = []
        for place, other in enumerate(self.terms, start=self.common):
            if other.channel != term.channel or other.shape.driver in ("", term.shape.driver):
                continue
            if not testable[place - self.common]:
                continue
            size = power[row] * power[place]
            alike = 0.5 * (cross[row, place] + cross[place, row])
            if alike**2 > criteria.ALIKE**2 * size > 0.0:
                drivers.append(other.shape.driver)
        return tuple(dict.fromkeys(drivers))
