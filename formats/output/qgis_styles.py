"""Styles for QGIS: a colour for each class of a column's numbers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal
from xml.etree import ElementTree as ET

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

#: From low to high: five of the colours of viridis, which keep their order in grey and to the colour-blind.
COLOURS = ("68,1,84,255", "59,82,139,255", "33,145,140,255", "94,201,98,255", "253,231,37,255")
_SYMBOLS = {
    "LineString": (
        "line",
        "SimpleLine",
        "line_color",
        {"line_width": "1.2", "line_width_unit": "MM", "capstyle": "round", "joinstyle": "round"},
    ),
    "Point": (
        "marker",
        "SimpleMarker",
        "color",
        {"name": "circle", "size": "2.4", "size_unit": "MM", "outline_style": "no"},
    ),
}
#: As QGIS numbers them.
_GEOMETRY_TYPES = {"Point": "0", "LineString": "1"}


def classes(values: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Cut numbers into classes of about as many each: lower and upper bounds, none without numbers."""
    known = values[np.isfinite(values)]
    if len(known) == 0:
        return []
    bounds = np.unique(np.quantile(known, np.linspace(0.0, 1.0, len(COLOURS) + 1), method="nearest"))
    if len(bounds) == 1:
        bounds = np.repeat(bounds, 2)
    return list(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True))


def qml(column: str, values: NDArray[np.float64], kind: Literal["Point", "LineString"]) -> str | None:
    """Write a style (QML of QGIS 3) that colours a layer by one of its columns, if that has numbers."""
    ranges = classes(values)
    if not ranges:
        return None
    root = ET.Element("qgis", version="3.22.0", styleCategories="Symbology")
    renderer = ET.SubElement(
        root,
        "renderer-v2",
        type="graduatedSymbol",
        attr=column,
        graduatedMethod="GraduatedColor",
        symbollevels="0",
        enableorderby="0",
        forceraster="0",
    )
    above, symbols = ET.SubElement(renderer, "ranges"), ET.SubElement(renderer, "symbols")
    shades = np.linspace(0, len(COLOURS) - 1, len(ranges)).round().astype(int)
    for place, ((lower, upper), shade) in enumerate(zip(ranges, shades, strict=True)):
        ET.SubElement(
            above,
            "range",
            lower=repr(lower),
            upper=repr(upper),
            symbol=str(place),
            label=f"{lower:.4g} – {upper:.4g}",
            render="true",
        )
        _symbol(symbols, str(place), COLOURS[shade], kind)
    ET.SubElement(root, "layerGeometryType").text = _GEOMETRY_TYPES[kind]
    # QGIS looks for its document type, and takes nothing else.
    return "<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>\n" + ET.tostring(
        root, encoding="unicode"
    )


def _symbol(parent: ET.Element, name: str, colour: str, kind: Literal["Point", "LineString"]) -> None:
    symbol_type, layer, colour_key, options = _SYMBOLS[kind]
    symbol = ET.SubElement(
        parent, "symbol", name=name, type=symbol_type, alpha="1", clip_to_extent="1", force_rhr="0"
    )
    inner = ET.SubElement(symbol, "layer", {"class": layer, "enabled": "1", "locked": "0", "pass": "0"})
    properties = ET.SubElement(inner, "Option", type="Map")
    for key, value in {**options, colour_key: colour}.items():
        ET.SubElement(properties, "Option", name=key, type="QString", value=value)
