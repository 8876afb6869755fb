"""An effect added to a model, and what held-out data say of it, for a notebook."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from terrain_cli import improvement, models, processes
from terrain_cli.api import result_tables
from terrain_cli.api.logs import Data, as_model, windows_of
from terrain_cli.comparison import kept_aside
from terrain_cli.improvement import Step, model_history
from terrain_cli.models import ModelFile
from terrain_cli.presentation import change_text
from terrain_cli.presentation.terminal import escaped
from terrain_cli.rover import Rover

_PARAMETERS = ("source", "wheel", "name", "value", "se", "unit", "determined")


@dataclass(frozen=True, repr=False)
class EffectTrial(result_tables.Result):
    """What `add_effect` did, and why.

    ``print`` shows the text of ``terrain-est model add``, a notebook shows the tables.

    Parameters
    ----------
    model : ModelFile
        The model with the effect, if it was kept; else the model as it was.
    step : Step
        Everything: both models, compared on the same blocks.
    path : Path or None
        Model file, where there is one.
    """

    model: ModelFile
    step: Step
    path: Path | None = None

    @property
    def kept(self) -> bool:
        """Whether the model has the effect now."""
        return self.step.kept

    @property
    def pays(self) -> bool:
        """Whether the error on held-out data fell, by the rules of docs/model.md."""
        return self.step.pays

    @property
    def sentence(self) -> str:
        """The outcome in words."""
        return change_text.verdict(self.step)

    @property
    def history(self) -> tuple[Mapping[str, Any], ...]:
        """Every change that the model remembers, the oldest first; keys are those of docs/model.md."""
        return self.model.history

    @cached_property
    def _document(self) -> dict[str, Any]:
        return {**change_text.document(self.step), "file": str(self.path) if self.path else None}

    @cached_property
    def errors(self) -> pd.DataFrame:
        """Held-out error of each channel, in the SI unit of the column ``unit``.

        ``before``, ``after`` and their ``difference``, each with its 95 % interval (``_low``, ``_high``);
        ``noise``, which no model could predict.
        """
        parts = {"before": "heldout_before", "after": "heldout_after", "difference": "difference"}
        rows = []
        for name, one in self._document["channels"].items():
            row = {"channel": name, "unit": one["unit"], "noise": one["noise"]}
            for column, key in parts.items():
                low, high = one[f"{key}_interval"] or (None, None)
                row |= {column: one[key], f"{column}_low": low, f"{column}_high": high}
            rows.append(row)
        values = [f"{column}{end}" for column in parts for end in ("", "_low", "_high")]
        return result_tables.frame(rows, ("channel", "unit", *values, "noise")).set_index("channel")

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """Parameters of the effect under each wheel: ``value`` and standard error ``se``, in ``unit``.

        ``determined`` is False where the data leave one open.
        """
        return result_tables.frame(self._document["parameters"], _PARAMETERS)

    @property
    def _picture(self) -> result_tables.Picture:
        entries = [*self.history] if self.kept else [*self.history, _entry(self.step)]
        return model_history.rungs(entries), "ladder"

    def __str__(self) -> str:
        return escaped(change_text.text(self.step))

    def __repr__(self) -> str:
        return f"<EffectTrial: {', '.join(self.step.changed)} {'kept' if self.kept else 'not kept'}>"

    def _repr_html_(self) -> str:
        return result_tables.html(
            [self.sentence, *self._document["warnings"]],
            {"Held-out error": self.errors, "Parameters": self.parameters},
        )


def _entry(step: Step) -> dict[str, Any]:
    return model_history.entry(step, change_text.reason(step))


def add_effect(
    model: ModelFile | str | Path,
    effect: str | Path | Sequence[str | Path],
    data: Data,
    *,
    path: str | Path | None = None,
    keep: bool = False,
    keep_aside: float | None = None,
    rover: Rover | str | Path | None = None,
    seed: int = 0,
    jobs: int = 1,
    progress: Callable[[str], None] | None = None,
) -> EffectTrial:
    """Add an effect to a model, if that makes the error on held-out data fall.

    The model is fitted without and with the effect, together with the soil. Both predict stretches of
    the data that were left out of the fit. No file is changed unless `path` is given.

    Parameters
    ----------
    model : ModelFile, str or Path
        The model, its file, or a base: "linear" or "wong-reece".
    effect : str or Path, or a sequence of them
        Id of the catalogue, the TOML file of an effect of your own, or an assumption of the base that
        is then removed. Several are added together.
    data : Windows, Samples, path, DataFrame, or a sequence of them
        Samples that are not cut yet are cut by `segment`, with its defaults. Inputs of the same wheel
        are joined.
    path : str or Path, optional
        Where to write the model file if the effect is kept. A file of this name is replaced.
    keep : bool
        Keep the effect even if the held-out error does not fall.
    keep_aside : float, optional
        Judge only on this share of each input, in eight stretches, which `diagnose` with the same share did
        not see. By default on all of it.
    rover, seed, jobs, progress
        As for `diagnose`.

    Returns
    -------
    EffectTrial
        ``model`` is the model as it is now, ``kept`` says whether it has the effect, ``errors`` are the
        held-out errors before and after, ``history`` the changes so far.

    Raises
    ------
    UsageError
        There is no such effect, or the model has it already; or `keep_aside` is not between 0 and 1.
    InputError
        No sample can be used, or the effect needs what was not measured.
    ConfigurationError
        The model file or the file of an effect is wrong, or the base cannot have the effect.
    formats.errors.CannotWriteError
        The model file cannot be written.

    Examples
    --------
    >>> trial = terrain.add_effect("wong-reece", "slip-sinkage", windows)
    >>> trial.kept
    True
    >>> terrain.estimate(windows, model=trial.model)
    """
    before = as_model(model)
    given = [effect] if isinstance(effect, str | Path) else effect
    names = models.named_from([str(name) for name in given], models.folder_of(before))
    with processes.jobs(jobs):
        windows = windows_of(data, before.model.effects, rover)
        changed = models.added(before, names, windows[0].samples.geometry.shear_modulus)
        if keep_aside is not None:
            windows = kept_aside.marked(windows, keep_aside)
        step = improvement.tried_in_forms(
            windows_of(windows, changed.file.model.effects),
            "add",
            changed,
            before,
            seed=seed,
            progress=progress or (lambda _: None),
        )
    step = replace(step, kept=step.pays or keep)
    if not step.kept:
        return EffectTrial(before, step, before.path)
    after = models.recorded(step.after, _entry(step))
    if path is None:
        return EffectTrial(after, step, before.path)
    models.save(models.moved(after, Path(path)), path)
    return EffectTrial(models.load(path), step, Path(path))
