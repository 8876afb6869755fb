"""Charts of samples: measured and predicted along the drive, and the misfit against its drivers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import altair as alt
import numpy as np

from terrain_cli.views import binning
from terrain_cli.views.chart_style import COLOURS, FAINT, INK, MEDIAN
from terrain_cli.views.report.chart_sheet import CHOSEN, Sheet, scale

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.views.sample_pairs import Along, Pairs

    Array = NDArray[np.float64]
    Text = NDArray[np.str_]
    Spec = dict[str, Any]

#: Points drawn one by one beside a driver, of which there are many.
MOST_BESIDE = 400
#: Steps, in usual ones, that are a gap.
_GAP = 8.0


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
            tooltip=[
                alt.Tooltip("x:Q", title=axis),
                alt.Tooltip("m:Q", title="measured"),
                alt.Tooltip("p:Q", title="predicted"),
            ],
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
    kept = known[binning.some(len(known), MOST_BESIDE)]
    low, high = binning.limits(np.percentile(values[known], [0.3, 50.0, 99.7]), np.zeros(1), margin=0.1)
    y = alt.Y("y:Q", title=f"measured − predicted {label}", scale=scale(low, high))
    if along.labels:
        x = alt.X("x:N", title=axis, sort=None, axis=alt.Axis(labelAngle=0, labelLimit=90))
    else:
        x = alt.X("x:Q", title=axis, scale=scale(*binning.limits(along.values[known])))

    def shown(driver: Array) -> Array | Text:
        return np.array(along.labels)[driver.astype(int)] if along.labels else driver

    points = sheet.chart(x=shown(along.values[kept]), y=values[kept], s=keys[pooled.segment[kept]])
    points = points.encode(x=x, y=y)
    band = binning.band(along.values, values)
    bins = sheet.chart(x=shown(band.centre), low=band.low, y=band.median, high=band.high).encode(
        x=x,
        tooltip=[
            alt.Tooltip("x:N" if along.labels else "x:Q", title=axis),
            alt.Tooltip("y:Q", title="median"),
            alt.Tooltip("low:Q", title="5 %"),
            alt.Tooltip("high:Q", title="95 %"),
        ],
    )
    spread: dict[str, Any] = {"color": MEDIAN, "opacity": 0.22, "clip": True}
    middle: dict[str, Any] = {"color": MEDIAN, "clip": True}
    layers = [points.mark_circle(size=10, color=FAINT, opacity=0.6, clip=True)]
    if not along.labels:
        layers = [layers[0].interactive(name="zoom")]
    marked = points.mark_circle(size=24, color=CHOSEN, clip=True).transform_filter("datum.s == segment")
    # Below the median, which is what is to be read.
    layers.append(marked)
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
        layers.append(rules.mark_rule(color=COLOURS[0], strokeDash=[2, 3], clip=True).encode(y="y:Q"))
    return sheet.finished(layers, height)
