"""What the page is made of: sections, tables and charts, and the sheet on which these are drawn.

A chart is a Vega-Lite specification and listens to a control of the page, `#segment` or `#model`, so that the
keyboard reaches it and no script stands between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_cli.views.chart_style import FAINT, INK, MEDIAN

Spec = dict[str, Any]

#: Marks the chosen segment in all charts at once: told apart from the groups and from the scale.
CHOSEN = "#AA3377"
#: Fields that are no numbers.
_TEXTS = frozenset({"name", "status", "label", "step", "when"})
_TYPES = {"Q": "quantitative", "N": "nominal"}
#: A mark that can be dragged and zoomed.
_ZOOM = {"name": "zoom", "select": {"type": "interval", "encodings": ["x", "y"]}, "bind": "scales"}


@dataclass(frozen=True)
class Table:
    """Rows under a caption; all text is taken as it is, none as HTML."""

    caption: str
    head: Sequence[str]  # Headings of the columns
    rows: Sequence[Sequence[str]]  # The first cell names the row
    figures: frozenset[int] = frozenset()  # Columns of numbers, which are set flush right
    note: str = ""  # What was left out, or how to read it


@dataclass(frozen=True)
class Chart:
    """A picture."""

    title: str
    alt: str  # What it shows, for those who do not see it
    spec: Mapping[str, Any]  # Of Vega-Lite
    wide: bool = False  # Two in a row on a wide screen, instead of three


@dataclass(frozen=True, kw_only=True)
class Section:
    """A part of the page with a heading, left out where it has neither text nor parts."""

    id: str  # For links; letters and hyphens
    title: str
    text: Sequence[str] = ()  # Paragraphs
    points: Sequence[str] = ()  # Items of a list, after the paragraphs
    # Charts that follow one another share a row where there is room
    parts: Sequence[Table | Chart] = field(default_factory=tuple)
    lead: str = ""  # What is to be known first, before the paragraphs
    command: str = ""  # What to run next

    @property
    def blocks(self) -> list[list[Table | Chart]]:
        """The parts, with the charts that follow one another put together."""
        runs = groupby(self.parts, lambda part: isinstance(part, Chart) or id(part))
        return [list(run) for _, run in runs]

    def __bool__(self) -> bool:
        return bool(self.text or self.points or self.parts)


def _plain(column: Sequence[Any] | NDArray[Any]) -> list[Any]:
    """Return a column as JSON has it: five digits, null where not known."""
    values = np.asarray(column)
    if values.dtype.kind != "f":
        return list(values.tolist())
    return [float(f"{value:.5g}") if np.isfinite(value) else None for value in values.tolist()]


_LETTERS: Spec = {"labelColor": INK, "labelFontSize": 11}
_LETTERS |= {"titleColor": INK, "titleFontSize": 12, "titleFontWeight": "normal"}
#: How all charts look.
_SETTINGS: Spec = {
    "aria": False,
    "font": "system-ui, DejaVu Sans, Arial, sans-serif",
    "view": {"continuousHeight": 300, "continuousWidth": 300, "stroke": None},
    "axis": {
        **_LETTERS,
        "gridColor": FAINT,
        "gridOpacity": 0.25,
        "labelOverlap": "greedy",
        "labelSeparation": 6,
    },
    # What would reach beyond the picture is left out.
    "axisX": {"labelBound": 4},
    "legend": {**_LETTERS, "labelLimit": 180, "orient": "bottom", "columns": 3},
}


@dataclass(frozen=True)
class Layer:
    """Marks of one kind, as Vega-Lite has them; each method returns another layer."""

    spec: Spec

    def mark(self, kind: str, **how: Any) -> Layer:
        return self._with("mark", {"type": kind, **how})

    def encode(self, **channels: Any) -> Layer:
        return self._with("encoding", {**self.spec.get("encoding", {}), **channels})

    def where(self, condition: str) -> Layer:
        return self._with("transform", [*self.spec.get("transform", []), {"filter": condition}])

    def calculated(self, name: str, formula: str) -> Layer:
        step = {"calculate": formula, "as": name}
        return self._with("transform", [*self.spec.get("transform", []), step])

    def zoomed(self) -> Layer:
        return self._with("params", [_ZOOM])

    def _with(self, key: str, value: Any) -> Layer:
        return replace(self, spec={**self.spec, key: value})


class Sheet:
    """A chart being drawn, its data kept apart; `control` is what chooses: "segment" or "model"."""

    def __init__(self, chosen: str | None = None, control: str = "segment") -> None:
        self._datasets: dict[str, list[dict[str, Any]]] = {}
        self._chosen, self._control = chosen, control

    def chart(self, **columns: Sequence[Any] | NDArray[Any]) -> Layer:
        name = f"data-{len(self._datasets)}"
        records = zip(*map(_plain, columns.values()), strict=True)
        self._datasets[name] = [dict(zip(columns, record, strict=True)) for record in records]
        return Layer({"data": {"name": name}})

    def followed(self, bins: Layer, y: Spec, told: list[Spec], *, joined: bool = True) -> list[Layer]:
        """Draw zero, the band of 5 to 95 % in each of the bins, and the median in it, `joined` to a line."""
        colour: dict[str, Any] = {"color": MEDIAN, "clip": True}
        if joined:
            # As a whole it could tell the values of one bin alone.
            band = bins.mark("area", opacity=0.22, **colour)
            middle = bins.mark("line", point={"color": MEDIAN, "size": 22}, **colour)
        else:
            band = bins.mark("bar", size=18, opacity=0.22, **colour).encode(tooltip=told)
            middle = bins.mark("point", filled=True, size=45, **colour)
        ends: dict[str, Spec] = {"y": encoded("low:Q"), "y2": {"field": "high"}}
        zero = self.chart(y=[0.0]).mark("rule", color=INK, strokeWidth=1).encode(y=encoded("y:Q"))
        return [zero, band.encode(**ends), middle.encode(y=y, tooltip=told)]

    def finished(self, layers: Sequence[Layer], height: int, width: int | str = "container") -> Spec:
        """Return the layers, from the lowest to the highest, as one specification; sizes are in pixels."""
        spec: Spec = {"layer": [layer.spec for layer in layers]}
        if self._chosen is not None:
            bind = {"element": f"#{self._control}", "event": "change"}
            spec["params"] = [{"name": self._control, "value": self._chosen, "bind": bind}]
        size = {"width": width, "height": height, "background": "transparent"}
        return {**spec, **size, "config": _SETTINGS, "datasets": self._datasets}


def encoded(column: str, **how: Any) -> Spec:
    """Return what a channel shows: a column with its kind, as "x:Q" (quantitative) or "name:N" (nominal)."""
    name, kind = column.split(":")
    return {"field": name, "type": _TYPES[kind], **how}


def either(condition: str, value: Any, otherwise: Any) -> Spec:
    """Return a channel of two values."""
    return {"condition": {"test": condition, "value": value}, "value": otherwise}


def scale(low: float, high: float) -> Spec:
    """Return an axis that ends where it is told to."""
    return {"domain": [float(low), float(high)], "nice": False, "zero": False}


def tips(**titles: str) -> list[Spec]:
    """Return what a mark tells when it is pointed at: its fields, each under a title."""
    return [
        encoded(f"{name}:{'N' if name in _TEXTS else 'Q'}", title=title) for name, title in titles.items()
    ]
