"""A model against measurements, for a notebook; and the report of it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from terrain_cli import processes
from terrain_cli.api import result_tables
from terrain_cli.api.logs import Data, as_model, windows_of
from terrain_cli.comparison import Comparison, Difference
from terrain_cli.comparison import against as difference
from terrain_cli.improvement import compared
from terrain_cli.improvement.change_trial import alternatives
from terrain_cli.models import ModelFile
from terrain_cli.presentation import comparison_text
from terrain_cli.presentation.terminal import escaped
from terrain_cli.rover import Rover

_CHANNELS = ("unit", "samples", "rmse", "bias", "nrmse", "noise", "heldout_rmse")
_ENDS = ("heldout_low", "heldout_high")
_FAILURES = (
    *("channel", "driver", "shape", "share", "p_value", "amplitude", "unit", "at", "seen", "sentence"),
    *("alternatives", "worst_segments"),
)
_SEGMENTS = (
    *("source", "wheel", "segment", "samples", "c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg", "status"),
)
_DIFFERENCES = (
    *("name", "unit", "source", "wheel", "segment", "first", "second", "difference", "se", "moved"),
)


@dataclass(frozen=True, repr=False)
class ComparisonResult(result_tables.Result):
    """What `compare` found: errors of each channel, and where the model fails.

    ``print`` shows the text of ``terrain-est compare``, a notebook shows the tables.

    Parameters
    ----------
    found : Comparison
        The model, with what was measured and predicted of every sample: ``found.wheels[0].series``.
    against : Comparison or None
        Another model on the same blocks, if one was given.
    moved : list of Difference
        What that model changes: held-out errors, c and φ.
    """

    found: Comparison
    against: Comparison | None = None
    moved: tuple[Difference, ...] = ()

    @cached_property
    def _document(self) -> dict[str, Any]:
        return comparison_text.document(self.found, self.against, self.moved)

    @cached_property
    def channels(self) -> pd.DataFrame:
        """Errors of each channel, in the SI unit of the column ``unit``.

        ``rmse`` and ``bias`` of measured less predicted; ``nrmse``, the rmse over the root mean square
        of what was measured; ``noise``, which no model could predict; ``heldout_rmse`` on stretches left
        out of the fit, with its 95 % interval from ``heldout_low`` to ``heldout_high``.
        """
        rows = [
            {"channel": name, **errors, **dict(zip(_ENDS, errors["heldout_interval"], strict=True))}
            for name, errors in self._document["channels"].items()
        ]
        return result_tables.frame(rows, ("channel", *_CHANNELS, *_ENDS)).set_index("channel")

    @cached_property
    def failures(self) -> pd.DataFrame:
        """Where the model fails, the strongest first; no row if chance explains what is left.

        The keys are those of docs/compare.md.
        """
        return result_tables.frame(self._document["failures"], _FAILURES)

    @cached_property
    def segments(self) -> pd.DataFrame:
        """The soil of each segment as the model has it, and the errors of each channel there."""
        units = {name: errors["unit"] for name, errors in self._document["channels"].items()}
        names = {
            (name, what): result_tables.column(name, what, unit)
            for name, unit in units.items()
            for what in ("rmse", "bias")
        }
        rows = [
            {**one, **{title: one.get(name, {}).get(what) for (name, what), title in names.items()}}
            for one in self._document["segments"]
        ]
        return result_tables.frame(rows, (*_SEGMENTS, *names.values()))

    @cached_property
    def differences(self) -> pd.DataFrame:
        """What the other model changes: second less first, in SI units; no row without another model.

        ``moved`` marks what differs by more than three standard errors.
        """
        return result_tables.frame(self._document.get("differences", ()), _DIFFERENCES)

    @property
    def _picture(self) -> result_tables.Picture:
        return self.against or self.found, "predicted-measured"

    def __str__(self) -> str:
        return escaped(comparison_text.text(self.found, self.against, self.moved))

    def __repr__(self) -> str:
        return f"<ComparisonResult: {comparison_text.title(self.found)}>"

    def _repr_html_(self) -> str:
        shown = self.failures[["channel", "driver", "shape", "share", "p_value", "sentence"]]
        told = comparison_text.concluded(self.found).sentence
        return result_tables.html(
            [comparison_text.title(self.found), told, *self.found.warnings],
            {
                "Errors": self.channels,
                "Where it fails": shown,
                "Segments": self.segments,
                "Other model": self.differences,
            },
        )


def compare(
    data: Data,
    model: ModelFile | str | Path = "wong-reece",
    *,
    against: ModelFile | str | Path | None = None,
    rover: Rover | str | Path | None = None,
    seed: int = 0,
    jobs: int = 1,
) -> ComparisonResult:
    """Compare what a model predicts with what was measured, and find where it fails.

    The model is fitted to each window. Torque, drawbar pull and sinkage are compared, whichever were
    measured.

    Parameters
    ----------
    data : Windows, Samples, path, DataFrame, or a sequence of them
        Samples that are not cut yet are cut by `segment`, with its defaults.
    model : ModelFile, str or Path
        A model, its file, or a base: "linear" or "wong-reece".
    against : ModelFile, str or Path, optional
        Another model, compared on the same blocks.
    rover : Rover, str or Path, optional
        For a path or DataFrame, as for `read`.
    seed : int
        Of the resampling behind intervals and tests.
    jobs : int
        Processes that fit; the result is the same.

    Returns
    -------
    ComparisonResult
        With the DataFrames ``channels``, ``failures`` and ``segments``.

    Raises
    ------
    InputError
        No sample can be used, or an effect of the model needs what was not measured.
    ConfigurationError
        A model file is wrong.

    See Also
    --------
    diagnose : Which effect explains the failures.

    Examples
    --------
    >>> result = terrain.compare(windows)
    >>> result.channels[["rmse", "noise", "heldout_rmse"]]
    >>> result.plot("residual-sinkage")
    """
    files = [as_model(one) for one in (model, against) if one is not None]
    effects = {effect.id: effect for file in files for effect in file.model.effects}
    with processes.jobs(jobs):
        windows = windows_of(data, list(effects.values()), rover)
        first = compared(windows, files[0], seed=seed)
        if len(files) == 1:
            return ComparisonResult(first)
        second = compared(windows, files[1], like=first, seed=seed)
        return ComparisonResult(first, second, tuple(difference(first, second)))


def report(
    data: Data,
    path: str | Path,
    model: ModelFile | str | Path = "wong-reece",
    *,
    rover: Rover | str | Path | None = None,
    candidates: int = 3,
    seed: int = 0,
    jobs: int = 1,
) -> Path:
    """Write the page of ``terrain-est report``: errors, the soil on a map, and where the model fails.

    Parameters
    ----------
    data : Windows, Samples, path, DataFrame, or a sequence of them
        As for `compare`.
    path : str or Path
        Of the page: HTML that needs no network and no other file. A file of this name is replaced.
    model : ModelFile, str or Path
        As for `compare`. The history of a model file is shown too.
    candidates : int
        Effects to choose from on the page, where the model lacks one.
    rover, seed, jobs
        As for `compare`.

    Returns
    -------
    Path
        Of the page.

    Raises
    ------
    InputError, ConfigurationError
        As for `compare`; or jinja2, platformdirs or vl-convert is not installed.
    formats.errors.CannotWriteError
        The page cannot be written.
    """
    from terrain_cli.views import report as page

    file = as_model(model)
    with processes.jobs(jobs):
        windows = windows_of(data, file.model.effects, rover)
        found = compared(windows, file, seed=seed)
        choices = alternatives(windows, file, found, candidates=candidates, seed=seed)
    page.write(found, path, models=choices, further=[page.history(file.history)])
    return Path(path)
