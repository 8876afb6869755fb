"""Sections that are read: the summary at the top of the page, and the history of the model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from terrain_cli.improvement.model_history import Rung, channels, rungs
from terrain_cli.presentation import comparison_text
from terrain_cli.views import ladder_table as views
from terrain_cli.views import shown_samples
from terrain_cli.views.report.page_parts import Chart, Section, Table
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.quantities import counted

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from terrain_cli.comparison.comparison_outcome import Comparison
    from terrain_cli.diagnosis.conclusion import Asked

    Spec = dict[str, Any]

_NOTE = (
    "In the unit of the channel. Held out: on stretches that were not fitted. Noise: the part of the error "
    "that no model could predict. Bias: the mean of measured less predicted. Normalised: the rms error by "
    "the rms of what was measured."
)
#: In pixels.
_HEIGHT = 220


def summary(comparison: Comparison, statuses: Sequence[str], asked: Asked | None = None) -> Section:
    """Return the section; `statuses` are those of every segment."""
    concluded = comparison_text.concluded(comparison, asked)
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
        command=concluded.command or comparison_text.looked_at(concluded, comparison, asked),
    )


def _errors(comparison: Comparison) -> Table:
    rows = []
    for name in shown_samples.channels(comparison):
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


def history(entries: Sequence[Mapping[str, Any]]) -> Section:
    """Return what the page shows of [[history]] of a model file; empty, so not shown, without any."""
    if not entries:
        return Section(id="history", title="How the model came about")
    ladder = rungs(entries)
    head, rows = views.table(ladder)
    note = "rms errors on stretches of the data that were not fitted, before and after each change."
    table = Table(
        "Held-out errors, change by change", [word.capitalize() for word in head], rows, _FIGURES, note
    )
    charts = [_chart(ladder, name) for name in channels(ladder)]
    points = [f"{remark}." for remark in views.remarks(ladder)]
    return Section(id="history", title="How the model came about", points=points, parts=[*charts, table])


_FIGURES = frozenset(range(3, 8))


def _chart(ladder: Sequence[Rung], name: str) -> Chart:
    known = views.measured(ladder, name)
    what = quantities.quantity(name, known[0][1].unit)
    first, last = known[0][1].before.value, known[-1][1].after.value
    told = " to ".join(f"{quantities.number(value * what.factor)} {what.unit}" for value in (first, last))
    return Chart(
        f"Held-out error of {what.words}",
        f"Held-out rms error of {what.words} before and after {counted(len(known), 'change')}: from {told}.",
        _spec(ladder, name),
    )


def _spec(ladder: Sequence[Rung], name: str) -> Spec:
    import altair as alt

    from terrain_cli.views.chart_style import COLOURS, INK
    from terrain_cli.views.report.sample_charts import Sheet, scale, tips

    known = views.measured(ladder, name)
    what = quantities.quantity(name, known[0][1].unit)
    steps = [f"{rung.number} {rung.label}" for rung, _ in known]
    columns: dict[str, list[Any]] = {"step": [], "when": [], "value": [], "low": [], "high": []}
    for step, (_, one) in zip(steps, known, strict=True):
        for when, interval in (("before", one.before), ("after", one.after)):
            numbers = (v * what.factor for v in interval)
            for column, cell in zip(columns.values(), (step, when, *numbers), strict=True):
                column.append(cell)
    sheet = Sheet()
    x = alt.X("step:N", sort=None, title=None, axis=alt.Axis(labelAngle=-25, labelLimit=200))
    aside = alt.XOffset("when:N", sort=["before", "after"], scale=alt.Scale(paddingOuter=0.6))
    # Of one title and one domain, so that they share a legend.
    sides: dict[str, Any] = {"domain": ["before", "after"]}
    legend = alt.Legend(title="held-out; bar: noise")
    kind = {
        "shape": alt.Shape("when:N", scale=alt.Scale(**sides, range=["circle", "square"]), legend=legend),
        "fill": alt.Fill("when:N", scale=alt.Scale(**sides, range=["white", COLOURS[0]]), legend=legend),
    }
    title = f"rms error{what.in_unit}"
    y = alt.Y("value:Q", title=title, scale=scale(0.0, views.top(known) * what.factor))
    told = tips(step="change", when=" ", value="held-out error", low="2.5 %", high="97.5 %")
    base = sheet.chart(**columns).encode(x=x, xOffset=aside)
    bars = base.mark_rule(color=COLOURS[0], clip=True).encode(y=alt.Y("low:Q", title=title), y2="high:Q")
    points = base.mark_point(stroke=COLOURS[0], size=60, opacity=1.0).encode(y=y, tooltip=told, **kind)
    noise = sheet.chart(step=steps, noise=[one.noise * what.factor for _, one in known])
    level = noise.mark_tick(color=INK, thickness=1.5, strokeDash=[2, 2]).encode(
        x=x, y="noise:Q", tooltip=tips(noise=f"noise{what.in_unit}")
    )
    return sheet.finished([level, bars, points], _HEIGHT)
