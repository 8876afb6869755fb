"""The samples of a fit: what is given, what the model has to explain, and the noise of each channel."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.errors import InputError
from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.mechanics.past import Past
from terrain_cli.mechanics.wheel_model import Given, Model
from terrain_cli.vocabulary.arrays import Array, Bounds, Index, Mask
from terrain_cli.windows.cut_windows import runs

CHANNELS = ("load", "torque", "sinkage", "slip", "drawbar_pull")  # Channels whose noise counts
BALANCE = "balance"  # The balance of the load that the soil carries and the one on it: always zero in truth
#: Samples worked on at a time: few enough for their derivatives to fit into memory that is used again.
_BLOCK = 16_384


@dataclass(frozen=True)
class Noise:
    """Standard deviations of independent errors: the root of (relative · value)² + absolute²."""

    # Channel → share of the value. A channel not named here nor in `absolute` is exact.
    relative: Mapping[str, float] = field(default_factory=dict)
    absolute: Mapping[str, float] = field(default_factory=dict)  # Channel → in the channel's SI unit

    @classmethod
    def equal(cls, relative: float) -> Noise:
        """Return the same relative noise in every channel."""
        return cls(dict.fromkeys(CHANNELS, relative))

    def variance(self, channel: str, value: Array) -> Array:
        """Variance of a channel's error at its true values, in the SI unit squared."""
        share, constant = self.relative.get(channel, 0.0), self.absolute.get(channel, 0.0)
        return (share * value) ** 2 + constant**2

    def scaled(self, factor: float) -> Noise:
        """Return the same noise, larger or smaller in all channels."""
        return Noise(
            {name: factor * deviation for name, deviation in self.relative.items()},
            {name: factor * deviation for name, deviation in self.absolute.items()},
        )


