"""The section in which a reader chooses a model and sees its errors and misfit, and its history."""

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

import numpy as np

from terrain_cli.improvement.change_trial import Alternative
from terrain_cli.improvement.improvement_outcome import ChannelChange
from terrain_cli.improvement.model_history import Rung, channels, refusals, rungs
from terrain_cli.presentation import change_text
from terrain_cli.views import shown_samples
from terrain_cli.views.chart_style import COLOURS, FAINT, INK, measured, top
from terrain_cli.views.report.page_parts import (
    CHOSEN,
    Chart,
    Section,
    Sheet,
    Spec,
    Table,
    either,
    encoded,
    scale,
    tips,
)
from terrain_cli.views.shown_samples import Band
from terrain_cli.vocabulary import quantities
from terrain_cli.vocabulary.quantities import Quantity, counted

_MOST_DRIVERS = 2  # Drivers shown for each channel: those of its findings come first
#: Characters in a line of a model's name beside a picture.
_LINE = 27
_TEXT = (
    "Choose a model at the top of the page. The pictures below then show its errors and residuals. All "
    "models are fitted to the same samples, and their errors are those on stretches that were left out of "
    "the fit. A name that begins with + is the model of this page with one more effect."
)


def choices(models: Sequence[Alternative]) -> tuple[list[tuple[str, str]], str]:
    """Return key and label of each model, and the key of the one that the page is about."""
    labels = [f"{one.label}{' (this page)' if one.own else ''}" for one in models]
    return [(str(key), label) for key, label in enumerate(labels)], str(_own(models))


def _own(models: Sequence[Alternative]) -> int:
    return next(key for key, one in enumerate(models) if one.own)


def section(models: Sequence[Alternative]) -> Section:
    """Return the section; empty, so not shown, where there is no model to choose."""
    title = "Model by model"
    if len(models) < 2:
        return Section(id="models", title=title)
    own = models[_own(models)].comparison
    parts: list[Table | Chart] = []
    for name, what in shown_samples.channels(own).items():
        parts.append(_errors(models, name, what))
        parts += _misfits(models, name, what)
    return Section(id="models", title=title, text=[_TEXT], parts=[_table(models), *parts])


def _table(models: Sequence[Alternative]) -> Table:
    head, rows = ["Model"], [[label] for _, label in choices(models)[0]]
    for name, what in shown_samples.channels(models[_own(models)].comparison).items():
        head += [f"Held-out error of {what.symbol}{what.in_unit}", "× noise"]
        for row, one in zip(rows, models, strict=True):
            errors = one.comparison.channels[name]
            row += [
                quantities.number(errors.heldout_rmse * what.factor),
                f"{errors.heldout_rmse / errors.noise:.2f}" if errors.noise > 0.0 else "–",
            ]
    note = (
        "Noise is estimated with each model: the part of the error that it treats as unpredictable. A wrong "
        "model may count some of its misfit as noise."
    )
    return Table("Held-out errors, model by model", head, rows, frozenset(range(1, len(head))), note)


