"""Whether a model still fits what arrives: control charts of its innovations.

The model is fitted to the beginning of each segment. From there on, the mean residual of each second, or of
longer where the noise lasts, is set against what the soil leaves open: a Kalman filter of a soil that does
not change. Its innovations are white if the model is right. Two cumulative sums for each channel (Page 1954,
Biometrika 41) tell when they go on being too large or too small, and how large one may become by chance
follows from the rate of false alarms (Siegmund 1985, Sequential Analysis).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from terrain_cli.errors import InputError
from terrain_cli.estimation import prediction, wheel_fit
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.estimation.wheel_fit.late_channels import behind
from terrain_cli.mechanics import past
from terrain_cli.models import ModelFile
from terrain_cli.telemetry import Samples
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.windows import cut_windows
from terrain_cli.windows.running_moments import correlation_factor

#: False alarms of a wheel in an hour, all its channels together; benchmarks/watch_study.py counts them.
FALSE_ALARMS = 0.01
#: Innovations, in standard deviations, that a sum does without: half of the least shift that matters.
_REFERENCE = 0.5
_LARGEST = 4.0  # What one second may add at the most: a stone under the wheel is no fault of the model
#: Samples that the model is fitted to. Judged: k and keq are known then, and few segments are shorter.
LEARNT = 400
#: By so much more than assumed the innovations scatter and go together over seconds, as a variance: on seeds
#: 0 to 79 of benchmarks/watch_study.py, not in its table, 1.15 of the torque and 1.17 of the sinkage.
_LONG_RUN = 1.2
_SAMPLES, _SECONDS = 20, 1.0  # Least samples and seconds of a mean
#: Samples of a mean, times by how much the variance of a mean grows because the noise lasts. Of a first-order
#: autoregression the means of 5 then go together by 0.06 from one to the next.
_FORGOTTEN = 5.0
#: Degrees of freedom of a variance at the least, lest its estimate make the noise endless. Judged.
_LEAST_FREEDOM = 5.0
_RIDGE = 1e-10  # Share of its trace that is added to a matrix, lest what no sample tells make it singular


class ModelMiss(NamedTuple):
    channel: str
    size: float  # Measured less predicted, SI
    since: float  # When it began, in s on the clock of the samples


@dataclass
class ControlChart:
    """Both cumulative sums of one channel, with what was seen since each left zero."""

    sums: Array = field(default_factory=lambda: np.zeros(2))
    seen: Array = field(default_factory=lambda: np.zeros(2))
    count: Array = field(default_factory=lambda: np.zeros(2))
    since: Array = field(default_factory=lambda: np.full(2, np.nan))

    def add(self, innovation: float, deviation: float, time: float) -> None:
        """Take the innovation of a second."""
        z = float(np.clip(innovation / deviation, -_LARGEST, _LARGEST))
        new = self.sums + np.array([z, -z]) - _REFERENCE
        up = new > 0.0
        begins = up & (self.sums == 0.0)
        self.since[begins] = time
        self.sums = np.where(up, new, 0.0)
        self.seen = np.where(up, np.where(begins, 0.0, self.seen) + innovation, 0.0)
        self.count = np.where(up, np.where(begins, 0.0, self.count) + 1.0, 0.0)

    def alarm(self, channel: str, limit: float) -> ModelMiss | None:
        """Return what is beyond chance."""
        side = int(np.argmax(self.sums))
        if self.sums[side] <= limit:
            return None
        return ModelMiss(channel, float(self.seen[side] / self.count[side]), float(self.since[side]))


class ModelWatch:
    """The charts of one wheel: of its open segment."""

    def __init__(self, file: ModelFile) -> None:
        self._file = file
        self._told: set[str] = set()
        self.begin()

    def begin(self) -> None:
        self._state: SegmentWatch | None = None
        self._done = 0
        self._hopeless = False

    def look(self, samples: Samples, count: int) -> list[ModelMiss]:
        """Look at the first so many samples of the open segment; return alarms of channels that had none."""
        if count < LEARNT or self._hopeless:
            return []
        if self._state is None:
            try:
                self._state = SegmentWatch(self._file, samples.taken(slice(0, LEARNT)))
            except InputError:
                # The row of the segment says what is wrong with it.
                self._hopeless = True
                return []
            self._done = LEARNT
        begin, size = self._done, self._state.size
        self._done += max(count - begin, 0) // size * size
        found = []
        for alarm in self._state.add(samples, begin, self._done):
            if alarm.channel not in self._told:
                self._told.add(alarm.channel)
                found.append(alarm)
        return found


class SegmentWatch:
    """A fit, and what the samples since tell of the soil."""

    def __init__(self, file: ModelFile, first: Samples) -> None:
        """Fit the model to the first samples; InputError where it cannot be."""
        windows = cut_windows.cut(first, "none")
        settings = FitSettings.of([windows], file)
        self._model, self._wheel = file.model, first.geometry.wheel
        channels = _channels(first)
        held = settings.fixed

        def fitted(late: Mapping[str, Any], near: wheel_fit.Fit | None) -> wheel_fit.Fit:
            given = file.model, self._wheel, {**channels, **late}, windows.bounds
            return wheel_fit.fit(*given, fixed=held, priors=settings.priors, noise=settings.noise, near=near)

        def past_of(found: wheel_fit.Fit) -> dict[str, Any]:
            return prediction.past_of_fit(windows, windows, channels, found, held)

        fit = behind(fitted, past_of, channels, held)
        self._values = {name: float(column[0]) for name, column in fit.of_windows(held).items()}
        self._names = fit.names
        self.compared = prediction.compared(self._model, channels)
        time = first.time if first.time is not None else np.arange(float(len(first)))
        interval = float(np.median(np.diff(time)))
        self._reach: dict[str, float] = {}
        residual, design = self.residuals(first, 0, len(first))
        count = len(self._names)
        information, score = np.zeros((count, count)), np.zeros(count)
        self._factor = {}
        for name in self.compared:
            error, by = residual[name], design[name]
            known = np.isfinite(error)
            scatter = float(np.std(error[known])) or 1.0
            starts = np.zeros(0, dtype=np.intp)
            self._factor[name] = correlation_factor(error[known] / scatter, starts, count)
            weight = 1.0 / (scatter**2 * self._factor[name])
            information += weight * by[known].T @ by[known]
            score += weight * by[known].T @ error[known]
        second = round(_SECONDS / interval) if interval > 0.0 else 0
        forgotten = int(np.ceil(_FORGOTTEN * max(self._factor.values(), default=1.0)))
        self.size = max(_SAMPLES, second, forgotten)
        self.limit = limit(3600.0 / (self.size * max(interval, 1e-9)) * len(self.compared))
        # Parameters have units of their own.
        size = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
        scaled = information / np.outer(size, size) + _RIDGE * np.eye(count)
        self._covariance = np.linalg.inv(scaled) / np.outer(size, size)
        self._away = self._covariance @ score
        self.charts = {name: ControlChart() for name in self.compared}

    def residuals(self, samples: Samples, begin: int, end: int) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return measured less predicted, and the derivatives of the predictions, of some of the samples."""

        def parameters(rows: Index) -> dict[str, Array]:
            return {name: np.full(len(rows), value) for name, value in self._values.items()}

        channels = _channels(samples.taken(slice(begin, end)))
        if self._model.remembers and (time := samples.time) is not None:
            velocity = samples.channels.get("velocity")
            first, last = past.around(time, velocity, begin, end, self._reach)
            near = samples.taken(slice(first, last))
            wanted = self._model, self._wheel, _channels(near), parameters, self.compared
            # Nothing is fitted here that noise of what is predicted could lead astray: it is not smoothed.
            predicted = prediction.values(*wanted)
            late = past.along(time[first:last], near.stretch, near.channels.get("velocity"), predicted)
            channels |= {name: column[begin - first : end - first] for name, column in late.items()}
        predicted = prediction.values(self._model, self._wheel, channels, parameters, self.compared)
        by = prediction.derivatives(self._model, self._wheel, channels, parameters, self._names)
        self._reach = past.reaches(channels)
        return {name: channels[name] - predicted[name] for name in self.compared}, by

    def add(self, samples: Samples, begin: int = 0, end: int | None = None) -> list[ModelMiss]:
        """Take some of the samples, `size` to a mean; return what the model misses.

        The others tell what is late of these, or ahead.
        """
        end = len(samples) if end is None else end
        there = prediction.compared(self._model, _channels(samples.taken(slice(begin, end))))
        if begin == end or not set(self.compared) <= set(there):
            return []
        residual, design = self.residuals(samples, begin, end)
        alarms = []
        for first in range(0, end - begin, self.size):
            rows = slice(first, first + self.size)
            time = 0.0 if samples.time is None else float(samples.time[begin + first])
            error, by = ({name: own[name][rows] for name in self.compared} for own in (residual, design))
            alarms += self._step(error, by, time)
        return alarms

    def _step(
        self, residual: Mapping[str, Array], design: Mapping[str, Array], time: float
    ) -> list[ModelMiss]:
        """Take the samples of one mean."""
        known = np.all([np.isfinite(error) for error in residual.values()], axis=0)
        if np.count_nonzero(known) < _SAMPLES // 2:
            # Too few to tell their noise.
            return []
        errors = np.array([residual[name][known] for name in self.compared])
        means = np.array([design[name][known].mean(axis=0) for name in self.compared])
        factors = np.array(list(self._factor.values()))
        size = errors.shape[1]
        # The mean of noise that lasts follows it, and takes some of its variance away.
        variance = errors.var(axis=1, ddof=1) / (1.0 - np.minimum(factors / size, 0.5))
        # What is divided by an estimated deviation scatters as Student's t: (1 − ρ²)/(1 + ρ²) of all count.
        free = np.maximum((size - 1) * 2.0 * factors / (factors**2 + 1.0), _LEAST_FREEDOM)
        noise = factors * variance / size * free / (free - 2.0)
        innovation = errors.mean(axis=1) - means @ self._away
        spread = means @ self._covariance @ means.T + np.diag(noise)
        alarms = []
        for place, name in enumerate(self.compared):
            self.charts[name].add(innovation[place], float(np.sqrt(spread[place, place])), time)
            if alarm := self.charts[name].alarm(name, self.limit):
                alarms.append(alarm)
        gain = np.linalg.solve(spread, means @ self._covariance).T
        self._away = self._away + gain @ innovation
        self._covariance = self._covariance - gain @ means @ self._covariance
        self._covariance = 0.5 * (self._covariance + self._covariance.T)
        return alarms


def limit(steps: float) -> float:
    """Return what a sum may become by chance, where all charts together make so many steps in an hour."""
    # A one-sided sum with reference value ½ runs for 2 (eᵇ − b − 1) steps on the average until it is beyond
    # h, b = h + 1.166; two of them for half of that.
    length = 2.0 * steps / FALSE_ALARMS
    b = 1.0
    for _ in range(50):
        b = float(np.log(length / 2.0 + b + 1.0))
    return _LONG_RUN * (b - 1.166)


def _channels(samples: Samples) -> dict[str, Array]:
    every = {**samples.channels, **samples.drivers}
    return {name: column for name, column in every.items() if np.isfinite(column).any()}
