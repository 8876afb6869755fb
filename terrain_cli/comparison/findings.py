"""Where a model fails: from the residuals of all wheels to findings that a person understands."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from terrain_cli.comparison import blocks, residual_noise, shapes
from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison.comparison_outcome import UNITS, Finding
from terrain_cli.comparison.drivers import ANGLE, PARTS, functions_under_all
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.comparison.residual_noise import NoiseLevel
from terrain_cli.comparison.residual_scores import ResidualEvidence, Slopes
from terrain_cli.comparison.residual_search import Found, Search
from terrain_cli.comparison.shapes import Shape
from terrain_cli.comparison.smoothed_channels import INTERPOLATED, inputs_known
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.vocabulary.quantities import listed, quantity

#: Samples of all wheels that are searched, evenly thinned: what only more of them would show is too
#: small to be reported.
MOST_SAMPLES = 60_000
_WORST = 3  # Segments named in a finding
_MOST_NAMED = 3  # Drivers named beside that of a finding


def _precision(wheel: FittedWheel) -> Array:
    """Return what is known beforehand of the soil of each window, about where it was fitted."""
    width = np.ones((len(wheel.windows), len(wheel.soil)))
    for column, name in enumerate(wheel.soil):
        size = np.abs(wheel.parameters[name]) if name in wheel.logarithmic else 1.0
        width[:, column] = wheel.prior[name] * size
    return width**-2.0


class Residuals:
    """Residuals of all wheels, thinned, with all that they may follow.

    `block` is that of each usable sample of each wheel; `scale` the standard deviation that weighs the
    residuals of a channel. With `found`, only what differs between segments rather than within them is
    searched, beyond these channels and drivers and beyond offsets.
    """

    def __init__(
        self,
        wheels: Sequence[FittedWheel],
        block: Sequence[Index],
        scale: Mapping[str, float],
        *,
        found: Collection[tuple[str, str]] | None = None,
    ) -> None:
        self.wheels, self.scale, self.found = wheels, scale, found
        self.labels: dict[str, list[str]] = {}
        self.stride = max(1, int(np.ceil(sum(len(wheel) for wheel in wheels) / MOST_SAMPLES)))
        self.first = np.cumsum([0, *(len(wheel.windows) for wheel in wheels)])
        self.rows = [np.arange(0, len(wheel), self.stride) for wheel in wheels]
        self.evidence = [self._of_wheel(index, block[index]) for index in range(len(wheels))]
        self.shapes = self._shapes()
        self.counts = {
            name: sum(
                int(np.isfinite(one.residuals[name]).sum()) for one in self.evidence if name in one.residuals
            )
            for name in scale
        }

    def _of_wheel(self, index: int, block: Index) -> ResidualEvidence:
        wheel, rows = self.wheels[index], self.rows[index]
        channels, free = wheel.noiseless(rows)
        known = inputs_known(channels)
        local, own = len(wheel.soil), len(wheel.common)
        slopes = {}
        for name, table in free.items():
            # Each wheel was fitted on its own: its common parameters are its own too.
            common = np.zeros((len(rows), own * len(self.wheels)))
            common[:, index * own : (index + 1) * own] = table[:, local:]
            slopes[name] = Slopes(table[:, :local], common)
        values: dict[str, Array] = {}
        for name, driver in wheel.drivers.items():
            if driver.labels and name not in PARTS:
                values[name] = self._codes(name, driver.labels, driver.values[rows])
            elif not driver.labels:
                values[name] = channels[name] if name in INTERPOLATED else driver.values[rows]
        if len(self.wheels) > 1:
            values["wheel"] = self._codes("wheel", (wheel.windows.samples.wheel,), np.zeros(len(rows)))
        residuals = {
            name: np.where(known, column[rows], np.nan)
            for name, column in wheel.residuals.items()
            if name in self.scale and name in slopes
        }
        return ResidualEvidence(
            residuals=residuals,
            slopes=slopes,
            drivers=values,
            group=self.first[index] + wheel.window[rows],
            block=block[rows],
        )

    def _codes(self, name: str, labels: Sequence[str], codes: Array) -> Array:
        """Count the labels of all wheels together."""
        known = self.labels.setdefault(name, [])
        known += [label for label in labels if label not in known]
        there = np.isfinite(codes)
        common = np.array([known.index(label) for label in labels], dtype=float)
        return np.where(there, common[np.where(there, codes, 0.0).astype(int)], np.nan)

    def _shapes(self) -> list[Shape]:
        found = [Shape(name="constant")]
        if self.found is None and self._one_clock():
            segments = np.concatenate(
                [w.segment[rows] for w, rows in zip(self.wheels, self.rows, strict=True)]
            )
            time = np.concatenate([one.drivers["time"] for one in self.evidence])
            found += shapes.of_stretches("time", time, segments)
        known = None if self.found is None else {driver for _, driver in self.found}
        for name in dict.fromkeys(name for one in self.evidence for name in one.drivers):
            several = [one.drivers[name] for one in self.evidence if name in one.drivers]
            values = np.concatenate(several)
            if known is not None and name not in known and not self._differs(name):
                continue
            if name in self.labels:
                found += shapes.of_label(name, values)
            elif name == ANGLE:
                teeth = {wheel.geometry.grouser_count for wheel in self.wheels} - {0}
                found += shapes.of_turning(name, several, sorted({*shapes.HARMONICS, *teeth}))
            else:
                found += shapes.of_number(name, values)
        return found

    def _one_clock(self) -> bool:
        """Tell whether a time is the same moment for all wheels."""
        sources = {wheel.windows.samples.source for wheel in self.wheels}
        return len(sources) == 1 and all("time" in one.drivers for one in self.evidence)

    def _on_clock(self, shape: Shape) -> Shape:
        """Return a shape with the times of the input, as `estimate` and `--where` have them."""
        origin = self.wheels[0].windows.samples.origin if self._one_clock() else 0.0
        if shape.driver != "time" or not origin:
            return shape
        at = shape.at + origin if shape.name in ("step", "stretch") and shape.at is not None else shape.at
        low, high, until = (value + origin for value in (shape.low, shape.high, shape.until))
        return replace(shape, at=at, low=low, high=high, until=until)

    def _differs(self, name: str) -> bool:
        """Tell whether a driver varies more between segments than within them, and not along the drive.

        What is much the same in neighbouring segments a soil that changes once or twice would follow, too.
        """
        whole = inside = 0.0
        means, chain = [], []
        for index, (wheel, rows, one) in enumerate(zip(self.wheels, self.rows, self.evidence, strict=True)):
            values = one.drivers.get(name, np.full(len(rows), np.nan))
            known = np.isfinite(values)
            if not known.any():
                continue
            segment = wheel.segment[rows][known]
            count = np.bincount(segment)
            mean = np.bincount(segment, values[known]) / np.maximum(count, 1)
            inside += float(((values[known] - mean[segment]) ** 2).sum())
            whole += float(((values[known] - values[known].mean()) ** 2).sum())
            means.append(mean[count > 0])
            chain.append(np.full(len(means[-1]), index))
        if not inside < 0.5 * whole:
            return False
        alike = blocks.neighbours(np.concatenate(means)[:, None], np.concatenate(chain))
        # In standard errors of a correlation of what is unrelated.
        return name in self.labels or alike <= criteria.AS_GOOD * sum(map(len, means)) ** -0.5

    @cached_property
    def _search(self) -> Search:
        """The search; what a change of the soil takes off is no misfit of the model."""
        search = Search(
            self.evidence,
            # A channel that follows itself says nothing.
            {name: [one for one in self.shapes if one.driver != name] for name in self.scale},
            self.scale,
            precision=np.concatenate([_precision(wheel) for wheel in self.wheels]),
            blocks=1 + max(int(one.block.max(initial=-1)) for one in self.evidence),
        )
        search.refit([])
        return search

    def join(self, chain: Index) -> Index:
        """Join blocks whose scores are related; `chain` and the result as for `blocks.merged`."""
        search = self._search
        # Of a stretch neighbouring blocks are alike by what it is.
        drives = [term.shape.name != "stretch" for term in search.terms]
        label = blocks.merged(
            search.scores()[:, search.common :][:, drives],
            chain,
            fewest=2 * criteria.FEWEST_BLOCKS,
            independent=criteria.UNRELATED_BLOCKS,
        )
        search.join(label)
        return label

    def findings(self, noise: Mapping[str, float], seed: int) -> list[Finding]:
        """Search for findings; `noise` is the standard deviation of the noise of each channel."""
        search = self._search
        taken = set() if self.found is None else {*self.found, *((name, "") for name in self.scale)}
        misfit = sum(self._beyond_noise(search, name, noise[name]) for name in self.scale)
        found = search.forward(noise, self.counts, level=criteria.FINDING_LEVEL, taken=taken, seed=seed)
        return [self._finding(one, misfit) for one in found]

    def noise_beside(self, channels: Collection[str]) -> list[dict[str, NoiseLevel]]:
        """Return the noise of some channels of each wheel beside what was found in them.

        A misfit that is over within seconds, such as a ripple, passes for noise until it is found.
        """
        return [
            residual_noise.of_all(
                {name: column for name, column in beyond.residuals.items() if name in channels},
                wheel.group[rows],
                wheel.second / self.stride,
            )
            for wheel, rows, beyond in zip(self.wheels, self.rows, self._search.wheels, strict=True)
        ]

    def _beyond_noise(self, search: Search, name: str, noise: float) -> float:
        """Weighted sum of squares of a channel's residuals, less what its noise makes of it."""
        power = sum(float(np.nansum(e.residuals[name] ** 2)) for e in search.wheels if name in e.residuals)
        return float(max(power - self.counts[name] * np.nan_to_num(noise) ** 2, 0.0) / self.scale[name] ** 2)

    def _finding(self, one: Found, misfit: float) -> Finding:
        channel, shape = one.term
        amplitude = (
            float(np.hypot(one.coefficient, one.other)) if shape.name == "periodic" else one.coefficient
        )
        amplitude *= shape.span
        alternatives = one.alternatives
        if shape.name not in ("constant", "periodic", "label", "stretch"):
            # How far a wheel has turned rises with time, and says nothing more.
            numbers = (
                {n: v for n, v in e.drivers.items() if n not in self.labels and n != ANGLE}
                for e in self.evidence
            )
            functions = functions_under_all(shape.driver, numbers)
            alternatives = tuple(dict.fromkeys([*alternatives, *(n for n in functions if n != channel)]))
        label = self.labels[shape.driver][int(shape.at or 0)] if shape.name == "label" else ""
        missing = list(self._missing(one))
        seen = self._seen(one, missing)
        shape = self._on_clock(shape)
        at = shape.at if shape.name in ("step", "stretch", "saturating", "periodic") else None
        unit = next((w.drivers[shape.driver].unit for w in self.wheels if shape.driver in w.drivers), "")
        return Finding(
            channel=channel,
            driver=shape.driver,
            shape=shape.name,
            p_value=one.p_value,
            share=float(np.clip(one.explained / misfit, 0.0, 1.0)) if misfit > 0.0 else 1.0,
            amplitude=amplitude,
            unit=UNITS[channel],
            at=at,
            until=shape.until if shape.name == "stretch" else None,
            sentence=sentence_of(channel, shape, amplitude, label, alternatives, unit, seen),
            worst_segments=self._worst(missing),
            alternatives=alternatives,
            seen=seen,
        )

    def _missing(self, one: Found) -> Iterator[tuple[int, Array]]:
        """Yield the place of each wheel and what is missing there by a finding; NaN where not measured."""
        channel, shape = one.term
        for index, evidence in enumerate(self.evidence):
            if channel not in evidence.residuals or not (
                shape.driver in evidence.drivers or not shape.driver
            ):
                continue
            values = evidence.drivers.get(shape.driver, np.zeros(len(evidence)))
            part = one.coefficient * np.nan_to_num(shape(values))
            if shape.name == "periodic":
                part = part + one.other * np.nan_to_num(replace(shape, partner=1)(values))
            yield index, np.where(np.isfinite(evidence.residuals[channel]), part, np.nan)

    def _seen(self, one: Found, missing: Sequence[tuple[int, Array]]) -> float:
        """Return the part of a finding that shows in the residuals of its channel; 0 where none does.

        The soil that is fitted takes up the rest, and moves it to other channels.
        """
        left = np.concatenate([self.evidence[index].residuals[one.term.channel] for index, _ in missing])
        part = np.concatenate([part for _, part in missing])
        left, part = left[np.isfinite(part)], part[np.isfinite(part)]
        # Of what follows a driver differences are told, whatever takes up the offset.
        away = part if one.term.shape.name == "constant" else part - part.mean()
        whole = float(away @ away)
        return float(np.clip(left @ away / whole, 0.0, 1.0)) if whole > 0.0 else 1.0

    def _worst(self, missing: Sequence[tuple[int, Array]]) -> tuple[tuple[str, str, int], ...]:
        """Rank segments by the mean square of what the finding says is missing there."""
        rows = []
        for index, part in missing:
            wheel = self.wheels[index]
            segment = wheel.segment[self.rows[index]]
            count = np.bincount(segment, np.isfinite(part))
            square = np.bincount(segment, np.nan_to_num(part) ** 2)
            samples = wheel.windows.samples
            rows += [
                (square[j] / count[j], (samples.source, samples.wheel, int(j) + 1))
                for j in np.flatnonzero(count > 0.0)
            ]
        rows.sort(key=lambda row: -row[0])
        return tuple(where for size, where in rows[:_WORST] if size > 0.0)


