"""One wheel, fitted: its channels, its parameters sample by sample, predictions and residuals."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison import (
    drivers,
    residual_noise,
    smoothed_channels,
    smoothed_fit,
    smoothed_model,
    whitening,
)
from terrain_cli.comparison.comparison_outcome import Driver
from terrain_cli.estimation import prediction
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.estimation.wheel_fit import NOISE_LASTS, Fit, fit, samples_a_second
from terrain_cli.estimation.wheel_fit.fit_result import at_ends
from terrain_cli.estimation.wheel_fit.late_channels import behind
from terrain_cli.estimation.wheel_fit.unknowns import Unknowns, present, unknowns
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary.arrays import Array, Index
from terrain_cli.windows.cut_windows import Windows, at_rows, by_terrain

#: Channels that a model without effects reads, explains or is compared with.
_READ = (*smoothed_channels.INTERPOLATED, "torque", "drawbar_pull")
_TELL = 1_000  # Samples that tell over which gap channels are interpolated best (judged)
_MOST_COMMON = 30_000  # Most samples to which one soil is fitted
_WEIGHED = 3  # Times that test points are weighed anew by what the model leaves of them
_FAR = 3.0  # Prior standard deviations within which a search begins


class FittedWheel:
    """A wheel and the model fitted to it.

    `segment`, shape (n,), is that of each usable sample, where the windows are no segments but join
    several; channels of `further` are kept although the model does not read them.
    """

    def __init__(
        self,
        windows: Windows,
        model: Model,
        settings: FitSettings,
        segment: Index | None = None,
        further: Collection[str] = (),
    ) -> None:
        self.windows, self.model, self.settings, self.further = windows, model, settings, further
        self.window: Index = np.repeat(np.arange(len(windows)), np.diff(windows.bounds))
        self.segment: Index = self.window if segment is None else segment
        samples = windows.samples
        self.geometry = samples.geometry.wheel
        # What was computed for an effect is counted the way the wheel turns; measured channels are not.
        every = {**samples.channels, **samples.drivers}
        read = {*_READ, *further, *(name for effect in model.effects for name in effect.reads)}
        columns = {name: at_rows(every[name], windows.rows) for name in every if name in read}
        self.channels = {name: column for name, column in columns.items() if np.isfinite(column).any()}
        self.ordered = samples.time is not None
        self.series = samples.stretch[windows.rows]
        told: dict[str, Any] = {"fixed": settings.fixed, "priors": settings.priors, "shared": settings.shared}

        def fitted(late: Mapping[str, Any], near: Fit | None) -> Fit:
            return fit(
                model,
                self.geometry,
                {**self.channels, **late},
                windows.bounds,
                **told,
                noise=settings.noise,
                by_differences=True,
                given="sinkage" if "sinkage" in self.channels else "load",
                correlated=self.ordered,
                near=near,
            )

        def past_of(found: Fit) -> dict[str, Any]:
            self.parameters = found.of_windows(settings.fixed)
            return self.past_of(self._read(smoothed_channels.GAPS))

        self.fit = behind(fitted, past_of, self.channels, settings.fixed)
        self.under = self.fit.under
        self.seek(unknowns(model, **told, under=self.under))
        self.parameters = self.fit.of_windows(settings.fixed)
        self._robust()

    def __len__(self) -> int:
        return len(self.windows.rows)

    def seek(self, sought: Unknowns) -> None:
        """Have these parameters for those that were fitted."""
        self.sought, every = sought, (*sought.local, *sought.shared)
        #: Parameters sought: of every window, and common to all of them.
        self.soil = tuple(u.name for u in sought.local)
        self.common = tuple(u.name for u in sought.shared)
        self.logarithmic = frozenset(u.name for u in every if u.logarithm)
        #: Width of the prior of each, of a logarithm as a share of the value.
        self.prior = {u.name: u.sd for u in every}

    def _robust(self) -> None:
        """Take the soil from a fit that a wrong model does not lead astray, where the fit went wrong."""
        if not self.measured:
            return
        known = self.fit.dof > 0.0
        ratio = float(self.fit.chi2[known].sum() / self.fit.dof[known].sum()) if known.any() else 1.0
        lost = self._lost()
        # Of test points load and slip were set, and are exact.
        astray = ratio >= criteria.ASTRAY or not self.ordered or lost
        levels, sizes = self.levels, self._sizes()
        before = residual_noise.worst(sizes, levels)
        if not astray and not before > criteria.NOTICED:
            return
        data = self.least_squares_data()
        t, common = self.beginning()
        # That fit can have gone astray in what is common too: others begin with none of its effects, or with
        # all of them in every shape that is tried.
        none = np.zeros_like(common)
        shaped = any(unknown.own and unknown.own.shape for unknown in self.sought.shared)
        there = present(self.sought, none, self.channels, smoothed_fit.PRESENT) if shaped else ()
        starts = product((t, None), (common, none, *there) if len(common) else (common,))
        first = (self.fit, dict(self.parameters))
        solution = smoothed_fit.search(self.model, self.sought, data, starts)
        for _ in range(_WEIGHED if not self.ordered else 0):
            data = smoothed_model.with_noise_of(data, solution.residual, criteria.NOISE_POINTS)
            solution = smoothed_fit.solve(self.model, self.sought, data, solution.t, solution.common)
        self.forget()
        self.fit = smoothed_fit.as_fit(data, solution, self.fit)
        self.parameters.update(smoothed_fit.parameters(solution))
        after = self._sizes()
        worse = self.ordered and all(after.get(name, np.inf) >= size for name, size in sizes.items())
        if (not astray and residual_noise.worst(after, levels) >= before) or (worse and not lost):
            self.forget()
            self.fit, self.parameters = first

    def _sizes(self) -> dict[str, float]:
        """Return the mean square of the residuals of each channel that has any."""
        left = {name: error for name, error in self.residuals.items() if np.isfinite(error).any()}
        return {name: float(np.nanmean(error**2)) for name, error in left.items()}

    def forget(self) -> None:
        """Have what is computed once from the parameters computed anew."""
        for name in ("read", "measured", "predicted", "residuals", "noise", "memory", "_noiseless"):
            self.__dict__.pop(name, None)

    def _lost(self) -> bool:
        """Tell whether the fit went to a soil without friction, or one that does not carry the load."""
        if "tan_phi" in self.parameters and np.any(self.parameters["tan_phi"] <= 0.0):
            return True
        there = {name: np.isfinite(column) for name, column in self.measured.items()}
        missing = sum(int((own & ~np.isfinite(self.predicted[name])).sum()) for name, own in there.items())
        return missing > criteria.FIT_UNPREDICTED * sum(int(own.sum()) for own in there.values())

    def beginning(self) -> tuple[Array, Array]:
        """Return where a search begins: at the fit, in prior standard deviations from the prior means."""
        local = [u.sought(self.parameters[u.name]) for u in self.sought.local]
        shared = [float(np.ravel(u.sought(self.parameters[u.name]))[0]) for u in self.sought.shared]
        t = np.stack(local, axis=1) if local else np.zeros((len(self.windows), 0))
        return np.clip(t, -_FAR, _FAR), np.array(shared)

    def least_squares_data(self, white: whitening.Whitening | None = None) -> smoothed_model.SmoothedData:
        """Prepare a fit by `smoothed_fit.solve`.

        It is whitened by `white`, which is made of what is left; if not given, by what changes from sample
        to sample in the channels.
        """
        read = self.interpolated(smoothed_channels.GAPS)
        known, use = smoothed_channels.without_noise(
            self.record, read, load_tells_sinkage=self.model.base == "wong-reece"
        )
        blocks = max(len(self) // criteria.MISFIT_SAMPLES, 1) if self.ordered else len(self)
        return smoothed_model.SmoothedData(
            geometry=self.geometry,
            inputs={**known, **(self.past_of(known) if self.model.remembers else {})},
            measured=self.measured,
            use=use,
            white=white or self._noise_of_channels(),
            window=self.window,
            windows=len(self.windows),
            blocks=min(blocks, criteria.MOST_BLOCKS),
        )

    def _noise_of_channels(self) -> whitening.Whitening:
        """Return the noise before anything is fitted; of test points what repeated ones differ by."""
        found = whitening.of_channels(self.measured, self.group if self.ordered else np.arange(len(self)))
        if self.ordered:
            return found
        levels = np.array([self.levels[name] for name in found.channels])
        least = np.sqrt(np.diag(found.covariance))
        known = np.where(np.isfinite(levels) & (levels > 0.0), levels, least)
        return whitening.Whitening(found.channels, np.diag(np.square(known)))

    @cached_property
    def group(self) -> Index:
        """Number of the part within which samples are neighbours: of one stretch and one segment."""
        change = np.concatenate([[False], (np.diff(self.series) != 0) | (np.diff(self.segment) != 0)])
        return np.cumsum(change[: len(self)]).astype(np.intp)

    @cached_property
    def record(self) -> smoothed_channels.RecordedWheel:
        """What was measured, without the model."""
        every, rows, group = self.windows.samples.channels, self.windows.rows, self.group
        chosen = {name: at_rows(every[name], rows) for name in smoothed_channels.SET if name in every}
        known = {**chosen, **self.channels}
        return smoothed_channels.RecordedWheel(known, self.window, group if self.ordered else None)

    @cached_property
    def one_soil(self) -> tuple[FittedWheel, Index] | None:
        """The model fitted with one soil to all segments of each terrain.

        With its samples ordered by terrain, and which usable sample of this wheel each of them is; None
        where each segment is on a terrain of its own.
        """
        return self._joined(1)

    def on_common_soil(self) -> tuple[FittedWheel, Index] | None:
        """Return the same, of evenly thinned samples if they are many."""
        step = max(1, -(-len(self) // _MOST_COMMON))
        return self.one_soil if step == 1 else self._joined(step)

    def _joined(self, step: int) -> tuple[FittedWheel, Index] | None:
        found = by_terrain(self.windows, step)
        if found is None:
            return None
        joined, order = found
        return FittedWheel(joined, self.model, self.settings, self.segment[order], self.further), order

    def of_samples(self, rows: Index | slice = slice(None)) -> dict[str, Array]:
        """Return the parameters of some usable samples."""
        window = self.window[rows]
        return {name: column[window] for name, column in self.parameters.items()}

    def noiseless(self, rows: Index) -> tuple[dict[str, Any], dict[str, Array]]:
        """Return `smoothed` channels of some samples with their past, and slopes, 0 by what is at a bound."""
        # It takes up no misfit there.
        kept = self.__dict__.get("_noiseless")
        if kept is None or not np.array_equal(kept[0], rows):
            channels = self.smoothed(self.gaps, rows, remembering=True)
            free = ~at_ends(self.sought, *self.beginning())[self.window[rows]]
            slopes = {name: table * free for name, table in self.slopes(channels, rows).items()}
            kept = self.__dict__["_noiseless"] = rows, channels, slopes
        return kept[1:]

    def slopes(self, channels: Mapping[str, Array], rows: Index) -> dict[str, Array]:
        """Differentiate the predictions of some samples by all that was fitted: by channel, (n, names)."""
        names = (*self.soil, *self.common)
        return prediction.derivatives(self.model, self.geometry, channels, self._some(rows), names)

    def _some(self, rows: Index) -> prediction.Parameters:
        return lambda some: self.of_samples(rows[some])

    @cached_property
    def read(self) -> dict[str, Array]:
        """The channels from which to predict: torque and pull, if effects read them, from the conditions.

        Of these without their own noise: an effect that reads a pull with the noise of the load would take
        that noise off the load.
        """
        read = self._read(smoothed_channels.GAPS)
        return {**read, **self.past_of(read)} if self.model.remembers else read

    @cached_property
    def _from_conditions(self) -> dict[str, Array]:
        """Torque and pull as slip, load and what else there is explain them, if effects read them."""
        wanted = {*self.further, *(name for effect in self.model.effects for name in effect.reads)}
        return {
            name: smoothed_channels.from_conditions(self.channels[name], self.channels, self.window)
            for name in ("torque", "drawbar_pull")
            if name in wanted and name in self.channels
        }

    def _read(self, gaps: Mapping[str, int]) -> dict[str, Array]:
        read = self.channels | self._from_conditions
        for name, column in self._from_conditions.items() if self.ordered else ():
            around = smoothed_channels.from_neighbours(column, self.group, gap=gaps["load"])
            # A sample without a neighbour has nothing else.
            read[name] = np.where(np.isfinite(around), around, column)
        return read

    @cached_property
    def measured(self) -> dict[str, Array]:
        """Channels that are compared, as measured."""
        return {name: self.channels[name] for name in prediction.compared(self.model, self.channels)}

    @cached_property
    def predicted(self) -> dict[str, Array]:
        """The same channels, as the fitted model predicts them."""
        return prediction.values(self.model, self.geometry, self.read, self.of_samples)

    @cached_property
    def residuals(self) -> dict[str, Array]:
        """Measured less predicted."""
        return {name: column - self.predicted[name] for name, column in self.measured.items()}

    @cached_property
    def noise(self) -> dict[str, residual_noise.NoiseLevel]:
        if self.ordered:
            return residual_noise.of_all(self.residuals, self.group, self.second)
        return residual_noise.of_all_points(self.residuals, self.window, self.run_under)

    @property
    def levels(self) -> dict[str, float]:
        """Standard deviation of that noise."""
        return {name: level.deviation for name, level in self.noise.items()}

    @cached_property
    def run_under(self) -> Array:
        """Slip and load of steady test points, else slip and sinkage, as `Record.conditions`."""
        return self.record.conditions(("slip", "load") if "load" in self.channels else ("slip", "sinkage"))

    @cached_property
    def second(self) -> float:
        """Samples in a second; 0 without a clock."""
        time = self.windows.samples.time
        return samples_a_second(None if time is None else time[self.windows.rows])

    @cached_property
    def memory(self) -> int:
        """Samples after which the noise of all channels is another one; what follows a driver is none."""
        memory = {name: level.forgotten for name, level in self.noise.items()}
        if any(memory.values()):
            known = self.drivers, self.interpolated(smoothed_channels.GAPS), self.geometry.grouser_count
            left = {n: drivers.beside(self.residuals[n], m, *known) for n, m in memory.items() if m}
            beside = residual_noise.of_all(left, self.group, self.second)
            memory = {name: min(level.forgotten, memory[name]) for name, level in beside.items()}
        longest = max(criteria.LONGEST_MEMORY, int(NOISE_LASTS * self.second))
        return min(max(memory.values(), default=0), longest)

    @cached_property
    def drivers(self) -> dict[str, Driver]:
        return drivers.of_wheel(self.windows)

    def interpolated(self, gaps: Mapping[str, int]) -> dict[str, Array]:
        """Return channels of the usable samples, shape (n,), as effects may read them, without their noise.

        Load, sinkage, slip and speeds come from neighbours beyond `gaps`, torque and pull from conditions.
        """
        read = self._read(gaps)
        for name in gaps if self.ordered else ():
            if name in read:
                read[name] = smoothed_channels.from_neighbours(read[name], self.group, gap=gaps[name])
        return read

    @cached_property
    def gaps(self) -> dict[str, int]:
        """Samples of each channel left out on either side where it is interpolated to explain residuals."""
        # The noise of a load may last longer than what is left, of which it is a part.
        most = max(self.memory, int(NOISE_LASTS * self.second)) if self.memory else 0
        return smoothed_channels.best_gaps(most, self._misfit)

    def _misfit(self, gaps: Mapping[str, int]) -> Array:
        """Return the squares that predictions from interpolated channels leave, over the residuals'.

        They are those of some parts of the samples.
        """
        rows = np.arange(0, len(self), max(1, len(self) // _TELL))
        channels = self.smoothed(gaps, rows)
        total = np.zeros(len(rows))
        found = prediction.values(self.model, self.geometry, channels, self._some(rows))
        for name, predicted in found.items():
            usual, left = self.residuals[name][rows], self.measured[name][rows] - predicted
            left = np.where(np.isfinite(left), left, 2.0 * usual)
            total += np.nan_to_num(left**2) / max(np.nansum(usual**2), np.finfo(float).tiny)
        return np.array([part.sum() for part in np.array_split(total, criteria.MOST_BLOCKS)])

    def past_of(
        self, channels: Mapping[str, Any], other: tuple[Model, Mapping[str, Array]] | None = None
    ) -> dict[str, Any]:
        """Return the past of what the model, or `other` with its parameters, predicts of all samples.

        Steady test points have none.
        """
        if (time := self.windows.samples.time) is None:
            return {}
        model, parameters = other or (self.model, self.of_samples())
        clock = time[self.windows.rows], self.series, channels.get("velocity")
        return prediction.past_of(model, self.geometry, channels, parameters, clock, self.measured)

    def smoothed(self, gaps: Mapping[str, int], rows: Index, *, remembering: bool = False) -> dict[str, Any]:
        """Return channels of some usable samples, without the samples' own noise.

        Load and slip are interpolated from neighbours, all but `gaps` on either side; the sinkage is the
        model's own under these two, as soil that varies would otherwise be in that of neighbours and in the
        residual alike. Steady test points have no neighbours: load and slip are set, and count as exact.
        """
        remembering |= self.model.remembers
        whole = np.arange(len(self)) if remembering else rows
        channels = {name: column[whole] for name, column in self.interpolated(gaps).items()}
        if self.model.base == "wong-reece" and {"load", "sinkage"} <= channels.keys():
            kept = {**channels, "sinkage": np.where(np.isfinite(channels["load"]), 1.0, np.nan)}
            channels |= prediction.values(self.model, self.geometry, kept, self._some(whole), ("sinkage",))
        every = {**channels, **self.past_of(channels)} if remembering else {}
        return {name: column[rows] for name, column in every.items()} or channels
