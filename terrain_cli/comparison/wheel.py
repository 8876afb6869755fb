"""One wheel, fitted: its channels, its parameters sample by sample, predictions and residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison import drivers, noise, prediction
from terrain_cli.comparison.drivers import at_rows
from terrain_cli.comparison.neighbours import from_neighbours
from terrain_cli.estimation.wheel_fit import fit
from terrain_cli.estimation.wheel_fit.unknowns import unknowns

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from numpy.typing import ArrayLike, NDArray

    from terrain_cli.comparison.parts import Driver
    from terrain_cli.estimation.wheel_fit import Fit, Noise, Prior
    from terrain_cli.mechanics.model import Model
    from terrain_cli.windows import Windows

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]

#: Channels whose noise reaches the predictions, in the order in which the fit takes them.
NOISY = ("load", "sinkage", "slip")
#: Drivers whose noise is that of the slip computed from them.
_WITH_SLIP = ("velocity", "angular_velocity")
#: Channels that a model without effects reads, explains or is compared with.
_READ = (*NOISY, *_WITH_SLIP, "torque", "drawbar_pull")
#: Most samples to which one soil is fitted.
_MOST_COMMON = 30_000
#: Longest memory of noise, in samples, that is waited for: beyond it neighbours tell too little.
_LONGEST = 25


@dataclass(frozen=True)
class Settings:
    """How models are fitted.

    Parameters
    ----------
    fixed : mapping of str to float or array_like
        Parameters held; the others are sought.
    priors : mapping of str to Prior
    shared : collection of str
        Parameters of the soil with one value for all windows of a wheel.
    noise : Noise or None
        Of the sensors; learnt from the data if not given.
    """

    fixed: Mapping[str, ArrayLike]
    priors: Mapping[str, Prior]
    shared: Collection[str]
    noise: Noise | None


class Wheel:
    """A wheel and the model fitted to it.

    Parameters
    ----------
    windows : Windows
    model : Model
    settings : Settings
    segment : ndarray of int, shape (n,), optional
        Segment of each usable sample, where the windows are no segments but join several.
    """

    def __init__(
        self, windows: Windows, model: Model, settings: Settings, segment: Index | None = None
    ) -> None:
        self.windows, self.model, self.settings = windows, model, settings
        self.window: Index = np.repeat(np.arange(len(windows)), np.diff(windows.bounds))
        self.segment: Index = self.window if segment is None else segment
        samples = windows.samples
        self.geometry = samples.geometry.wheel
        every = {**samples.drivers, **samples.channels}
        read = {*_READ, *(name for effect in model.effects for name in effect.reads)}
        columns = {name: at_rows(column, windows.rows) for name, column in every.items() if name in read}
        self.channels: dict[str, Array] = {
            name: column for name, column in columns.items() if np.isfinite(column).any()
        }
        self.ordered = samples.time is not None
        self.fit: Fit = fit(
            model,
            self.geometry,
            self.channels,
            windows.bounds,
            fixed=settings.fixed,
            priors=settings.priors,
            shared=settings.shared,
            noise=settings.noise,
            given="sinkage" if "sinkage" in self.channels else "load",
            correlated=self.ordered,
        )
        sought = unknowns(
            model,
            fixed=settings.fixed,
            priors=settings.priors,
            shared=settings.shared,
            windows=len(windows),
        )
        #: Parameters sought: of every window, and common to all of them.
        self.soil = tuple(u.name for u in sought.local)
        self.common = tuple(u.name for u in sought.shared)
        self.logarithmic = frozenset(u.name for u in (*sought.local, *sought.shared) if u.logarithm)
        #: Width of the prior of each, of a logarithm as a share of the value.
        self.prior = {u.name: u.sd for u in (*sought.local, *sought.shared)}
        self.parameters = self._parameters(settings)
        self.series = np.concatenate([samples.stretch[windows.rows], [0]])[: len(windows.rows)]

    def __len__(self) -> int:
        return len(self.windows.rows)

    def _parameters(self, settings: Settings) -> dict[str, Array]:
        """Return every parameter of every window; those of windows without samples are never used."""
        count = len(self.windows)
        found: dict[str, Array] = {}
        for name in (*self.model.soil, *self.model.parameters):
            if name in self.fit.values:
                column = np.asarray(self.fit.values[name], dtype=float)
            elif name in self.fit.shared:
                column = np.full(count, self.fit.shared[name])
            else:
                column = np.broadcast_to(np.asarray(settings.fixed[name], dtype=float), (count,))
            usual = np.median(column[np.isfinite(column)]) if np.isfinite(column).any() else 1.0
            found[name] = np.where(np.isfinite(column), column, usual)
        return found

    @cached_property
    def group(self) -> Index:
        """Number of the part within which samples are neighbours: of one stretch and one segment."""
        change = np.concatenate([[False], (np.diff(self.series) != 0) | (np.diff(self.segment) != 0)])
        return np.cumsum(change[: len(self)]).astype(np.intp)

    def on_common_soil(self) -> tuple[Wheel, Index] | None:
        """Fit one soil to all segments of each terrain.

        Returns
        -------
        wheel : Wheel
            Its samples ordered by terrain.
        order : ndarray of int
            Which usable sample of this wheel each of its samples is; evenly thinned if they are many.

        None where each segment is on a terrain of its own.
        """
        samples, rows = self.windows.samples, self.windows.rows
        labels = samples.labels.get("terrain")
        terrain = np.zeros(len(rows), dtype=np.intp) if labels is None else labels.codes[rows].astype(np.intp)
        order = np.argsort(terrain, kind="stable")[:: max(1, -(-len(rows) // _MOST_COMMON))]
        names, counts = np.unique(terrain[order], return_counts=True)
        if len(names) >= len(self.windows):
            return None
        joined = replace(
            self.windows,
            rows=rows[order],
            bounds=np.concatenate([[0], np.cumsum(counts)]),
            x=self.windows.x[order],
            y=self.windows.y[order],
        )
        return Wheel(joined, self.model, self.settings, self.window[order]), order

    def of_samples(self, rows: Index | slice = slice(None)) -> dict[str, Array]:
        """Return the parameters of some usable samples.

        Parameters
        ----------
        rows : ndarray of int or slice

        Returns
        -------
        dict of str to ndarray
        """
        window = self.window[rows]
        return {name: column[window] for name, column in self.parameters.items()}

    @cached_property
    def measured(self) -> dict[str, Array]:
        """Channels that are compared, as measured."""
        return {name: self.channels[name] for name in prediction.compared(self.model, self.channels)}

    @cached_property
    def predicted(self) -> dict[str, Array]:
        """The same as predicted."""
        return prediction.values(self.model, self.geometry, self.channels, self.of_samples)

    @cached_property
    def residuals(self) -> dict[str, Array]:
        """Measured less predicted."""
        return {name: column - self.predicted[name] for name, column in self.measured.items()}

    @cached_property
    def noise(self) -> dict[str, noise.NoiseLevel]:
        """Noise of the residuals."""
        if self.ordered:
            return {name: noise.of_series(e, self.group) for name, e in self.residuals.items()}
        conditions = []
        for name in ("slip", "load", "sinkage"):
            if name in self.channels:
                column = self.channels[name]
                span = float(np.nanmax(column) - np.nanmin(column))
                conditions.append(column / span if span > 0.0 else np.zeros(len(self)))
        table = np.stack(conditions, axis=1)
        return {
            name: noise.NoiseLevel(noise.of_points(e, self.window, table), 0)
            for name, e in self.residuals.items()
        }

    @property
    def memory(self) -> int:
        """Samples after which the noise of all channels is another one."""
        return min(max((level.forgotten for level in self.noise.values()), default=0), _LONGEST)

    @cached_property
    def drivers(self) -> dict[str, Driver]:
        """What the residuals may follow."""
        return drivers.of_wheel(self.windows)

    def smoothed(self, gap: int, rows: Index) -> tuple[dict[str, Array], dict[str, Array]]:
        """Return channels and drivers of some usable samples, without the samples' own noise.

        Load and slip are interpolated from neighbours; the sinkage is the model's own under these
        two, as soil that varies would otherwise be in the sinkage of neighbours and in the residual
        alike. Steady test points have no neighbours: their load and slip are set, and count as exact.

        Parameters
        ----------
        gap : int
            Samples left out on either side.
        rows : ndarray of int

        Returns
        -------
        channels, drivers : dict of str to ndarray, shape (n,)
        """
        reach = max(3, gap // 2)
        channels: dict[str, Array] = {}
        for name, column in self.channels.items():
            if self.ordered and name in (*NOISY, *_WITH_SLIP):
                channels[name] = from_neighbours(column, self.group, gap=gap, reach=reach)[rows]
            else:
                channels[name] = column[rows]
        if self.model.base == "wong-reece" and {"load", "sinkage"} <= channels.keys():
            kept = {**channels, "sinkage": np.where(np.isfinite(channels["load"]), 1.0, np.nan)}
            sunk = prediction.values(
                self.model, self.geometry, kept, lambda some: self.of_samples(rows[some]), ("sinkage",)
            )
            channels["sinkage"] = sunk["sinkage"]
        found = {name: driver.values[rows] for name, driver in self.drivers.items()}
        found.update({name: channels[name] for name in (*NOISY, *_WITH_SLIP) if name in found})
        return channels, found