def sentence_of(
    channel: str,
    shape: Shape,
    amplitude: float,
    label: str,
    alternatives: Sequence[str],
    unit: str,
    seen: float = 1.0,
) -> str:
    """Say a finding in one sentence.

    `amplitude` is measured less predicted, in SI, and `seen` the part of it that shows in the residuals;
    `label` is the meaning of a label's code, `unit` the SI unit of the driver. `alternatives` are drivers
    that vary so much alike that it may be theirs.
    """
    what = quantity(channel, UNITS[channel])
    name, hidden = what.words, seen < criteria.HIDDEN
    size = f"{_number(abs(amplitude) * what.factor)} {what.unit}"
    if shape.name == "periodic":
        text = f"the model misses an oscillation of ± {size} in {name}"
    elif hidden:
        text = f"the model should predict {size} {'more' if amplitude > 0.0 else 'less'} {name}"
    else:
        text = f"the model predicts {size} too {'little' if amplitude > 0.0 else 'much'} {name}"
    text += _where(shape, label, unit)
    if alternatives:
        others = [quantity(other, "").words for other in alternatives]
        if len(others) > _MOST_NAMED:
            others[_MOST_NAMED - 1 :] = [f"{len(others) - _MOST_NAMED + 1} further channels"]
        together = f"varied together with {quantity(shape.driver, unit).words}"
        text += f" (or {listed(others, 'or')}, which {together})"
    return f"{text}; the fitted soil hides most of this error" if hidden else text


