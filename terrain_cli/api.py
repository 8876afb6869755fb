"""The steps of the command line for a notebook, on pandas and NumPy.

>>> import terrain_cli as terrain
>>> rover = terrain.load_rover("rover.toml")                # doctest: +SKIP
>>> wheels = terrain.read("run.bag", rover)                 # doctest: +SKIP
>>> windows = [terrain.segment(wheel) for wheel in wheels]  # doctest: +SKIP
>>> terrain.estimate(windows)[["wheel", "c_kPa", "phi_deg", "status"]]  # doctest: +SKIP
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

import formats
from terrain_cli import estimation, models, telemetry
from terrain_cli import rover as rovers
from terrain_cli.estimation import estimators
from terrain_cli.models import ModelFile
from terrain_cli.presentation import segment_table
from terrain_cli.presentation import summary as summaries
from terrain_cli.telemetry import Condition, Samples
from terrain_cli.windows.cut_windows import Windows
from terrain_cli.windows.cut_windows import cut as segment

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from formats import Batch, Column, Field, Stream
    from terrain_cli.effects import Effect
    from terrain_cli.rover import Rover
    from terrain_cli.vocabulary.choices import Method

__all__ = [
    "ModelFile",
    "Samples",
    "Windows",
    "estimate",
    "from_frame",
    "load_model",
    "load_rover",
    "read",
    "segment",
    "summarise",
    "trace",
]


def load_rover(path: str | Path | None = None) -> Rover:
    """Read rover.toml.

    Parameters
    ----------
    path : str or Path, optional
        The file in the current folder if not given.

    Returns
    -------
    Rover

    Raises
    ------
    ConfigurationError
        The file cannot be read or has an unknown key or an impossible value.
    """
    return rovers.load(path if path is not None else rovers.find(None, None))


def load_model(path: str | Path) -> ModelFile:
    """Read a model file.

    Parameters
    ----------
    path : str or Path
        The file, or a base: "linear" or "wong-reece".

    Returns
    -------
    ModelFile

    Raises
    ------
    ConfigurationError
        The file cannot be read, or has an unknown key, effect or parameter or an impossible value.
    """
    return models.resolve(str(path))


def read(
    path: str | Path,
    rover: Rover | str | Path | None = None,
    *,
    where: str | None = None,
    model: ModelFile | str | Path | None = None,
    salvage: bool = False,
) -> list[Samples]:
    """Read a log.

    Parameters
    ----------
    path : str or Path
        CSV, Parquet, ROS 1 or ROS 2 bag.
    rover : Rover, str or Path, optional
        As loaded, or the file; rover.toml beside the log, or in the current folder, if not given.
    where : str, optional
        Keep only the samples that satisfy it, such as ``"slip_angle_deg == 0"``.
    model : ModelFile, str or Path, optional
        Also read what its effects need, and the drawbar pull.
    salvage : bool
        Read what is left of a damaged log; the remarks of the samples tell how much that is.

    Returns
    -------
    list of Samples
        One for each wheel, ordered by name.

    Raises
    ------
    formats.errors.FormatError, TerrainError
        The log cannot be read, or does not hold what is needed.
    """
    if rover is None or not isinstance(rover, rovers.Rover):
        rover = rovers.load(rovers.find(str(rover) if rover is not None else None, str(path)))
    condition = Condition(where) if where else None
    return telemetry.read(str(path), rover, where=condition, effects=_effects(model), salvage=salvage)


def _effects(model: ModelFile | str | Path | None) -> tuple[Effect, ...] | None:
    file = estimators.choose("auto", model)
    return file.model.effects if file else None


def from_frame(
    frame: pd.DataFrame,
    rover: Rover | str | Path | None = None,
    *,
    where: str | None = None,
    source: str = "frame",
    model: ModelFile | str | Path | None = None,
) -> list[Samples]:
    """Take the samples from a DataFrame, whose columns are named as those of a file.

    Parameters
    ----------
    frame : DataFrame
        One row for each sample of a wheel.
    rover : Rover, str or Path, optional
        As for `read`.
    where : str, optional
        As for `read`.
    source : str
        What the table of results calls it.
    model : ModelFile, str or Path, optional
        As for `read`.

    Returns
    -------
    list of Samples

    Raises
    ------
    TerrainError
        The columns do not hold what is needed.
    """
    if rover is None or not isinstance(rover, rovers.Rover):
        rover = load_rover(rover)
    condition = Condition(where) if where else None
    return telemetry.read_source(_FrameSource(frame, source), rover, where=condition, effects=_effects(model))


def estimate(
    cut: Windows | Sequence[Windows],
    method: Method = "auto",
    *,
    min_samples: int | None = None,
    folds: int | None = None,
    model: ModelFile | str | Path | None = None,
    robust: bool = False,
    at_stress: float | None = None,
) -> pd.DataFrame:
    """Estimate cohesion and friction angle in every window.

    Parameters
    ----------
    cut : Windows, or a sequence of them
    method : {"auto", "least-squares", "ridge", "recursive", "wong-reece"}
    min_samples : int, optional
    folds : int, optional
        Choose δ of the ridge over so many contiguous blocks instead of leaving one sample out.
    model : ModelFile, str or Path, optional
        A base or a model file instead of the full model; each wheel is fitted on its own.
    robust : bool
        Give wild samples little weight in the fit of the whole model.
    at_stress : float, optional
        Normal stress in kPa for ``strength_at_stress_kPa``; by default the typical one under the wheel.

    Returns
    -------
    DataFrame
        The columns of ``terrain-est estimate``.
    """
    several = [cut] if isinstance(cut, Windows) else list(cut)
    file = estimators.choose(method, model, robust=robust)
    stress = None if at_stress is None else 1e3 * at_stress
    fits = estimators.estimate_all(
        several, method, file, min_samples=min_samples, folds=folds, robust=robust, at_stress=stress
    )
    tables = [segment_table.table(one, fit.estimates) for one, fit in zip(several, fits, strict=True)]
    return pd.DataFrame(segment_table.join(tables))


def trace(cut: Windows) -> pd.DataFrame:
    """Estimate recursively, sample by sample.

    Parameters
    ----------
    cut : Windows

    Returns
    -------
    DataFrame
        The columns of ``terrain-est estimate --trace``.
    """
    return pd.DataFrame(segment_table.trace(cut))


def summarise(
    cut: Windows | Sequence[Windows],
    method: Method = "auto",
    *,
    min_samples: int | None = None,
    model: ModelFile | str | Path | None = None,
    robust: bool = False,
) -> list[dict[str, Any]]:
    """Summarise windows by terrain and wheel.

    Parameters
    ----------
    cut : Windows, or a sequence of them
    method : {"auto", "least-squares", "ridge", "recursive", "wong-reece"}
    min_samples : int, optional
    model : ModelFile, str or Path, optional
    robust : bool

    Returns
    -------
    list of dict
        The entries ``terrains`` of ``terrain-est estimate --summary``.
    """
    several = [cut] if isinstance(cut, Windows) else list(cut)
    file = estimators.choose(method, model, robust=robust)
    fits = estimators.estimate_all(several, method, file, min_samples=min_samples, robust=robust)
    estimates = [fit.estimates for fit in fits]
    tables = [segment_table.table(one, part) for one, part in zip(several, estimates, strict=True)]
    return summaries.terrains(segment_table.join(tables), estimation.join(estimates))


class _FrameSource(formats.Source):
    """A DataFrame in the place of a file."""

    def __init__(self, frame: pd.DataFrame, name: str) -> None:
        super().__init__(name, "frame")
        self._columns = {str(header): _column(values) for header, values in frame.items()}

    def streams(self) -> tuple[Stream, ...]:
        fields = tuple(_field(name, column) for name, column in self._columns.items())
        return (formats.Stream(topic="", type="table", fields=fields),)

    def read(
        self, topic: str, fields: Sequence[str], batch_rows: int = formats.BATCH_ROWS
    ) -> Iterator[Batch]:
        del topic, batch_rows
        yield {name: self._columns[name] for name in fields}


def _field(name: str, column: Column) -> Field:
    if isinstance(column, formats.Labels):
        return formats.Field(name, "text")
    return formats.Field(name, "time" if column.dtype.kind == "M" else "number")


def _column(values: pd.Series[Any]) -> Column:
    if pd.api.types.is_datetime64_any_dtype(values.dtype):
        stamps = values.dt.tz_convert(None) if isinstance(values.dtype, pd.DatetimeTZDtype) else values
        return stamps.to_numpy("datetime64[ns]")
    if pd.api.types.is_numeric_dtype(values.dtype):
        return values.to_numpy(np.float64, na_value=np.nan)
    codes, names = pd.factorize(values)
    return formats.Labels(codes.astype(np.int32), tuple(str(name) for name in names))
