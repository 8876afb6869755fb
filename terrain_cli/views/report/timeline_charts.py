"""The soil along the drive: strength, c and φ of each segment from its beginning to its end."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import altair as alt
import numpy as np

from terrain_cli.views import segment_groups
from terrain_cli.views.chart_style import COLOURS
from terrain_cli.views.report.chart_sheet import CHOSEN, Sheet

if TYPE_CHECKING:
    from collections.abc import Mapping

    Spec = dict[str, Any]

_QUANTITIES = (
    ("Cohesion c (kPa)", "c_kPa", "c_se_kPa"),
    ("Friction angle φ (°)", "phi_deg", "phi_se_deg"),
)
#: Times the usual error, beyond which a band may leave the picture: it would flatten all that is known.
_UNSURE = 4.0


def of_soil(table: Mapping[str, Any], chosen: str) -> list[tuple[str, Spec]]:
    """Draw each quantity along the time of the drive, with its title; nothing without time."""
    start, end = (np.asarray(table[name], dtype=float) for name in ("t_start_s", "t_end_s"))
    if not np.isfinite(start).any():
        return []
    label, _ = segment_groups.mapped_strength(table)
    strength = (
        f"{label[:1].upper()}{label[1:]}",
        "strength_at_stress_kPa",
        "strength_at_stress_se_kPa",
    )
    return [
        (title, _timeline(table, (start, end), title, (value, error), chosen))
        for title, value, error in (strength, *_QUANTITIES)
        if np.isfinite(np.asarray(table[value], dtype=float)).any()
    ]


def _timeline(
    table: Mapping[str, Any],
    times: tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]],
    title: str,
    names: tuple[str, str],
    chosen: str,
) -> Spec:
    sheet = Sheet(chosen)
    begin = np.nanmin(times[0])
    value, error = (np.asarray(table[name], dtype=float) for name in names)
    kinds = segment_groups.groups(table, len(COLOURS))
    unique = list(dict.fromkeys(kinds))
    base = sheet.chart(
        x=times[0] - begin,
        x2=times[1] - begin,
        y=value,
        e=error,
        low=value - 1.96 * error,
        high=value + 1.96 * error,
        s=np.asarray(table["key"]),
        name=np.asarray(table["name"]),
        kind=kinds,
        status=[str(status) for status in table["status"]],
    ).encode(
        x=alt.X("x:Q", title="time since the start (s)", scale=alt.Scale(zero=False, nice=False)),
        x2="x2:Q",
        tooltip=[
            alt.Tooltip("name:N", title="segment"),
            alt.Tooltip("y:Q", title=title),
            alt.Tooltip("e:Q", title="± s.e."),
            alt.Tooltip("status:N"),
        ],
    )
    known = np.isfinite(value)
    sure = known & np.isfinite(error)
    if sure.any():
        sure &= error <= np.median(error[sure]) * _UNSURE
    ends = np.concatenate([value[known], (value - 1.96 * error)[sure], (value + 1.96 * error)[sure]])
    scale = alt.Scale(domain=[float(np.nanmin(ends)), float(np.nanmax(ends))], zero=False)
    y = alt.Y("y:Q", title=title, scale=scale)
    colours = alt.Scale(domain=unique, range=list(COLOURS[: len(unique)]))
    # One name for all is no legend.
    legend = alt.Legend(title=None) if len(unique) > 1 else None
    colour = alt.Color("kind:N", scale=colours, legend=legend)
    # What is not ok is faint, as in the other pictures.
    opacity = alt.condition("datum.status == 'ok'", alt.value(1.0), alt.value(0.35))
    band = base.mark_rect(opacity=0.16, clip=True).encode(
        y=alt.Y("low:Q", title=title, scale=scale), y2="high:Q", color=colour
    )
    lines = base.mark_rule(strokeWidth=4, clip=True).encode(y=y, color=colour, opacity=opacity)
    marked = base.mark_rule(strokeWidth=9, color=CHOSEN, clip=True).encode(y=y)
    return sheet.finished([band, marked.transform_filter("datum.s == segment"), lines], 220)