def _where(shape: Shape, label: str, unit: str) -> str:
    """Say where a residual differs."""
    driver = quantity(shape.driver, unit).words
    low, high, at = (_at(value, shape.driver, unit) for value in (shape.low, shape.high, shape.at or 0.0))
    times = round(2.0 * math.pi / (shape.at or 1.0))
    along = f" at {driver} {high}, compared with {low}"
    told = {
        "constant": " throughout",
        "label": f" where {driver} is {label}, compared with the others",
        "step": f" after {at}" if shape.driver == "time" else f" above {driver} {at}",
        "stretch": f" from {at} to {_at(shape.until, shape.driver, unit)}",
        "quadratic": f" at both ends of {driver}, {low} and {high}, compared with the middle",
        "periodic": f", {'once' if times == 1 else f'{times} times'} in a turn of the wheel",
        "saturating": f"{along}, most of it below {_at(shape.low + (shape.at or 0.0), shape.driver, unit)}",
    }
    return told.get(shape.name, along)


def missed(channel: str, error: float, ratio: float) -> str:
    """Say by how much a channel is missed: its held-out error, root mean square, in SI and over its noise."""
    what = quantity(channel, UNITS[channel])
    size = f"{_number(error * what.factor)} {what.unit}"
    return f"the held-out error of {what.words} is {size}, {_number(ratio)} × its noise"


def _at(value: float, driver: str, unit: str) -> str:
    what = quantity(driver, unit)
    gap = "" if what.unit in ("", "°", "°/s") else " "
    return f"{_number(value * what.factor)}{gap}{what.unit}"


def _number(value: float) -> str:
    """Write two significant digits at the most; whole numbers of three and more as they are."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    text = f"{value:.{max(0, 1 - math.floor(math.log10(abs(value))))}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
