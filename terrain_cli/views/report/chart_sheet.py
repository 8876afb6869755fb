"""The common parts of the charts of the page.

Each is a Vega-Lite specification and listens to the page's own control `#segment`, so that the
keyboard reaches it and no script stands between.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import altair as alt
import numpy as np

from terrain_cli.views.chart_style import FAINT, INK

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Spec = dict[str, Any]

#: Marks the chosen segment in all charts at once: told apart from the groups and from the scale.
CHOSEN = "#AA3377"


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
    """A chart being drawn: its data, kept apart from its encodings, and the segment marked at first."""

    def __init__(self, chosen: str | None = None) -> None:
        self._datasets: dict[str, list[dict[str, Any]]] = {}
        self._chosen = chosen

    def chart(self, **columns: Sequence[Any] | NDArray[Any]) -> alt.Chart:
        """Return a chart of columns."""
        name = f"data-{len(self._datasets)}"
        self._datasets[name] = rows(**columns)
        # Altair would look at every value if it had them.
        return alt.Chart(alt.NamedData(name=name))

    def finished(self, layers: Sequence[alt.Chart], height: int, width: int | str = "container") -> Spec:
        """Return the layers, from the lowest to the highest, as one specification; sizes are in pixels."""
        chart = alt.layer(*layers)
        if self._chosen is not None:
            bind = alt.BindDirect(element="#segment", event="change")
            chart = chart.add_params(alt.param(name="segment", value=self._chosen, bind=bind))
        spec: Spec = (
            chart.properties(width=width, height=height, background="transparent")
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
            .to_dict()
        )
        # The schema's address is no use to a page that is not to look anything up.
        spec.pop("$schema", None)
        return {**spec, "datasets": self._datasets}


def scale(low: float, high: float) -> alt.Scale:
    """Return an axis that ends where it is told to."""
    return alt.Scale(domain=[float(low), float(high)], nice=False, zero=False)
