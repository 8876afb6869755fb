"""The sheet on which charts are drawn, and the charts of samples.

Each is a Vega-Lite specification and listens to a control of the page, `#segment` or `#model`, so that the
keyboard reaches it and no script stands between.
"""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import altair as alt
import numpy as np

from terrain_cli.views import shown_samples
from terrain_cli.views.chart_style import COLOURS, FAINT, INK, MEDIAN

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from terrain_cli.views.shown_samples import Along, Pairs
    from terrain_cli.vocabulary.arrays import Array

    Spec = dict[str, Any]
    Text = NDArray[np.str_]

#: Marks the chosen segment in all charts at once: told apart from the groups and from the scale.
CHOSEN = "#AA3377"
#: Points drawn one by one beside a driver, of which there are many.
MOST_BESIDE = 400
#: Steps, in usual ones, that are a gap.
_GAP = 8.0
#: Fields that are no numbers.
_TEXTS = frozenset({"name", "status", "label", "step", "when"})


def rows(**columns: Sequence[Any] | NDArray[Any]) -> list[dict[str, Any]]:
    """Turn columns into records: five digits, null where not known."""
    lists = [_plain(column) for column in columns.values()]
    return [dict(zip(columns, record, strict=True)) for record in zip(*lists, strict=True)]


def _plain(column: Sequence[Any] | NDArray[Any]) -> list[Any]:
    values = np.asarray(column)
    if values.dtype.kind != "f":
        return list(values.tolist())
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values.tolist()]


class Sheet:
    """A chart being drawn: its data, kept apart from its encodings, and what is chosen at first.

    `control` is the one that chooses: "segment" or "model".
    """

    def __init__(self, chosen: str | None = None, control: str = "segment") -> None:
        self._datasets: dict[str, list[dict[str, Any]]] = {}
        self._chosen, self._control = chosen, control

    def chart(self, **columns: Sequence[Any] | NDArray[Any]) -> alt.Chart:
        name = f"data-{len(self._datasets)}"
        self._datasets[name] = rows(**columns)
        # Altair would look at every value if it had them.
        return alt.Chart(alt.NamedData(name=name))

    def finished(self, layers: Sequence[alt.Chart], height: int, width: int | str = "container") -> Spec:
        """Return the layers, from the lowest to the highest, as one specification; sizes are in pixels."""
        spec: Spec = alt.layer(*layers).to_dict(validate=False)
        # The schema's address is no use to a page that is not to look anything up.
        spec.pop("$schema", None)
        # Each of these, set by Altair, is a copy of the whole chart.
        if self._chosen is not None:
            bind = alt.BindDirect(element=f"#{self._control}", event="change")
            choice = alt.VariableParameter(name=self._control, value=self._chosen, bind=bind)
            spec["params"] = [*spec.get("params", []), choice.to_dict(validate=False)]
        size = {"width": width, "height": height, "background": "transparent"}
        return {**spec, **size, "config": _settings(), "datasets": self._datasets}


@cache
def _settings() -> Spec:
    """Return how all charts look."""
    chart = (
        alt.Chart(alt.NamedData(name="any"))
        .mark_point()
        .configure(aria=False, font="system-ui, DejaVu Sans, Arial, sans-serif")
        .configure_view(stroke=None)
        .configure_axis(
            gridColor=FAINT,
            gridOpacity=0.25,
            labelColor=INK,
            labelFontSize=11,
            titleColor=INK,
            titleFontSize=12,
            titleFontWeight="normal",
        )
        .configure_legend(
            labelColor=INK,
            titleColor=INK,
            titleFontWeight="normal",
            labelFontSize=11,
            titleFontSize=12,
            labelLimit=180,
            orient="bottom",
            columns=3,
        )
    )
    settings: Spec = chart.to_dict(validate=False)["config"]
    return settings


def scale(low: float, high: float) -> alt.Scale:
    """Return an axis that ends where it is told to."""
    return alt.Scale(domain=[float(low), float(high)], nice=False, zero=False)


def tips(**titles: Any) -> list[alt.Tooltip]:
    """Return what a mark tells when it is pointed at: its fields, each under a title."""
    return [alt.Tooltip(f"{name}:{'N' if name in _TEXTS else 'Q'}", title=t) for name, t in titles.items()]


