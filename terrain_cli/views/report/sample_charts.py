"""Charts of samples: predicted against measured, and the misfit against its drivers."""

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

#: Points drawn one by one, and those kept to show a segment over counts.
MOST_POINTS = 2_500
#: The same beside a driver, of which there are many.
MOST_BESIDE = 400
#: Steps, in usual ones, that are a gap.
_GAP = 8.0


def _counts(sheet: Sheet, x: Array, y: Array) -> alt.Chart:
    grid = binning.grid(x, y, 50, square=True)
    row, column = np.nonzero(grid.counts)
    chart: alt.Chart = (
        sheet.chart(
            x=grid.x[column],
            x2=grid.x[column + 1],
            y=grid.y[row],
            y2=grid.y[row + 1],
            n=grid.counts[row, column].astype(int),
        )
        .mark_rect()
        .encode(
            x=alt.X("x:Q"),
            x2="x2:Q",
            y=alt.Y("y:Q"),
            y2="y2:Q",
            color=alt.Color(
                "n:Q",
                scale=alt.Scale(type="log", scheme="greys"),
                legend=alt.Legend(title="samples", tickCount=3),
            ),
            tooltip=[alt.Tooltip("n:Q", title="samples")],
        )
    )
    return chart


def agreement(pooled: Pairs, label: str, keys: Text, names: Text, chosen: str) -> Spec:
    """Draw predicted against measured, with the chosen segment marked.

    Parameters
    ----------
    label : str
        Of the channel, with its unit.
    keys, names : ndarray of str, shape (segments,)
        By which a segment is chosen, and what it is called.
    chosen : str
        Key of the segment marked at first.
    """
    sheet = Sheet(chosen)
    low, high = binning.limits(pooled.measured, pooled.predicted)
    x = alt.X("x:Q", title=f"measured {label}", scale=scale(low, high))
    y = alt.Y("y:Q", title=f"predicted {label}", scale=scale(low, high))
    kept = pooled.take(binning.some(len(pooled.measured), MOST_POINTS))
    points = sheet.chart(
        x=kept.measured,
        y=kept.predicted,
        s=keys[kept.segment],
        name=names[kept.segment],
    ).encode(
        x=x,
        y=y,
        tooltip=[
            alt.Tooltip("name:N", title="segment"),
            alt.Tooltip("x:Q", title="measured"),
            alt.Tooltip("y:Q", title="predicted"),
        ],
    )
    if len(kept.measured) < len(pooled.measured):
        background = _counts(sheet, pooled.measured, pooled.predicted).encode(x=x, y=y)
    else:
        background = points.mark_point(size=14, color=FAINT, opacity=0.7)
    line = sheet.chart(x=[low, high], y=[low, high]).mark_line(color=INK, strokeWidth=1)
    marked = points.mark_point(size=26, color=CHOSEN, filled=True).transform_filter("datum.s == segment")
    return sheet.finished([background.interactive(name="zoom"), line.encode(x=x, y=y), marked], 320)


def course(
    along: Array, axis: str, pairs: Pairs, label: str, keys: Text, chosen: str, *, driven: bool
) -> Spec:
    """Draw measured and predicted values along the chosen segment.

    Parameters
    ----------
    along : ndarray, shape (n,)
        Time; the slip of steady test points, or their number.
    axis : str
        Title of this axis.
    pairs : Pairs
        Of the same samples.
    label, keys, chosen
        As for `agreement`.
    driven : bool
        Whether the samples were driven in the order of `along`: the prediction is a line then.
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


def residual(along: Along, pooled: Pairs, label: str, noise: float, keys: Text, chosen: str) -> Spec:
    """Draw the residual against a driver: its median, the band of 5 to 95 %, the noise, the chosen segment.

    Parameters
    ----------
    along : Along
        The driver.
    pooled : Pairs
        Of the same samples.
    label : str
        Of the channel, with its unit.
    noise : float
        Standard deviation, in the unit of the residual.
    keys, chosen
        As for `agreement`.
    """
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
    marked = points.mark_circle(size=24, color=CHOSEN, clip=True).transform_filter("datum.s == segment")
    return sheet.finished([*layers, marked], 210)