def _errors(models: Sequence[Alternative], name: str, what: Quantity) -> Chart:
    keys = [str(key) for key in range(len(models))]
    held_out = [one.comparison.channels[name] for one in models]
    sheet = Sheet(str(_own(models)), "model")
    # Models differ at the end of their names, which must be seen. Empty lines keep short ones in the middle.
    wrapped = [wrap(one.label, _LINE) for one in models]
    lines = max(map(len, wrapped))
    labels = ["\n" * ((lines - len(one)) // 2) + "\n".join(one) for one in wrapped]
    value, low, high, noise = (
        [getattr(one, column) * what.factor for one in held_out]
        for column in ("heldout_rmse", "heldout_low", "heldout_high", "noise")
    )
    # Short: names take the half of the width.
    title = f"held-out{what.in_unit}"
    names = {"labelLimit": 220, "labelOffset": -6.5 * (lines - 1), "labelExpr": r"split(datum.label, '\n')"}
    y = encoded("label:N", sort=None, title=None, axis=names)
    colour = either("datum.k == model", CHOSEN, COLOURS[0])
    base = sheet.chart(label=labels, k=keys, value=value, low=low, high=high, noise=noise)
    base = base.encode(y=y, color=colour)
    ends = scale(0.0, 1.08 * float(np.nanmax([*value, *high, *noise])))
    x = encoded("value:Q", title=title, scale=ends)
    told = tips(label="model", value=title, low="2.5 %", high="97.5 %", noise="noise")
    layers = [
        base.mark("tick", thickness=1.5, size=18).encode(x=encoded("noise:Q"), color={"value": INK}),
        base.mark("rule", clip=True).encode(x=encoded("low:Q", title=title), x2={"field": "high"}),
        base.mark("point", filled=True, size=80, opacity=1.0).encode(x=x, tooltip=told),
    ]
    every = "; ".join(f"{one.label}: {quantities.number(v)}" for one, v in zip(models, value, strict=True))
    return Chart(
        f"Held-out error of {what.words} (tick: noise)",
        f"Held-out rms error of {what.words}{what.in_unit} of each model. {every}.",
        sheet.finished(layers, 40 + (13 + 13 * lines) * len(models)),
    )


def _misfits(models: Sequence[Alternative], name: str, what: Quantity) -> list[Chart]:
    own = models[_own(models)].comparison
    pooled = shown_samples.pairs(own, name)
    charts = []
    for driver in shown_samples.drivers(own, name, pooled, _MOST_DRIVERS):
        along = shown_samples.driver(own, driver, pooled)
        if along.labels:
            continue
        bands = []
        for one in models:
            pairs = shown_samples.pairs(one.comparison, name)
            bands.append(
                shown_samples.band(shown_samples.driver(one.comparison, driver, pairs).values, pairs.residual)
            )
        charts.append(
            Chart(
                f"Residual of {what.words} against {along.quantity.words}, by model",
                f"Median and 5 to 95 % of measured less predicted {what.words} over {along.quantity.words}, "
                "for the model that is chosen; the dotted line is the median of the model of this page.",
                _misfit(bands, along.quantity.label, what.in_unit, str(_own(models))),
            )
        )
    return charts


def _misfit(bands: Sequence[Band], axis: str, in_unit: str, own: str) -> Spec:
    sheet = Sheet(own, "model")
    columns = [np.concatenate(column) for column in zip(*bands, strict=True)]
    key = np.repeat(np.arange(len(bands)).astype(str), [len(one.centre) for one in bands])
    centre, low, median, high = columns
    y = encoded(
        "median:Q", title=f"measured − predicted{in_unit}", scale=scale(*shown_samples.limits(low, high))
    )
    x = encoded("x:Q", title=axis, scale=scale(*shown_samples.limits(centre)))
    every = sheet.chart(x=centre, low=low, median=median, high=high, k=key).encode(x=x)
    chosen = every.where("datum.k == model")
    told = tips(x=axis, median="median", low="5 %", high="95 %")
    reference = every.where(f"datum.k == '{own}'")
    own_median = reference.mark("line", color=FAINT, strokeDash=[3, 3], clip=True).encode(y=y)
    return sheet.finished([own_median, *sheet.followed(chosen, y, told)], 210)


def history(entries: Sequence[Mapping[str, Any]]) -> Section:
    """Return what the page shows of [[history]] of a model file; empty, so not shown, without any."""
    if not entries:
        return Section(id="history", title="How the model came about")
    ladder = rungs(entries)
    head, rows = change_text.ladder(ladder)
    note = (
        "rms errors when the change was tried, on the stretches that were left out then. The rest of this "
        "page leaves out others, on which the errors of the same model differ a little."
    )
    head = [word.capitalize() for word in head]
    table = Table("Held-out errors, change by change", head, rows, frozenset(range(3, 8)), note)
    charts = [_rungs(ladder, name) for name in channels(ladder)]
    points = [f"{remark}." for remark in (*change_text.remarks(ladder), *refusals(entries))]
    return Section(id="history", title="How the model came about", points=points, parts=[*charts, table])


def _rungs(ladder: Sequence[Rung], name: str) -> Chart:
    known = measured(ladder, name)
    what = quantities.quantity(name, known[0][1].unit)
    first, last = known[0][1].before.value, known[-1][1].after.value
    told = " to ".join(f"{quantities.number(value * what.factor)} {what.unit}" for value in (first, last))
    return Chart(
        f"Held-out error of {what.words}",
        f"Held-out rms error of {what.words} before and after {counted(len(known), 'change')}: from {told}.",
        _ladder(known, what),
    )


def _ladder(known: Sequence[tuple[Rung, ChannelChange]], what: Quantity) -> Spec:
    steps = [str(rung.number) for rung, _ in known]
    columns: dict[str, list[Any]] = {n: [] for n in ("step", "label", "when", "value", "low", "high")}
    for step, (rung, one) in zip(steps, known, strict=True):
        for when, interval in (("before", one.before), ("after", one.after)):
            numbers = (v * what.factor for v in interval)
            for column, cell in zip(columns.values(), (step, rung.label, when, *numbers), strict=True):
                column.append(cell)
    sheet = Sheet()
    # By their numbers: names as long as some are do not fit under several steps.
    x = encoded("step:N", sort=None, title="change, as numbered above", axis={"labelAngle": 0})
    aside = encoded("when:N", sort=["before", "after"], scale={"paddingOuter": 0.6})
    # Of one title and one domain, so that they share a legend.
    sides: dict[str, Any] = {"domain": ["before", "after"]}
    legend = {"title": "held-out; bar: noise"}
    kind = {
        "shape": encoded("when:N", scale={**sides, "range": ["circle", "square"]}, legend=legend),
        "fill": encoded("when:N", scale={**sides, "range": ["white", COLOURS[0]]}, legend=legend),
    }
    title = f"rms error{what.in_unit}"
    y = encoded("value:Q", title=title, scale=scale(0.0, top(known) * what.factor))
    told = tips(label="change", when=" ", value="held-out error", low="2.5 %", high="97.5 %")
    base = sheet.chart(**columns).encode(x=x, xOffset=aside)
    bars = base.mark("rule", color=COLOURS[0], clip=True).encode(
        y=encoded("low:Q", title=title), y2={"field": "high"}
    )
    points = base.mark("point", stroke=COLOURS[0], size=60, opacity=1.0).encode(y=y, tooltip=told, **kind)
    noise = sheet.chart(step=steps, noise=[one.noise * what.factor for _, one in known])
    level = noise.mark("tick", color=INK, thickness=1.5, strokeDash=[2, 2]).encode(
        x=x, y=encoded("noise:Q"), tooltip=tips(noise=f"noise{what.in_unit}")
    )
    return sheet.finished([level, bars, points], 220)