def course(
    along: Array, axis: str, pairs: Pairs, label: str, keys: Text, chosen: str, *, driven: bool
) -> Spec:
    """Draw measured and predicted values along the chosen segment, by time, slip or the number of the sample.

    Where the samples were `driven` in that order, the prediction is a line. `keys`, of the segments, choose
    one.
    """
    sheet = Sheet(chosen)
    # A line does not bridge what was not driven.
    step = np.diff(along)
    usual = np.median(np.abs(step)) if len(step) else 0.0
    wide = (np.diff(pairs.segment) == 0) & (step > _GAP * usual)
    gaps = np.flatnonzero(wide & driven) + 1
    measured, predicted = (np.insert(column, gaps, np.nan) for column in (pairs.measured, pairs.predicted))
    base = (
        sheet.chart(
            x=np.insert(along, gaps, along[gaps]),
            m=measured,
            p=predicted,
            s=np.insert(keys[pairs.segment], gaps, keys[pairs.segment[gaps]]),
        )
        .transform_filter("datum.s == segment")
        .encode(
            x=alt.X("x:Q", title=axis, scale=alt.Scale(zero=False, padding=0 if driven else 10)),
            tooltip=tips(x=axis, m="measured", p="predicted"),
        )
    )
    kinds = alt.Scale(domain=["measured", "predicted"], range=[INK, MEDIAN])

    colour = alt.Color("what:N", title=None, scale=kinds)

    def shown(kind: str, field: str) -> alt.Chart:
        y = alt.Y(f"{field}:Q", title=label, scale=alt.Scale(zero=False))
        return base.transform_calculate(what=f"'{kind}'").encode(y=y, color=colour)

    dots = shown("measured", "m").mark_point(size=12).interactive(name="zoom")
    other = shown("predicted", "p")
    other = other.mark_line(strokeWidth=1.6) if driven else other.mark_point(shape="cross", size=40)
    return sheet.finished([dots, other], 320)


def residual(
    along: Along, pooled: Pairs, label: str, noise: float, keys: Text, chosen: str, *, height: int = 210
) -> Spec:
    """Draw the residual against a driver: its median, the band of 5 to 95 %, the noise, the segment."""
    sheet = Sheet(chosen)
    values, axis = pooled.residual, along.quantity.label
    known = np.flatnonzero(np.isfinite(along.values))
    kept = known[shown_samples.some(len(known), MOST_BESIDE)]
    low, high = shown_samples.limits(np.percentile(values[known], [0.3, 50.0, 99.7]), np.zeros(1), margin=0.1)
    y = alt.Y("y:Q", title=f"measured − predicted {label}", scale=scale(low, high))
    if along.labels:
        x = alt.X("x:N", title=axis, sort=None, axis=alt.Axis(labelAngle=0, labelLimit=90))
    else:
        x = alt.X("x:Q", title=axis, scale=scale(*shown_samples.limits(along.values[known])))

    def shown(driver: Array) -> Array | Text:
        return np.array(along.labels)[driver.astype(int)] if along.labels else driver

    points = sheet.chart(x=shown(along.values[kept]), y=values[kept], s=keys[pooled.segment[kept]])
    points = points.encode(x=x, y=y)
    band = shown_samples.band(along.values, values)
    bins = sheet.chart(x=shown(band.centre), low=band.low, y=band.median, high=band.high)
    of_x = alt.Tooltip("x:N" if along.labels else "x:Q", title=axis)
    bins = bins.encode(x=x, tooltip=[of_x, *tips(y="median", low="5 %", high="95 %")])
    spread: dict[str, Any] = {"color": MEDIAN, "opacity": 0.22, "clip": True}
    middle: dict[str, Any] = {"color": MEDIAN, "clip": True}
    layers = [points.mark_circle(size=10, color=FAINT, opacity=0.6, clip=True)]
    if not along.labels:
        layers = [layers[0].interactive(name="zoom")]
    marked = points.mark_circle(size=24, color=CHOSEN, clip=True).transform_filter("datum.s == segment")
    # Below the median, which is what is to be read. A lone segment is no choice.
    layers += [marked] if len(keys) > 1 else []
    ends: dict[str, Any] = {"y": alt.Y("low:Q"), "y2": "high:Q"}
    if along.labels:
        layers.append(bins.mark_bar(size=18, **spread).encode(**ends))
        layers.append(bins.mark_point(filled=True, size=45, **middle).encode(y=y))
    else:
        layers.append(bins.mark_area(**spread).encode(**ends))
        dots = alt.OverlayMarkDef(color=MEDIAN, size=22)
        layers.append(bins.mark_line(point=dots, **middle).encode(y=y))
    layers.append(sheet.chart(y=[0.0]).mark_rule(color=INK, strokeWidth=1).encode(y="y:Q"))
    if np.isfinite(noise):
        rules = sheet.chart(y=[-1.96 * noise, 1.96 * noise])
        layers.append(
            rules.mark_rule(color=COLOURS[0], strokeWidth=1.5, strokeDash=[2, 3], clip=True).encode(y="y:Q")
        )
    return sheet.finished(layers, height)
