"""Charts of a drive: its segments in time, on maps, by soil and strength; and its samples."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_cli.views import shown_samples, shown_segments
from terrain_cli.views.chart_style import COLOURS, FAINT, INK, MEDIAN, SCALE
from terrain_cli.views.report.page_parts import CHOSEN, Layer, Sheet, Spec, either, encoded, scale, tips
from terrain_cli.views.shown_samples import Along, Pairs
from terrain_cli.vocabulary.arrays import Array

Text = NDArray[np.str_]

#: Told apart in print and without colour: one for each of `COLOURS`.
_SHAPES = ("circle", "square", "triangle-up", "diamond", "triangle-down", "cross", "triangle-right")
_DASHES = ([1, 0], [6, 3], [6, 2, 1, 2], [1, 2], [9, 3], [4, 2, 1, 2, 1, 2], [2, 2])
_MAP = 300  # Side of a map in pixels: it must fit a telephone
_MOST_ELLIPSES = 60  # With more segments than this, ellipses would hide the estimates
#: Points of all tracks on a map, and of all ellipses, that keep the page small.
_MOST_VERTICES = 1_500
_QUANTITIES = (("Cohesion c (kPa)", "c_kPa", "c_se_kPa"), ("Friction angle φ (°)", "phi_deg", "phi_se_deg"))
#: Times the usual error, beyond which a band may leave the picture: it would flatten all that is known.
_UNSURE = 4.0
MOST_BESIDE = 400  # Points drawn one by one beside a driver, of which there are many
_GAP = 8.0  # Steps, in usual ones, that are a gap


def track(table: Mapping[str, Any], values: Array, label: str, chosen: str) -> Spec:
    """Draw the chosen segment's wheel on a map, by a value: others went nearly the same way, and hide it."""
    sheet = Sheet(chosen)
    key, name = np.asarray(table["key"]), np.asarray(table["name"])
    paths = shown_segments.paths(table)
    most = max(_MOST_VERTICES // max(len(paths), 1), 3)
    paths = [
        path[np.unique(np.linspace(0, len(path) - 1, most).astype(int))] if len(path) else path
        for path in paths
    ]
    length = [len(path) for path in paths]
    every = np.concatenate(paths)
    across, up, stretch = shown_segments.frame(table, every)
    number = np.repeat(np.arange(len(paths)), length)
    titles = ("longitude (°)", "latitude (°)") if shown_segments.geographic(table) else ("x (m)", "y (m)")
    base = sheet.chart(
        x=every[:, 0],
        y=every[:, 1],
        s=key[number],
        o=np.concatenate([np.arange(n) for n in length]),
        alone=np.repeat([n == 1 for n in length], length),
        v=np.asarray(values, dtype=float)[number],
        name=name[number],
    ).encode(
        x=encoded("x:Q", title=titles[0], scale=scale(*across), axis={"tickCount": 5}),
        y=encoded("y:Q", title=titles[1], scale=scale(*up), axis={"tickCount": 5}),
        order=encoded("o:Q"),
        detail=encoded("s:N"),
        tooltip=tips(name="segment", v=label),
    )
    base = base.where("split(datum.s, ':')[0] == split(segment, ':')[0]")
    known = values[np.isfinite(values)]
    # The same for all wheels.
    ends = [float(known.min()), float(known.max())] if len(known) else [0.0, 1.0]
    if ends[0] == ends[1]:
        ends = list(shown_samples.limits(known))
    colour = encoded(
        "v:Q", scale={"scheme": SCALE, "domain": ends}, legend={"title": label, "gradientLength": _MAP - 60}
    )
    lines = base.mark("line", strokeWidth=6, strokeCap="butt").encode(color=colour).zoomed()
    # Not filled: a legend for lines and for areas at once would be no gradient.
    spots = base.mark("point", size=20, strokeWidth=5, filled=False).encode(color=colour)
    spots = spots.where("datum.alone")
    # A rim, without which one end of the scale would be lost on a dark page.
    rim = base.mark("line", strokeWidth=7.5, color=FAINT, strokeCap="butt")
    outline = base.mark("line", strokeWidth=11, color=CHOSEN).where("datum.s == segment")
    shape = (up[1] - up[0]) * stretch / (across[1] - across[0])
    width, height = (_MAP, round(_MAP * shape)) if shape < 1.0 else (round(_MAP / shape), _MAP)
    return sheet.finished([outline, rim, lines, *([spots] if 1 in length else [])], height, width)


def estimates(table: Mapping[str, Any], chosen: str) -> Spec:
    sheet = Sheet(chosen)
    key, name = np.asarray(table["key"]), np.asarray(table["name"])
    kinds = shown_segments.groups(table, len(COLOURS))
    c, phi = shown_segments.estimate_limits(table)
    x = encoded("x:Q", title="cohesion c (kPa)", scale=scale(*c))
    y = encoded("y:Q", title="friction angle φ (°)", scale=scale(*phi))
    n = len(kinds)
    points = sheet.chart(
        x=table["c_kPa"],
        y=table["phi_deg"],
        xe=table["c_se_kPa"],
        ye=table["phi_se_deg"],
        s=key,
        name=name,
        kind=kinds,
        status=[str(status) for status in table["status"]],
    ).encode(
        x=x,
        y=y,
        # What the drive does not settle is faint.
        opacity=either("datum.status == 'ok'", 1.0, 0.35),
        shape=encoded("kind:N", scale=_by_kind(_SHAPES, kinds), legend=_legend(kinds)),
        color=_colour(kinds),
        tooltip=[
            *tips(name="segment", x="c (kPa)", xe="± s.e.", y="φ (°)", ye="± s.e. (°)"),
            encoded("status:N"),
        ],
    )
    corners = min(max(_MOST_VERTICES // n, 13), 41)
    outlines = [shown_segments.ellipse(table, row, corners) for row in range(n)]
    drawn = [j for j, one in enumerate(outlines) if np.isfinite(one).all()]
    layers: list[Layer] = [points.mark("point", filled=True, size=45, clip=True).zoomed()]
    if drawn:
        every = np.concatenate([outlines[j] for j in drawn])
        number = np.repeat(drawn, corners)
        shapes = sheet.chart(
            x=every[:, 0],
            y=every[:, 1],
            s=key[number],
            kind=[kinds[j] for j in number],
            o=np.tile(np.arange(corners), len(drawn)),
        ).encode(x=x, y=y, order=encoded("o:Q"), detail=encoded("s:N"))
        if len(drawn) <= _MOST_ELLIPSES:
            layers.insert(
                0, shapes.mark("line", strokeWidth=1, opacity=0.6, clip=True).encode(color=_colour(kinds))
            )
        marked = shapes.mark("line", strokeWidth=3, color=CHOSEN, clip=True)
        layers.append(marked.where("datum.s == segment"))
    return sheet.finished(layers, 320)


def strength(table: Mapping[str, Any], chosen: str) -> Spec:
    sheet = Sheet(chosen)
    key, name = np.asarray(table["key"]), np.asarray(table["name"])
    kinds = shown_segments.groups(table, len(COLOURS))
    pivots = np.asarray(table["sigma_star_kPa"], dtype=float)
    known = shown_segments.tested(table)
    across, up = shown_segments.strength_limits(table)
    # Far from σ* the drive has not tried the soil.
    steps = 5 if len(known) > _MOST_ELLIPSES else 9
    stress = pivots[known, None] * np.linspace(0.5, 1.5, steps)
    lines = [shown_segments.strength(table, row, s) for row, s in zip(known, stress, strict=True)]
    value = np.array([line[0] for line in lines]).reshape(-1)
    error = 1.96 * np.array([line[1] for line in lines]).reshape(-1)
    number = np.repeat(known, steps)
    base = sheet.chart(
        x=stress.reshape(-1),
        y=value,
        low=value - error,
        high=value + error,
        pivot=np.tile(np.arange(steps) == steps // 2, len(known)),
        s=key[number],
        name=name[number],
        kind=[kinds[j] for j in number],
    ).encode(
        x=encoded("x:Q", title="normal stress σ (kPa)", scale=scale(*across)),
        y=encoded("y:Q", title="shear strength c + σ tan φ (kPa)", scale=scale(*up)),
        detail=encoded("s:N"),
        tooltip=tips(name="segment", x="σ (kPa)", y="strength (kPa)", low="95 % from", high="to"),
    )
    dashes = encoded("kind:N", scale=_by_kind(_DASHES, kinds), legend=_legend(kinds))
    marked = base.where("datum.s == segment")
    layers = [
        base.mark("line", strokeWidth=1.2, clip=True)
        .encode(color=_colour(kinds), strokeDash=dashes)
        .zoomed(),
        base.mark("point", size=30, filled=True, clip=True).encode(color=_colour(kinds)).where("datum.pivot"),
        marked.mark("area", opacity=0.25, color=CHOSEN, clip=True).encode(
            y=encoded("low:Q"), y2={"field": "high"}
        ),
        marked.mark("line", strokeWidth=3, color=CHOSEN, clip=True),
    ]
    return sheet.finished(layers, 320)


def _by_kind(choices: Sequence[Any], kinds: Sequence[str]) -> Spec:
    """Return a scale that gives each kind, in the order of their first segments, one of the choices."""
    unique = list(dict.fromkeys(kinds))
    return {"domain": unique, "range": list(choices[: len(unique)])}


def _colour(kinds: Sequence[str]) -> Spec:
    return encoded("kind:N", scale=_by_kind(COLOURS, kinds), legend=_legend(kinds))


def _legend(kinds: Sequence[str]) -> Spec | None:
    """Return none where all are of one kind: one name for all tells nothing apart."""
    return {"title": None, "symbolOpacity": 1.0} if len(set(kinds)) > 1 else None


def of_soil(table: Mapping[str, Any], chosen: str) -> list[tuple[str, Spec]]:
    """Draw each quantity along the time of the drive, with its title; nothing without time."""
    if not np.isfinite(np.asarray(table["t_start_s"], dtype=float)).any():
        return []
    label, _ = shown_segments.mapped_strength(table)
    strength = (f"{label[:1].upper()}{label[1:]}", "strength_at_stress_kPa", "strength_at_stress_se_kPa")
    return [
        (title, _timeline(table, title, (value, error), chosen))
        for title, value, error in (strength, *_QUANTITIES)
        if np.isfinite(np.asarray(table[value], dtype=float)).any()
    ]


def _timeline(table: Mapping[str, Any], title: str, names: tuple[str, str], chosen: str) -> Spec:
    sheet = Sheet(chosen)
    columns = (np.asarray(table[name], dtype=float) for name in ("t_start_s", "t_end_s", *names))
    start, end, value, error = columns
    kinds = shown_segments.groups(table, len(COLOURS))
    base = sheet.chart(
        x=start - np.nanmin(start),
        x2=end - np.nanmin(start),
        y=value,
        e=error,
        low=value - 1.96 * error,
        high=value + 1.96 * error,
        s=np.asarray(table["key"]),
        name=np.asarray(table["name"]),
        kind=kinds,
        status=[str(status) for status in table["status"]],
    ).encode(
        x=encoded("x:Q", title="time since the start (s)", scale={"zero": False, "nice": False}),
        x2={"field": "x2"},
        tooltip=[*tips(name="segment", y=title, e="± s.e."), encoded("status:N")],
    )
    known = np.isfinite(value)
    sure = known & np.isfinite(error)
    if sure.any():
        sure &= error <= np.median(error[sure]) * _UNSURE
    ends = np.concatenate([value[known], (value - 1.96 * error)[sure], (value + 1.96 * error)[sure]])
    # With a margin: the band of a lone segment would be the whole picture.
    ends_shown = scale(*shown_samples.limits(ends, margin=0.1))
    y = encoded("y:Q", title=title, scale=ends_shown)
    colour = _colour(kinds)
    # What is not ok is faint, as in the other pictures.
    opacity = either("datum.status == 'ok'", 1.0, 0.35)
    band = base.mark("rect", opacity=0.16, clip=True).encode(
        y=encoded("low:Q", title=title, scale=ends_shown), y2={"field": "high"}, color=colour
    )
    lines = base.mark("rule", strokeWidth=4, clip=True).encode(y=y, color=colour, opacity=opacity)
    marked = base.mark("rule", strokeWidth=9, color=CHOSEN, clip=True).encode(y=y)
    return sheet.finished([band, marked.where("datum.s == segment"), lines], 220)


def course(
    along: Array, axis: str, pairs: Pairs, label: str, keys: Text, chosen: str, *, driven: bool
) -> Spec:
    """Draw measured and predicted values along the chosen segment; a line where they were `driven` so."""
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
        .where("datum.s == segment")
        .encode(
            x=encoded(
                "x:Q", title=axis, scale={"zero": False, "nice": False, "padding": 0 if driven else 10}
            ),
            tooltip=tips(x=axis, m="measured", p="predicted"),
        )
    )
    kinds = {"domain": ["measured", "predicted"], "range": [INK, MEDIAN]}

    colour = encoded("what:N", title=None, scale=kinds)

    def shown(kind: str, field: str) -> Layer:
        y = encoded(f"{field}:Q", title=label, scale={"zero": False})
        return base.calculated("what", f"'{kind}'").encode(y=y, color=colour)

    dots = shown("measured", "m").mark("point", size=12).zoomed()
    other = shown("predicted", "p")
    other = other.mark("line", strokeWidth=1.6) if driven else other.mark("point", shape="cross", size=40)
    return sheet.finished([dots, other], 320)


def residual(
    along: Along, pooled: Pairs, in_unit: str, noise: float, keys: Text, chosen: str, *, height: int = 210
) -> Spec:
    """Draw the residual against a driver: its median, the band of 5 to 95 %, the noise, the segment."""
    sheet = Sheet(chosen)
    values, axis = pooled.residual, along.quantity.label
    known = np.flatnonzero(np.isfinite(along.values))
    kept = known[shown_samples.some(len(known), MOST_BESIDE)]
    low, high = shown_samples.limits(np.percentile(values[known], [0.3, 50.0, 99.7]), np.zeros(1), margin=0.1)
    y = encoded("y:Q", title=f"measured − predicted{in_unit}", scale=scale(low, high))
    if along.labels:
        x = encoded("x:N", title=axis, sort=None, axis={"labelAngle": 0, "labelLimit": 90})
    else:
        x = encoded("x:Q", title=axis, scale=scale(*shown_samples.limits(along.values[known])))

    def shown(driver: Array) -> Array | Text:
        return np.array(along.labels)[driver.astype(int)] if along.labels else driver

    points = sheet.chart(x=shown(along.values[kept]), y=values[kept], s=keys[pooled.segment[kept]])
    points = points.encode(x=x, y=y)
    band = shown_samples.band(along.values, values)
    bins = sheet.chart(x=shown(band.centre), low=band.low, y=band.median, high=band.high)
    of_x = encoded("x:N" if along.labels else "x:Q", title=axis)
    told = [of_x, *tips(y="median", low="5 %", high="95 %")]
    dots = points.mark("circle", size=10, color=FAINT, opacity=0.6, clip=True)
    marked = points.mark("circle", size=24, color=CHOSEN, clip=True).where("datum.s == segment")
    # The segment is below the median, which is what is to be read. A lone one is no choice.
    layers = [dots if along.labels else dots.zoomed(), *([marked] if len(keys) > 1 else [])]
    layers += sheet.followed(bins.encode(x=x), y, told, joined=not along.labels)
    if np.isfinite(noise):
        rules = sheet.chart(y=[-1.96 * noise, 1.96 * noise]).encode(y=encoded("y:Q"))
        layers.append(rules.mark("rule", color=COLOURS[0], strokeWidth=1.5, strokeDash=[2, 3], clip=True))
    return sheet.finished(layers, height)
