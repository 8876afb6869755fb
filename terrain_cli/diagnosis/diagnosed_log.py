"""The first steps of a diagnosis: the number of soils, the fit of the model as it is, and the scores."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from terrain_cli.comparison import Comparison, Finding, blocks, comparison_criteria
from terrain_cli.comparison.compare import of_fitted, on_few_soils, scale_of
from terrain_cli.comparison.comparison_outcome import with_refused
from terrain_cli.comparison.findings import Residuals
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import refits, screening, several_soils
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis, NotTestable
from terrain_cli.diagnosis.refits import Ground
from terrain_cli.diagnosis.screening import Screened
from terrain_cli.effects import Effect
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.models import ModelFile
from terrain_cli.telemetry.long_logs import notes
from terrain_cli.vocabulary.arrays import Index
from terrain_cli.windows import joined_inputs
from terrain_cli.windows.cut_windows import Windows


@dataclass(frozen=True, kw_only=True)
class Case:
    """What is asked: the model, and the effects that it may lack."""

    file: ModelFile
    effects: list[Effect]
    seed: int
    progress: Callable[[str], None]
    smallest_share: float = 0.0  # Of a channel, that is worth an alarm


@dataclass(frozen=True, kw_only=True)
class DiagnosedLog:
    """What is known of the data before any effect is fitted."""

    data: Ground  # The samples on the soils that were chosen, with the model as it is
    block: list[Index]  # shape (n,): block of every usable sample of each wheel
    comparison: Comparison  # Of the model as it is, each segment on a soil of its own
    hypotheses: Sequence[Hypothesis]
    not_testable: list[NotTestable]
    failures: list[Finding] = field(default_factory=list)  # Where the model fails on these soils
    found: Screened = field(default_factory=Screened)  # The scores of all effects, from the step `scores` on
    soils_are_better: bool = False  # Than any effect on these: than one that takes off most of what they do

    def on_changing_soil(self) -> Self:
        """Take out what cannot be told from a soil that changes along the drive."""
        hypotheses, alike = screening.on_changing_soil(self.hypotheses)
        return replace(self, hypotheses=hypotheses, not_testable=[*self.not_testable, *alike])


def soils(case: Case, wheels: Sequence[Windows]) -> DiagnosedLog:
    """Fit the model, and find how many soils the data speak for."""
    read = notes([windows.samples for windows in wheels])
    joined = joined_inputs.by_wheel(wheels, [*case.file.model.effects, *case.effects])
    settings = FitSettings.of(joined, case.file)
    further = tuple(dict.fromkeys(name for effect in case.effects for name in effect.reads))
    few, warnings = on_few_soils(joined, case.file.model, settings, further=further, progress=case.progress)
    warnings = [*read, *warnings]
    comparison = of_fitted(few, seed=case.seed, warnings=warnings, progress=case.progress)
    needed, steps, cut = several_soils.on_more(comparison, few, case.file, case.effects, case.progress)
    if steps:
        warnings = [*warnings, *steps]
        comparison = of_fitted(needed, seed=case.seed, warnings=warnings, progress=case.progress)
    block = [one.blocks for one in comparison.wheels]
    hypotheses, not_testable = screening.hypotheses(case.file, needed, case.effects)
    cut = cut or refits.ground(needed, block, several_soils.MOST_SAMPLES)
    case.progress("one soil or several")
    chosen, own, instead = several_soils.on_fewer(cut, block, hypotheses, case.progress)
    log = DiagnosedLog(
        data=chosen,
        block=own,
        comparison=with_refused(comparison, case.file, wheels),
        hypotheses=hypotheses,
        not_testable=not_testable,
        soils_are_better=instead is not None and not instead.as_good,
    )
    return log.on_changing_soil() if any(wheel.one_soil for wheel in chosen.wheels) else log


def scores(case: Case, log: DiagnosedLog) -> DiagnosedLog:
    """Score every effect without a refit, on blocks long enough to be unrelated."""
    case.progress("scoring every effect")
    found = screening.screen(log.data.wheels, log.block, log.hypotheses, case.seed)
    fitted = [wheel.fit for wheel in log.data.wheels]
    other_soils = any(one.fit is not fit for one, fit in zip(log.comparison.wheels, fitted, strict=True))
    if other_soils and (longer := _longer_blocks(log, found)):
        log = longer
        found = screening.screen(log.data.wheels, log.block, log.hypotheses, case.seed)
    first = max(log.hypotheses, key=lambda one: found.explained.get(one.id, 0.0), default=None)
    doubtful = min(found.p_values.values(), default=0.0) >= criteria.LEVEL
    if first and found.lasting and (doubtful or screening.follows_passes(first)):
        known = log.data, log.block, log.hypotheses
        after, changes = several_soils.scored_once_fitted(*known, first, case.seed)
        if changes:
            return scores(case, log.on_changing_soil())
        found = after if doubtful else found
    failures = _findings(log, case.seed) if other_soils else log.comparison.failures
    return replace(log, found=found, failures=failures, not_testable=[*log.not_testable, *found.not_testable])


def _longer_blocks(log: DiagnosedLog, found: Screened) -> DiagnosedLog | None:
    """Join blocks whose scores are related; None where runs are blocks, or none are related."""
    count = len(found.blocks)
    runs = [wheel.windows.samples.labels.get("run") for wheel in log.data.wheels]
    if any(label is not None and len(label.names) >= comparison_criteria.ENOUGH_RUNS for label in runs):
        return None
    label = blocks.merged(
        found.blocks,
        np.zeros(count, dtype=np.intp),
        fewest=min(comparison_criteria.FEWEST_BLOCKS, count),
        independent=criteria.UNRELATED_SCORES,
    )
    if int(label.max(initial=0)) + 1 == count:
        return None
    data = replace(
        log.data,
        block=[label[one] for one in log.data.block],
        data=[replace(part, blocks=int(label.max()) + 1) for part in log.data.data],
    )
    return replace(log, data=data, block=[label[one] for one in log.block])


def _findings(log: DiagnosedLog, seed: int) -> list[Finding]:
    """Search the residuals on other soils for findings."""
    wheels: Sequence[FittedWheel] = log.data.wheels
    levels = {name: errors.noise for name, errors in log.comparison.channels.items()}
    names = [name for name in levels if any(name in wheel.measured for wheel in wheels)]
    scale = {name: size for name in names if (size := scale_of(wheels, name, np.nan)) > 0.0}
    return Residuals(wheels, log.block, scale).findings(levels, seed) if scale else []
