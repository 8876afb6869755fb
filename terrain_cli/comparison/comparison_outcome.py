"""The result of a comparison of a model with measurements, and c and φ of its segments."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.estimation import WindowEstimates, estimators
from terrain_cli.estimation.estimators import EstimateRequest
from terrain_cli.estimation.fit_account import CommonParameters
from terrain_cli.estimation.wheel_fit import Fit
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile, Refused, refused
from terrain_cli.telemetry import Samples
from terrain_cli.telemetry.unit_doubts import Doubt
from terrain_cli.telemetry.usable_samples import unsorted
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.windows.cut_windows import Windows, unbroken

#: Channels that a model predicts, with their units.
UNITS = {"torque": "N m", "drawbar_pull": "N", "sinkage": "m"}


@dataclass(frozen=True, kw_only=True)
class ChannelErrors:
    """How well one channel is predicted, of one wheel or of all together; in SI."""

    name: str
    unit: str
    n: int  # Samples that are measured and predicted
    rmse: float
    bias: float  # Mean of measured less predicted
    nrmse: float  # `rmse` over the root mean square of what is measured
    # Standard deviation of what changes from sample to sample without following the drive, the noise of slip,
    # load and sinkage that reaches the prediction included; NaN where the data do not tell
    noise: float
    # heldout_rmse, heldout_low, heldout_high: on blocks left out of the fit, with a 95 % interval by
    # the jackknife
    heldout_rmse: float
    heldout_low: float
    heldout_high: float


@dataclass(frozen=True)
class Series:
    """One channel of one wheel over its usable samples; NaN where not measured, or not predictable."""

    measured: Array  # shape (n,), as the others
    predicted: Array
    heldout: Array  # Predicted by a fit without the sample's block


@dataclass(frozen=True)
class Driver:
    """Something that a residual may follow."""

    name: str
    unit: str  # SI; empty where it is not known
    values: Array  # shape (n,): of the usable samples; NaN where not known. Of a label its code
    labels: tuple[str, ...] = ()  # What the codes mean; empty for a number


@dataclass(frozen=True, kw_only=True)
class WheelComparison:
    """One wheel of one input."""

    source: str
    wheel: str
    samples: Samples
    windows: Windows  # Of one soil each; where one predicts as well as several, it joins several segments
    segments: Windows  # The same samples as they were cut
    fit: Fit
    model: Model
    series: dict[str, Series]
    errors: dict[str, ChannelErrors]
    drivers: dict[str, Driver]
    blocks: NDArray[np.intp]  # shape (n,): block of each usable sample, counted over all wheels


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One way in which the model fails."""

    channel: str
    driver: str  # Empty for an offset that follows none
    shape: str  # "constant", "linear", "quadratic", "saturating", "step", "stretch", "periodic", "label"
    p_value: float  # How often chance gives something as strong in any channel, driver and shape
    # Part of the misfit that this accounts for: of the squared residuals beyond noise, of all channels
    # together, each in terms of its noise. What is wrong in one channel moves the soil that is fitted, and is
    # then seen in the others too
    share: float
    # Measured less predicted: positive where the model predicts too little. Difference over the driver's
    # range; above a step; half the swing of a periodic shape
    amplitude: float
    unit: str  # Of `amplitude`: SI
    # Threshold of a step, beginning of a stretch, scale of a saturating curve, or period, in the driver's SI
    # unit
    at: float | None
    sentence: str  # The same for a person
    # Source, wheel and segment (counted from 1) where it is largest, the worst first
    worst_segments: tuple[tuple[str, str, int], ...]
    alternatives: tuple[str, ...] = ()  # Drivers that vary so much alike that it may be theirs
    until: float | None = None  # End of a stretch, which begins at `at`
    seen: float = 1.0  # Part of `amplitude` that the fitted parameters do not take up


