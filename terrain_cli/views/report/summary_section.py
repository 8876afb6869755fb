"""The top of the page: what the data say of the model, what to do next, and the errors behind it."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING

from terrain_cli.presentation import comparison_text
from terrain_cli.views import sample_pairs
from terrain_cli.views.report.page_parts import Section, Table
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.quantities import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.comparison.comparison_outcome import Comparison

#: Inputs that are named in a command; more are "…".
_NAMED = 3
_NOTE = (
    "In the unit of the channel. Held out: on stretches that were not fitted. Noise: the part of the error "
    "that no model could predict. Bias: the mean of measured less predicted. Normalised: the rms error by "
    "the rms of what was measured."
)


def summary(comparison: Comparison, statuses: Sequence[str]) -> Section:
    """Return the section; `statuses` are those of every segment."""
    concluded = comparison_text.concluded(comparison)
    effects = comparison.model.get("effects") or []
    with_effects = f" with {', '.join(map(str, effects))}" if effects else " without added effects"
    inputs = list(dict.fromkeys(wheel.source for wheel in comparison.wheels))
    n = sum(len(wheel.windows.rows) for wheel in comparison.wheels)
    fitted = (
        f"The model {comparison.model['base']}{with_effects} was fitted to {n:,} samples of "
        f"{counted(len(comparison.wheels), 'wheel')} from {counted(len(inputs), 'input')}, "
        f"in {counted(len(statuses), 'segment')}."
    )
    fine = sum(status == "ok" for status in statuses)
    verb = "has" if fine == 1 else "have"
    usable = f"{fine or 'None'} of {counted(len(statuses), 'segment')} {verb} the status ok."
    if len(statuses) == 1:
        usable = f"The segment has the status {statuses[0]}."
    points = [sentence(finding.sentence) for finding in comparison.failures[:5]]
    points += [sentence(f"Note: {warning}") for warning in comparison.warnings]
    return Section(
        id="summary",
        title="Summary",
        text=[f"{usable} {fitted}"],
        points=points,
        parts=[_errors(comparison)],
        lead=concluded.sentence.removesuffix(f" Next: {concluded.command}"),
        command=concluded.command or _command(comparison, inputs, fits=concluded.state == "fits"),
    )


def _command(comparison: Comparison, inputs: Sequence[str], *, fits: bool) -> str:
    """Return the command where a conclusion has none: of a model that fits, or of too few data."""
    named = [*map(shlex.quote, inputs[:_NAMED]), *["…"] * (len(inputs) > _NAMED)]
    model = " --model FILE" if comparison.model.get("effects") else ""
    return f"terrain-est {'estimate' if fits else 'diagnose'} {' '.join(named)}{model}"


def _errors(comparison: Comparison) -> Table:
    rows = []
    for name in sample_pairs.channels(comparison):
        errors = comparison.channels[name]
        what = quantities.quantity(name, errors.unit)
        rms, bias, noise, out, low, high = (
            quantities.number(value * what.factor)
            for value in (
                *(errors.rmse, errors.bias, errors.noise),
                *(errors.heldout_rmse, errors.heldout_low, errors.heldout_high),
            )
        )
        interval = out if low == "–" else f"{out} ({low} to {high})"
        ratio = f"{quantities.number(errors.heldout_rmse / errors.noise, 2)} ×" if errors.noise > 0.0 else "–"
        normalised = quantities.number(errors.nrmse)
        rows.append((what.label, ratio, interval, noise, rms, bias, normalised, f"{errors.n:,}"))
    head = (
        *("Channel", "held out / noise", "held out (95 %)", "noise"),
        *("rms error", "bias", "normalised", "Samples"),
    )
    return Table("Errors of the prediction", head, rows, frozenset(range(1, len(head))), _NOTE)


def sentence(text: str) -> str:
    """Write a text as a sentence: with a capital, and one full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."
