"""The soils of a comparison: the table of segments, and the moments for which rim stresses are drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from terrain_cli.comparison import segment_soils
from terrain_cli.presentation import segment_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from terrain_cli.comparison.comparison_outcome import Comparison, WheelComparison
    from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

#: Wheels under whose rim one looks.
MOST_MOMENTS = 4


class Moment(NamedTuple):
    """One wheel at one time, on a soil that was estimated."""

    title: str
    model: Model  # With the base "wong-reece"
    wheel: WheelGeometry
    channels: Mapping[str, ArrayLike]  # Shape (1,)
    values: Mapping[str, float]  # Of all parameters


def table(comparison: Comparison) -> segment_table.Table:
    """Return the soil of every segment, as `estimate` gives it."""
    return segment_table.join([segment_table.table(*soils) for soils in segment_soils.of(comparison)])


def moments(comparison: Comparison) -> list[Moment]:
    """Choose a moment of each wheel: the middle of the sinkages in its longest segment.

    None of the linear base, whose stresses are triangles.
    """
    several = len({wheel.source for wheel in comparison.wheels}) > 1
    found = []
    for wheel in comparison.wheels:
        moment = _moment(wheel) if wheel.model.base == "wong-reece" else None
        if moment is not None:
            found.append(moment._replace(title=f"{wheel.source}\n{moment.title}") if several else moment)
    return found[:MOST_MOMENTS]


def _moment(wheel: WheelComparison) -> Moment | None:
    samples, windows, segments, fit = wheel.samples, wheel.windows, wheel.segments, wheel.fit
    sinkage = samples.channels.get("sinkage")
    soil = np.searchsorted(windows.bounds, segments.bounds[:-1], side="right") - 1
    length = np.where(np.isfinite(fit.values["cohesion"][soil]), np.diff(segments.bounds), 0)
    if sinkage is None or not length.any():
        return None
    segment = int(np.argmax(length))
    window = soil[segment]
    values = {name: float(column[window]) for name, column in fit.values.items()} | fit.shared
    rows = segments.rows[segments.bounds[segment] : segments.bounds[segment + 1]]
    columns = {**samples.channels, **samples.drivers}
    needed = ("slip", "sinkage", *(name for name in wheel.model.needs if name in columns))
    rows = rows[np.all([np.isfinite(columns[name][rows]) for name in needed], axis=0)]
    if not len(rows) or not wheel.model.parameters.keys() <= values.keys():
        return None
    row = rows[np.argsort(sinkage[rows], kind="stable")[len(rows) // 2]]
    return Moment(
        f"wheel {wheel.wheel}, segment {segment + 1}: z = {1e3 * sinkage[row]:.1f} mm, "
        f"i = {samples.channels['slip'][row]:.2f}",
        wheel.model,
        samples.geometry.wheel,
        {name: column[row : row + 1] for name, column in columns.items() if np.isfinite(column[row])},
        values,
    )
