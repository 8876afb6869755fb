"""Logs, rovers and models as they are read, and what the functions of `terrain_cli` take for data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import formats
from formats import Batch, Column, Field, Stream
from terrain_cli import models, telemetry
from terrain_cli import rover as rovers
from terrain_cli.effects import Effect
from terrain_cli.errors import InputError
from terrain_cli.models import ModelFile
from terrain_cli.rover import Rover
from terrain_cli.telemetry import Condition, Samples
from terrain_cli.vocabulary.choices import Segments
from terrain_cli.windows import cut_windows, joined_inputs
from terrain_cli.windows.cut_windows import Windows

#: The windows of a wheel, samples still to be cut, a log or a table, or several of these.
Data = Windows | Samples | str | Path | pd.DataFrame | Sequence[Windows | Samples | str | Path]


def load_rover(path: str | Path | None = None) -> Rover:
    """Read a rover file.

    Parameters
    ----------
    path : str or Path, optional
        The file. By default rover.toml in the current folder, if there is one.

    Returns
    -------
    Rover
        Wheels, channels and sensors, in SI units.

    Raises
    ------
    ConfigurationError
        The file cannot be read, has an unknown key or an impossible value.
    """
    return rovers.load(path if path is not None else rovers.find(None, None))


def load_model(path: str | Path) -> ModelFile:
    """Read a model file.

    Parameters
    ----------
    path : str or Path
        The file, or the name of a base: "linear" or "wong-reece".

    Returns
    -------
    ModelFile
        What the other functions take as ``model``. Parameters are in SI units.

    Raises
    ------
    ConfigurationError
        The file cannot be read, has an unknown key, effect or parameter, or an impossible value.
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
    """Read a log, with every channel and every further numeric column.

    Parameters
    ----------
    path : str or Path
        CSV, Parquet, ROS 1 or ROS 2 bag.
    rover : Rover, str or Path, optional
        A rover, or its file. By default rover.toml beside the log, or in the current folder.
    where : str, optional
        Keep only the samples that satisfy it, such as ``"slip_angle_deg == 0"``.
    model : ModelFile, str or Path, optional
        Set aside samples that lack a channel which the effects of this model need.
    salvage : bool
        Read what is left of a damaged log. The remarks of the samples say how much that is.

    Returns
    -------
    list of Samples
        One for each wheel, ordered by name. ``channels`` maps names to arrays of shape (n,) in SI
        units; NaN where a value is not known. Samples of a skidding wheel are kept; the estimators of
        the line leave them out.

    Raises
    ------
    formats.errors.FormatError
        The log cannot be read.
    InputError
        It holds none of torque, drawbar pull and sinkage, or lacks load or slip.
    ConfigurationError
        The rover file or the model is wrong, or does not fit the log.

    Notes
    -----
    The whole log is read into memory. The table [estimate] of the rover file sets options of the
    command line, and none here.
    """
    if not isinstance(rover, rovers.Rover):
        rover = rovers.load(rovers.find(str(rover) if rover is not None else None, str(path)))
    source = formats.open_source(str(path), salvage=salvage)
    return _read(source, rover, where, model)


def from_frame(
    frame: pd.DataFrame,
    rover: Rover | str | Path | None = None,
    *,
    where: str | None = None,
    source: str = "frame",
    model: ModelFile | str | Path | None = None,
) -> list[Samples]:
    """Take samples from a DataFrame, whose columns are named like those of a file.

    Parameters
    ----------
    frame : DataFrame
        One row for each sample of a wheel. A column may name its unit, such as ``sinkage_mm``;
        otherwise it is in SI units.
    rover : Rover, str or Path, optional
        A rover, or its file. By default rover.toml in the current folder.
    source : str
        Name of the data in tables of results.
    where, model
        As for `read`.

    Returns
    -------
    list of Samples
        As from `read`.

    Raises
    ------
    InputError
        It holds none of torque, drawbar pull and sinkage, or lacks load or slip.
    ConfigurationError
        The rover file or the model is wrong, or does not fit the columns.
    """
    if not isinstance(rover, rovers.Rover):
        rover = load_rover(rover)
    return _read(_FrameSource(frame, source), rover, where, model)


def _read(
    source: formats.Source, rover: Rover, where: str | None, model: ModelFile | str | Path | None
) -> list[Samples]:
    """Read every channel whatever the model: the next step may be a comparison with another."""
    condition = Condition(where) if where else None
    effects = as_model(model).model.effects if model is not None else ()
    return telemetry.read_source(source, rover, where=condition, effects=effects, compared=True)


def segment(
    samples: Samples,
    method: Segments = "auto",
    *,
    min_samples: int | None = None,
    window_samples: int | None = None,
    window_distance: float | None = None,
) -> Windows:
    """Cut the usable samples of a wheel into windows, each of one soil.

    Parameters
    ----------
    samples : Samples
        One wheel, from `read` or `from_frame`.
    method : {"auto", "fixed", "terrain", "none"}
        Cut where the soil changes; after a fixed length; where the terrain label changes; or only
        where the drive is interrupted. For a table of steady test points, and without torque, "auto"
        makes one window for each terrain label.
    min_samples : int, optional
        Fewest samples of a window of "auto"; 10 by default.
    window_samples : int, optional
        Length of a window of "fixed", in samples.
    window_distance : float, optional
        Length of a window of "fixed", in m; least length of a window of "auto".

    Returns
    -------
    Windows
        Window j holds the samples ``rows[bounds[j]:bounds[j + 1]]``.

    Raises
    ------
    UsageError
        "fixed" without exactly one of the two lengths.
    InputError
        "terrain" without terrain labels, or a length in m without a channel that gives the distance.
    """
    return cut_windows.cut(
        samples,
        method,
        min_samples=min_samples,
        window_samples=window_samples,
        window_distance=window_distance,
    )


def as_model(model: ModelFile | str | Path) -> ModelFile:
    """Return a model that is given itself, or by its name."""
    return model if isinstance(model, ModelFile) else load_model(model)


def windows_of(
    data: Data, effects: Sequence[Effect] = (), rover: Rover | str | Path | None = None
) -> list[Windows]:
    """Return the windows of data in any form, with what effects use.

    Raises
    ------
    InputError
        No sample can be used, or an effect needs what was not measured.
    """
    cut = list(_windows(data, rover))
    if not cut:
        raise InputError("no sample can be used", hint="reasons() of the samples says why")
    return [joined_inputs.with_channels(windows, effects) for windows in cut]


def _windows(data: Data, rover: Rover | str | Path | None) -> Iterator[Windows]:
    if isinstance(data, Windows):
        if len(data):
            yield data
    elif isinstance(data, Samples):
        if len(data.usable):
            yield segment(data)
    else:
        if isinstance(data, str | Path):
            data = read(data, rover)
        elif isinstance(data, pd.DataFrame):
            data = from_frame(data, rover)
        for one in data:
            yield from _windows(one, rover)


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