@dataclass(frozen=True, kw_only=True)
class Difference:
    """What another model changes."""

    name: str  # A channel, whose held-out error is compared, or "c" or "phi" of one segment
    unit: str
    # Source, wheel and segment (counted from 1); None for errors, which are over all wheels
    where: tuple[str, str, int] | None
    first: float
    second: float
    low: float  # low, high: 95 % interval of the difference
    high: float
    se: float

    @property
    def difference(self) -> float:
        """Value of the second model less that of the first."""
        return self.second - self.first

    @property
    def moved(self) -> bool:
        """Whether by more than three standard errors."""
        return abs(self.difference) > criteria.MOVED * self.se


@dataclass(frozen=True, kw_only=True)
class EffectScores:
    """What the scores say of effects that the model does not have, before any of them is fitted."""

    p_value: float  # How often chance gives any effect such a score, or such a gain on blocks left out
    raised: bool  # That is too rarely for chance
    effects: tuple[str, ...] = ()  # That could be tested, the one that explains most first
    unrecorded: tuple[str, ...] = ()  # Channels that nothing gives; without them some cannot be tested
    # What predicts as well on fewer soils: an effect, or nothing (empty); None where all soils are needed
    instead: str | None = None
    settles: bool = False  # Without the first effect torque and pull change alike; as measured, they do not
    idle: bool = False  # The p value is too small for chance, but the first effect lowers no held-out error


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """A model against all measurements."""

    model: dict[str, Any]  # "base" and "effects"
    wheels: list[WheelComparison]
    channels: dict[str, ChannelErrors]  # Over all wheels
    failures: list[Finding]  # The strongest first
    warnings: list[str]
    soils: EstimateRequest | None = None  # What `estimate` says of the segments (`segment_soils`)
    # The scores of effects, which are computed where they are asked for
    scores: Callable[[], EffectScores] | None = None
    refused: Refused = field(
        default_factory=Refused
    )  # What was tried to be added to the model on the same data, and did not pay
    impossible: tuple[str, ...] = ()  # Properties of its soils that no soil has, in words

    @property
    def stretch(self) -> tuple[float, float] | None:
        """Beginning and end, in s, of the stretch that the strongest finding is about, if it is.

        The end is infinite where it steps with time, and with nothing else.
        """
        first = next(iter(self.failures), None)
        if first is None:
            return None
        steps = (first.driver, first.shape) == ("time", "step") and not first.alternatives
        end = math.inf if first.until is None and steps else first.until
        return None if end is None else (first.at or 0.0, end)

    def limited(self, several: Sequence[CommonParameters] = ()) -> list[tuple[Any, ...]]:
        """Return what was found of each wheel, as `Effect.imitations` holds it against what nature bounds.

        By default that is what was fitted here.
        """
        found: list[tuple[Any, ...]] = []
        each = several or [CommonParameters.of(one.fit) for one in self.wheels]
        for one, common in zip(self.wheels, each, strict=True):
            used = {name: column[one.windows.rows] for name, column in one.samples.channels.items()}
            found.append((common.values, common.covariance, used, one.fit.under))
        return found

    @property
    def doubted(self) -> tuple[str, ...]:
        """Signs and units that are improbable, and that nothing states in rover.toml."""
        return tuple(dict.fromkeys(one.of for one in self._doubts if one.of))

    @property
    def at_limit(self) -> tuple[str, ...]:
        """Conditions that leave out the samples in which a sensor is stuck or at its limit."""
        return tuple(dict.fromkeys(one.beyond for one in self._doubts if one.beyond))

    @property
    def _doubts(self) -> list[Doubt]:
        return [one for wheel in self.wheels for one in wheel.samples.remarks if isinstance(one, Doubt)]

    @property
    def unsorted(self) -> bool:
        """Whether the rows of an input are not in the order of time."""
        return any(unsorted(wheel.samples.set_aside) for wheel in self.wheels)

    @property
    def soil_count(self) -> int:
        """Number of soils on which it is, of all wheels."""
        return sum(len(wheel.windows) for wheel in self.wheels)

    @property
    def soil_changes(self) -> list[str]:
        """Where one soil ends and another begins under a wheel, though no label says so."""
        found = []
        for wheel in self.wheels:
            rows = wheel.windows.rows
            for start in wheel.windows.bounds[1:-1]:
                before, after = rows[start - 1], rows[start]
                codes = [one.codes for one in wheel.samples.labels.values()]
                if all(code[before] == code[after] for code in codes):
                    found.append(place_of(wheel.samples, int(after)))
        return list(dict.fromkeys(found))

    @property
    def points(self) -> bool:
        """Whether the data are steady test points, not drives."""
        return bool(self.wheels) and all(wheel.samples.time is None for wheel in self.wheels)

    @property
    def blocks(self) -> int:
        """Number of independent stretches of the data."""
        return 1 + max(int(wheel.blocks.max(initial=-1)) for wheel in self.wheels)


