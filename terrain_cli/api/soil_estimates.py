"""The soil of every window, as tables."""

import sys
from pathlib import Path
from typing import Any

import pandas as pd

from terrain_cli import estimation
from terrain_cli.api.logs import Data, windows_of
from terrain_cli.comparison.compare import needed_segments
from terrain_cli.errors import InputError
from terrain_cli.estimation import estimators
from terrain_cli.estimation.estimators import FitOptions, Fitted
from terrain_cli.models import ModelFile
from terrain_cli.presentation import segment_table
from terrain_cli.presentation import summary as summaries
from terrain_cli.telemetry.wheel_samples import NEEDED
from terrain_cli.vocabulary.choices import Method
from terrain_cli.windows.cut_windows import Windows


def estimate(
    cut: Data,
    method: Method = "auto",
    *,
    min_samples: int | None = None,
    folds: int | None = None,
    model: ModelFile | str | Path | None = None,
    robust: bool = False,
    at_stress: float | None = None,
) -> pd.DataFrame:
    """Estimate cohesion c and friction angle φ in every window.

    Parameters
    ----------
    cut : Windows, Samples, path, DataFrame, or a sequence of them
        Samples that are not cut yet are cut by `segment`.
    method : {"auto", "least-squares", "ridge", "recursive", "wong-reece"}
        "auto" and "wong-reece" fit the full model; the others are estimators of the paper.
    min_samples : int, optional
        Windows with fewer samples get the status "too-few-samples"; 5 by default.
    folds : int, optional
        Choose δ of the ridge over so many contiguous blocks. By default one sample is left out at a
        time.
    model : ModelFile, str or Path, optional
        A base or a model file instead of the full model. Each wheel is fitted on its own.
    robust : bool
        Give wild samples little weight in the fit of the full model.
    at_stress : float, optional
        Normal stress in kPa for ``strength_at_stress_kPa``; by default the typical one under the wheel.

    Returns
    -------
    DataFrame
        One row for each window, with the columns of ``terrain-est estimate``; units stand in their
        names.

    Raises
    ------
    InputError
        Torque or sinkage is missing, or a channel that an effect of the model needs.
    ConfigurationError
        The model file is wrong.
    UsageError
        Model, method and robustness contradict each other.
    """
    fits = _fits(cut, method, model, min_samples=min_samples, folds=folds, robust=robust, at_stress=at_stress)
    return pd.DataFrame(segment_table.join([segment_table.table(fit.windows, fit.estimates) for fit in fits]))


def posterior(
    cut: Data,
    method: Method = "auto",
    *,
    min_samples: int | None = None,
    folds: int | None = None,
    model: ModelFile | str | Path | None = None,
    robust: bool = False,
) -> pd.DataFrame:
    """Return the joint posterior of c and φ, and the covariance of all parameters, in every window.

    Parameters
    ----------
    cut, method, min_samples, folds, model, robust
        As for `estimate`.

    Returns
    -------
    DataFrame
        The columns of ``terrain-est estimate --posterior``.

    Raises
    ------
    InputError, ConfigurationError, UsageError
        As for `estimate`.
    """
    fits = _fits(cut, method, model, min_samples=min_samples, folds=folds, robust=robust, joint=sys.maxsize)
    tables = [segment_table.posterior_table(fit.windows, fit.estimates, fit.joint) for fit in fits]
    return pd.DataFrame(segment_table.join(tables))


def trace(cut: Windows) -> pd.DataFrame:
    """Estimate c and φ recursively, sample by sample.

    Parameters
    ----------
    cut : Windows
        Of one wheel.

    Returns
    -------
    DataFrame
        One row for each sample, with the columns of ``terrain-est estimate --trace``.

    Raises
    ------
    InputError
        Torque or sinkage is missing.
    """
    return pd.DataFrame(segment_table.trace(_lined(cut)))


def summarise(
    cut: Data,
    method: Method = "auto",
    *,
    min_samples: int | None = None,
    model: ModelFile | str | Path | None = None,
    robust: bool = False,
) -> list[dict[str, Any]]:
    """Pool the windows of each terrain and wheel.

    Parameters
    ----------
    cut, method, min_samples, model, robust
        As for `estimate`.

    Returns
    -------
    list of dict
        The entries ``terrains`` of ``terrain-est estimate --summary``.

    Raises
    ------
    InputError, ConfigurationError, UsageError
        As for `estimate`.
    """
    fits = _fits(cut, method, model, min_samples=min_samples, robust=robust)
    tables = [segment_table.table(fit.windows, fit.estimates) for fit in fits]
    return summaries.terrains(segment_table.join(tables), estimation.join([fit.estimates for fit in fits]))


def _fits(
    data: Data,
    method: Method,
    model: ModelFile | str | Path | None,
    *,
    robust: bool,
    at_stress: float | None = None,
    joint: int = 0,
    **options: Any,
) -> list[Fitted]:
    file = estimators.choose(method, model, robust=robust)
    given = FitOptions(robust=robust, at_stress=None if at_stress is None else 1e3 * at_stress, **options)
    wheels = [_lined(one) for one in windows_of(data, file.model.effects if file else ())]
    return list(estimators.estimate_each(wheels, method, file, given, joint=joint, needed=needed_segments))


def _lined(windows: Windows) -> Windows:
    """Refuse windows without what c and φ follow from."""
    samples = windows.samples
    missing = [name for name in NEEDED if name not in samples.channels]
    if missing:
        raise InputError(
            f"{samples}: c and φ need {' and '.join(missing)}, which the log does not give",
            hint="terrain-est inspect shows what each channel is read from; compare and diagnose do without",
        )
    return windows
