"""What a model lacks, for a notebook."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from terrain_cli import effects as catalogues
from terrain_cli import models, processes
from terrain_cli.api import result_tables
from terrain_cli.api.logs import Data, as_model, windows_of
from terrain_cli.comparison import kept_aside
from terrain_cli.diagnosis import diagnose as diagnosed
from terrain_cli.diagnosis.diagnosis_outcome import Diagnosis, NextDrive, Verdict
from terrain_cli.diagnosis.verdict import sizes_text
from terrain_cli.models import ModelFile
from terrain_cli.presentation import diagnosis_text
from terrain_cli.presentation.terminal import escaped
from terrain_cli.rover import Rover

_CANDIDATES = (
    *("effect", "title", "score", "p_value", "explained", "surviving"),
    *("heldout_loss", "heldout_loss_se", "refitted", "in_family"),
)
_NOT_SHOWN = ["title", "score", "p_value", "heldout_loss", "heldout_loss_se", "refitted"]
_SHOWN = 8  # Candidates that a notebook shows


@dataclass(frozen=True, repr=False)
class DiagnosisResult(result_tables.Result):
    """What `diagnose` found: which effect a model lacks, as far as the data tell.

    ``print`` shows the text of ``terrain-est diagnose``, a notebook shows the tables.

    Parameters
    ----------
    found : Diagnosis
        Everything: the alarm, the comparison of the model as it is, the draft of a law.
    """

    found: Diagnosis

    @property
    def verdict(self) -> Verdict:
        """What was found: "none", "effect", "family" or "unknown"."""
        return self.found.verdict

    @property
    def effect(self) -> str | None:
        """Id of the missing effect; None unless the data rule out all others."""
        return self.found.effect

    @property
    def family(self) -> tuple[str, ...]:
        """Effects that the data cannot tell apart, the best first."""
        return self.found.family

    @property
    def next_drive(self) -> list[NextDrive]:
        """Drives that would tell two of the family apart: ``pair``, ``manoeuvre`` in words, ``power``.

        ``simulate(part=[one.settings])`` drives it, where its settings are not empty.
        """
        return self.found.next_drive

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        return self.found.sentence

    @cached_property
    def _document(self) -> dict[str, Any]:
        return diagnosis_text.document(self.found)

    @cached_property
    def candidates(self) -> pd.DataFrame:
        """Effects that were tried, the best first.

        ``score`` in standard errors; ``explained``, the share of the misfit; ``surviving``, the share of
        the effect's trace that no soil imitates; the held-out error of each channel with it, in SI
        units; ``heldout_loss`` against the model without it, in squares of the noise, where negative is
        better. Sizes are in `parameters`. The keys are those of docs/diagnose.md.
        """
        units = {name: errors["unit"] for name, errors in self._document["channels"].items()}
        names = {name: result_tables.column(name, "heldout_rmse", unit) for name, unit in units.items()}
        rows = [
            {**one, **{title: one["heldout_rmse"].get(name) for name, title in names.items()}}
            for one in self._document["candidates"]
        ]
        return result_tables.frame(rows, (*_CANDIDATES[:6], *names.values(), *_CANDIDATES[6:]))

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """Parameters of the candidates: ``value`` and standard error ``se``, in ``unit``."""
        rows = [
            {"effect": one["effect"], "parameter": name, **size}
            for one in self._document["candidates"]
            for name, size in one["parameters"].items()
        ]
        return result_tables.frame(rows, ("effect", "parameter", "value", "se", "unit"))

    @property
    def _picture(self) -> result_tables.Picture:
        return self.found, "candidates"

    def __str__(self) -> str:
        return escaped(diagnosis_text.text(self.found))

    def __repr__(self) -> str:
        named = ", ".join(self.family) or self.verdict
        return f"<DiagnosisResult: {self.verdict}{f' ({named})' if self.family else ''}>"

    def _repr_html_(self) -> str:
        drives = [
            f"To tell {' from '.join(one.pair)}: {one.manoeuvre} (decides in {one.power:.0%} of cases)"
            for one in self.next_drive
        ]
        fitted = self.candidates["refitted"].astype(bool)
        shown = self.candidates[fitted].set_index("effect").drop(columns=_NOT_SHOWN)
        shown["parameters"] = [sizes_text(one) for one in self.found.candidates if one.refitted]
        shown = shown.head(_SHOWN)
        return result_tables.html([self.sentence, *drives, *self.found.warnings], {"Candidates": shown})


def diagnose(
    data: Data,
    model: ModelFile | str | Path = "wong-reece",
    *,
    effects: Sequence[str | Path] = (),
    rover: Rover | str | Path | None = None,
    smallest_share: float | None = None,
    keep_aside: float | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> DiagnosisResult:
    """Find out which physical effect a model lacks.

    Every effect of the catalogue is tried: fitted together with the soil, and judged by the error on
    stretches of the data that were left out. Inputs of the same wheel are joined. A log of a minute
    takes about ten seconds.

    Parameters
    ----------
    data : Windows, Samples, path, DataFrame, or a sequence of them
        Samples that are not cut yet are cut by `segment`, with its defaults.
    model : ModelFile, str or Path
        The model that may lack something: itself, its file, or a base, "linear" or "wong-reece".
    effects : sequence of str or Path
        Files of your own effects, tried beside the catalogue.
    rover : Rover, str or Path, optional
        For a path or DataFrame, as for `read`.
    smallest_share : float, optional
        Share of the root mean square of a channel, 0.003 by default. What is smaller in every channel raises
        no alarm.
    keep_aside : float, optional
        Share of each input that is not looked at, in eight stretches, so that `add_effect` with the same
        share can judge on them what was named here.
    seed : int
        Of all that is drawn at random.
    jobs : int
        Processes that fit; the result is the same.
    progress : callable, optional
        Called with the name of each step before it begins, such as ``print``.

    Returns
    -------
    DiagnosisResult
        With ``verdict``, ``effect``, ``family``, ``next_drive`` and the DataFrame ``candidates``.

    Raises
    ------
    InputError
        No sample can be used, or nothing was measured that the model predicts.
    ConfigurationError
        A model file or the file of an effect is wrong.
    UsageError
        `keep_aside` is not between 0 and 1.

    See Also
    --------
    add_effect : Prove on held-out data that an effect is worth adding.

    Examples
    --------
    >>> result = terrain.diagnose(windows)
    >>> result.effect
    'slip-sinkage'
    """
    file = as_model(model)
    own = [models.find_effect(str(name)) for name in effects]
    every = {**catalogues.catalogue(), **{effect.id: effect for effect in own}}
    with processes.jobs(jobs):
        windows = windows_of(data, file.model.effects, rover)
        found = diagnosed(
            windows if keep_aside is None else kept_aside.seen(kept_aside.marked(windows, keep_aside)),
            file,
            effects=list(every.values()),
            seed=seed,
            smallest_share=smallest_share,
            progress=progress or (lambda _: None),
        )
    return DiagnosisResult(found)