def place_of(samples: Samples, row: int) -> str:
    """Say where a sample of a drive is: after how long, and how far; of points, in which row."""
    if samples.time is None:
        return f"row {row + 1}"
    distance = samples.distance
    driven = f" ({distance[row]:.3g} m)" if distance is not None and np.isfinite(distance[row]) else ""
    return f"{samples.time[row] - samples.time[0]:.4g} s{driven}"


class Soils(NamedTuple):
    """The segments of a wheel, their soils, and what these share."""

    segments: Windows
    estimates: WindowEstimates
    common: CommonParameters  # What all of them share, effects above all

    def on(self, cut: Windows) -> Self:
        """Return the soils of the segments of another cut, of which one may be that of several."""
        soils = self.segments
        order = np.argsort(soils.rows, kind="stable")
        place = np.searchsorted(soils.rows[order], cut.rows[cut.bounds[:-1]])
        soil = np.searchsorted(soils.bounds, order[np.minimum(place, len(order) - 1)], side="right") - 1
        columns = {f.name: getattr(self.estimates, f.name)[soil] for f in fields(WindowEstimates)}
        return self._replace(
            segments=cut, estimates=replace(self.estimates, **columns | {"n": np.diff(cut.bounds)})
        )


def segment_soils(comparison: Comparison) -> list[Soils]:
    """Return the soils of the segments of each wheel: `estimate`'s, or where it has none, the own fit's."""
    asked = comparison.soils
    if asked is None:
        return [_own(wheel, wheel.segments, None) for wheel in comparison.wheels]
    stress = asked.options.at_stress
    return [
        Soils(
            cut.taken(slice(None), found.bounds),
            found.windows,
            found.common or CommonParameters.of(wheel.fit),
        )
        if found
        else _own(wheel, cut, stress)
        for wheel, cut, found in zip(comparison.wheels, asked.wheels, asked.estimates, strict=True)
    ]


def _own(wheel: WheelComparison, cut: Windows, stress: float | None) -> Soils:
    windows = wheel.windows
    nothing = np.full(len(windows), np.nan)
    line = WindowEstimates(**dict.fromkeys((f.name for f in fields(WindowEstimates)), nothing))
    estimates = estimators.of_fit(wheel.fit, line, windows, stress)
    return Soils(windows, estimates, CommonParameters.of(wheel.fit)).on(cut)


def with_refused(comparison: Comparison, file: ModelFile, wheels: Sequence[Windows]) -> Comparison:
    """Return a comparison with what its model file says was tried on the same inputs, and did not pay."""
    sources = [one.samples.source for one in wheels]
    samples = sum(len(one.windows.rows) for one in comparison.wheels)
    return replace(comparison, refused=refused(file, sources, samples))


def as_estimated(comparison: Comparison) -> Comparison:
    """Return a comparison with the segments that `estimate` has: without the cuts that it takes back."""
    wheels, numbers = [], {}
    for wheel, soils in zip(comparison.wheels, segment_soils(comparison), strict=True):
        cut = wheel.segments
        if len(soils.segments) < len(cut):
            cut = unbroken(cut)
            of_each = np.searchsorted(cut.bounds, wheel.segments.bounds[:-1], side="right")
            own = wheel.source, wheel.wheel
            numbers.update({(*own, j): (*own, int(one)) for j, one in enumerate(of_each, 1)})
        wheels.append(replace(wheel, segments=cut))
    failures = [
        replace(one, worst_segments=tuple(dict.fromkeys(numbers.get(o, o) for o in one.worst_segments)))
        for one in comparison.failures
    ]
    return replace(comparison, wheels=wheels, failures=failures) if numbers else comparison
