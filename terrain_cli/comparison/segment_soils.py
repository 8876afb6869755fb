"""c and φ of the segments of a comparison: those that `estimate` gives, not those of its own fit."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from terrain_cli.estimation import WindowEstimates, estimators

if TYPE_CHECKING:
    from terrain_cli.comparison.comparison_outcome import Comparison, WheelComparison
    from terrain_cli.windows.cut_windows import Windows


class Soils(NamedTuple):
    """The segments of a wheel, as they were cut, and their soils."""

    segments: Windows
    estimates: WindowEstimates


def of(comparison: Comparison) -> list[Soils]:
    """Return the soils of the segments of each wheel.

    Where `estimate` has no answer, or was not asked, they are those of the comparison's own fit.
    """
    asked = comparison.soils
    if asked is None:
        return [_own(wheel, wheel.segments, None) for wheel in comparison.wheels]
    return [
        Soils(cut, estimates) if estimates is not None else _own(wheel, cut, asked.stress)
        for wheel, cut, estimates in zip(comparison.wheels, asked.wheels, asked.estimates, strict=True)
    ]


def _own(wheel: WheelComparison, cut: Windows, stress: float | None) -> Soils:
    """Return the soils that were fitted for the comparison, of which one may be that of several segments."""
    windows = wheel.windows
    nothing = np.full(len(windows), np.nan)
    line = WindowEstimates(**dict.fromkeys((f.name for f in fields(WindowEstimates)), nothing))
    fitted = estimators.of_fit(wheel.fit, line, windows, stress)
    order = np.argsort(windows.rows, kind="stable")
    place = np.searchsorted(windows.rows[order], cut.rows[cut.bounds[:-1]])
    soil = np.searchsorted(windows.bounds, order[np.minimum(place, len(order) - 1)], side="right") - 1
    columns = {f.name: getattr(fitted, f.name)[soil] for f in fields(WindowEstimates)}
    return Soils(cut, replace(fitted, **columns | {"n": np.diff(cut.bounds)}))
