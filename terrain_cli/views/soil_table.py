"""The soils of a comparison: the table of segments, and the moments for which rim stresses are drawn."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from terrain_cli.estimation import WindowEstimates
from terrain_cli.estimation.estimators import estimate_lines, of_fit
from terrain_cli.presentation import segment_table

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from terrain_cli.comparison.comparison_outcome import Comparison, WheelComparison
    from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

#: Wheels under whose rim one looks.
MOST_MOMENTS = 4


class Moment(NamedTuple):
    """One wheel at one time, on a soil that was estimated.

    Parameters
    ----------
    model : Model
        With the base "wong-reece".
    channels : mapping of str to ndarray, shape (1,)
    values : mapping of str to float
        Of all parameters.
    """

    title: str
    model: Model
    wheel: WheelGeometry
    channels: Mapping[str, ArrayLike]
    values: Mapping[str, float]


def table(comparison: Comparison) -> segment_table.Table:
    """Return the soil that the model finds in every segment.

    Returns
    -------
    dict of str to list or ndarray
        The columns of `segment_table.COLUMNS`.
    """
    tables: list[segment_table.Table] = []
    stress: float | None = None
    for wheel in comparison.wheels:
        tables.append(_of_wheel(wheel, stress))
        known = tables[-1]["stress_kPa"]
        if stress is None and len(known) and np.isfinite(known[0]):
            stress = 1e3 * float(known[0])
    return segment_table.join(tables)


def _of_wheel(wheel: WheelComparison, stress: float | None) -> segment_table.Table:
    windows, fit = wheel.windows, wheel.fit
    line = estimate_lines(windows) if windows.lined else _no_line(len(windows))
    return segment_table.table(windows, of_fit(fit, line, windows, stress))


def _no_line(n: int) -> WindowEstimates:
    """Return the linear estimates of windows without torque or sinkage: nothing is known."""
    nothing = np.full(n, np.nan)
    return WindowEstimates(**dict.fromkeys((f.name for f in fields(WindowEstimates)), nothing))


def moments(comparison: Comparison) -> list[Moment]:
    """Choose a moment of each wheel: the middle of the sinkages in its longest segment.

    Returns
    -------
    list of Moment
        Of the first few wheels whose sinkage is measured; none of the linear base, whose stresses
        are triangles.
    """
    several = len({wheel.source for wheel in comparison.wheels}) > 1
    found = []
    for wheel in comparison.wheels:
        moment = _moment(wheel) if wheel.model.base == "wong-reece" else None
        if moment is not None:
            found.append(moment._replace(title=f"{wheel.source}\n{moment.title}") if several else moment)
    return found[:MOST_MOMENTS]


def _moment(wheel: WheelComparison) -> Moment | None:
    samples, windows, fit = wheel.samples, wheel.windows, wheel.fit
    sinkage = samples.channels.get("sinkage")
    length = np.where(np.isfinite(fit.values["cohesion"]), np.diff(windows.bounds), 0)
    if sinkage is None or not length.any():
        return None
    window = int(np.argmax(length))
    values = {name: float(column[window]) for name, column in fit.values.items()} | fit.shared
    rows = windows.rows[windows.bounds[window] : windows.bounds[window + 1]]
    columns = {**samples.channels, **samples.drivers}
    needed = ("slip", "sinkage", *(name for name in wheel.model.needs if name in columns))
    rows = rows[np.all([np.isfinite(columns[name][rows]) for name in needed], axis=0)]
    if not len(rows) or not wheel.model.parameters.keys() <= values.keys():
        return None
    row = rows[np.argsort(sinkage[rows], kind="stable")[len(rows) // 2]]
    return Moment(
        f"wheel {wheel.wheel}, segment {window + 1}: z = {1e3 * sinkage[row]:.1f} mm, "
        f"i = {samples.channels['slip'][row]:.2f}",
        wheel.model,
        samples.geometry.wheel,
        {name: column[row : row + 1] for name, column in columns.items() if np.isfinite(column[row])},
        values,
    )