def level(column: Array) -> float:
    """Return the root mean square of the known values of a channel; 1 where there are none."""
    known = column[np.isfinite(column)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 1.0


@dataclass(frozen=True, kw_only=True)
class FitData:
    """Samples of some windows."""

    channels: dict[str, Array]  # Shape (n,): all finite where the model reads them
    inputs: tuple[str, ...]  # Channels from which the model predicts; their noise passes through it
    outputs: tuple[str, ...]  # What it predicts: channels, or `BALANCE`
    measured: Array  # measured, seen: shape (outputs, n): values of the outputs, and where there are any
    seen: Mask
    bounds: Bounds  # Shape (w + 1,)
    windows: Index  # Shape (w,): which windows of the whole they are
    # Shape (w,): by how much larger the variances of all noise are taken to be than the sensors' own: 1
    # unless the model misses a window by more than noise
    excess: Array
    mean: Array  # Shape (inputs, w): of what was measured
    steady: Mask  # Shape (inputs, w): where an input is held at its mean (`channel_series.steadied`)

    @cached_property
    def count(self) -> Index:
        """Samples of each window."""
        return np.diff(self.bounds)

    @cached_property
    def given(self) -> Array:
        """Inputs as they are given to the model: measured, or held; shape (inputs, n)."""
        held, mean = (np.repeat(part, self.count, axis=1) for part in (self.steady, self.mean))
        return np.where(held, mean, [self.channels[name] for name in self.inputs])

    def possible(self, latent: Array) -> Array:
        """Keep true values of the inputs in the soil, in place: a depth of nothing has no derivatives."""
        if "sinkage" in self.inputs:
            row, measured = self.inputs.index("sinkage"), self.channels["sinkage"]
            latent[row] = np.where(measured > 0.0, np.maximum(latent[row], 0.1 * measured), latent[row])
        return latent

    def take(self, rows: Index, count: Index, windows: Index) -> FitData:
        """Return some of the samples, ordered by window: so many of each of these windows."""
        return replace(
            self,
            channels={name: column[rows] for name, column in self.channels.items()},
            measured=self.measured[:, rows],
            seen=self.seen[:, rows],
            bounds=np.concatenate([[0], np.cumsum(count)]),
            windows=self.windows[windows],
            excess=self.excess[windows],
            mean=self.mean[:, windows],
            steady=self.steady[:, windows],
        )

    def without(self, left: Mask) -> FitData:
        kept = np.flatnonzero(~left)
        if len(kept) == len(left):
            return self
        return self.take(kept, np.diff(np.searchsorted(kept, self.bounds)), np.arange(len(self.windows)))

    def rows_of(self, windows: Index) -> Index:
        """Return the samples of some windows, counted within this data."""
        count = self.count[windows]
        ends = np.cumsum(count)
        return np.arange(ends[-1] if len(ends) else 0) + np.repeat(self.bounds[windows] - ends + count, count)

    def only(self, windows: Index) -> FitData:
        """Return the data of some windows, counted within this data."""
        return self.take(self.rows_of(windows), self.count[windows], windows)

    def thin(self, most: int) -> tuple[Index, Index]:
        """Choose evenly spread samples of every window, so many at most; return rows and numbers."""
        count = np.minimum(self.count, most)
        ends = np.cumsum(count)
        place = np.arange(ends[-1] if len(ends) else 0) - np.repeat(ends - count, count)
        spread = np.repeat(self.count / np.maximum(count, 1), count)
        return np.repeat(self.bounds[:-1], count) + ((place + 0.5) * spread).astype(np.intp), count

    def thinned(self, most: int) -> FitData:
        """Return evenly spread samples of every window, so many at the most."""
        rows, count = self.thin(most)
        return self.take(rows, count, np.arange(len(count)))

    def blocks(self, size: int = _BLOCK) -> Iterator[Index]:
        """Yield runs of whole windows, of so many samples at most, save in a window with more."""
        yield from (np.arange(first, last) for first, last in runs(self.bounds, size))


def collect(model: Model, channels: Mapping[str, ArrayLike], bounds: ArrayLike, given: Given) -> FitData:
    """Sort channels into what is given and what is predicted, of the samples that tell something.

    NaN is not measured; bounds rise from 0 to n. InputError: a channel is missing.
    """
    past: dict[str, Any] = {name: column for name, column in channels.items() if isinstance(column, Past)}
    columns = {name: np.asarray(channels[name], dtype=float) for name in channels.keys() - past.keys()}
    bounds = np.asarray(bounds, dtype=np.intp)
    n = int(bounds[-1])
    # A channel without a single value is not there.
    columns = {name: column for name, column in columns.items() if n == 0 or np.isfinite(column).any()}
    inputs, outputs = _parts(model, columns, given)
    needed = [name for name in (*inputs, *model.needs) if name in columns]
    if BALANCE in outputs and "load" not in model.needs:
        # A sample without load still has its torque.
        needed.remove("load")
    measured = np.array([np.zeros(n) if name == BALANCE else columns[name] for name in outputs])
    if BALANCE in outputs:
        measured[outputs.index(BALANCE)] += 0.0 * columns["load"]
    seen = np.isfinite(measured)
    usable = seen.any(axis=0)
    for name in needed:
        usable &= np.isfinite(columns[name])
    rows = np.flatnonzero(usable)
    if len(rows) == 0 and n > 0:
        raise InputError(
            f"no sample has {' and '.join(dict.fromkeys(needed))} together with a channel to explain",
            hint="terrain-est inspect shows what each channel is read from",
        )
    kept: dict[str, Any] = {name: column[rows] for name, column in {**columns, **past}.items()}
    if "load" in kept:
        kept["load"] = np.where(np.isfinite(kept["load"]), kept["load"], 0.0)
    inside = np.searchsorted(rows, bounds).astype(np.intp)
    count = np.maximum(np.diff(inside), 1)
    return FitData(
        channels=kept,
        inputs=inputs,
        outputs=outputs,
        measured=np.nan_to_num(measured[:, rows]),
        seen=seen[:, rows],
        bounds=inside,
        windows=np.arange(len(bounds) - 1),
        excess=np.ones(len(bounds) - 1),
        mean=np.array([segment_sum(kept[name], inside) / count for name in inputs]),
        steady=np.zeros((len(inputs), len(count)), dtype=bool),
    )


def _parts(
    model: Model, columns: Mapping[str, Array], given: Given
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    must: tuple[str, ...]
    explained: tuple[str, ...]
    if model.base == "linear":
        must, explained = ("load", "sinkage", "slip"), ("torque", "drawbar_pull")
    elif given == "load":
        must, explained = ("load", "slip"), ("sinkage", "torque", "drawbar_pull")
    else:
        must, explained = ("sinkage", "slip"), ("torque", "drawbar_pull")
    for name in must:
        if name not in columns:
            loaded = name == "sinkage" and model.base == "wong-reece" and "load" in columns
            raise InputError(
                f"the model cannot be fitted without {name.replace('_', ' ')}",
                hint="the sinkage can be solved from the load instead (given load)"
                if loaded
                else "terrain-est inspect shows what each channel is read from",
            )
    outputs = tuple(name for name in explained if name in columns)
    if given == "sinkage" and model.base == "wong-reece" and "load" in columns:
        return ("load", *must), (BALANCE, *outputs)
    if not outputs:
        raise InputError(
            f"nothing to fit the model to: none of {', '.join(explained)} is measured".replace("_", " ")
        )
    return must, outputs
