"""Segments as they are shown: names, groups, tracks, ellipses, strength lines; moments under the rim."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from formats.output.common_forms import parse
from terrain_cli.comparison.comparison_outcome import Comparison, WheelComparison, segment_soils
from terrain_cli.estimation import PooledEstimate
from terrain_cli.estimation.strength import strength_at
from terrain_cli.mechanics.effect import Effect
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict
from terrain_cli.presentation import segment_table
from terrain_cli.views import shown_samples
from terrain_cli.vocabulary.arrays import Array, Index, Mask
from terrain_cli.vocabulary.quantities import the_wheel

Table = Mapping[str, Any]

_WIDEST = 30.0  # Times the least range of c or φ to which the ellipses of what nothing separates are shown
#: Of an ellipse that holds 95 % of a normal distribution in the plane, in standard deviations.
ELLIPSE = 2.4477
#: Wheels under whose rim one looks, and angles on each side of that of the greatest stress.
MOST_MOMENTS, _NODES = 4, 40


def names(table: Table) -> list[str]:
    """Name every segment by what tells it from the others, such as "3" or "run.bag front-left 3"."""
    parts = [table[key] for key in ("source", "wheel") if len(set(table[key])) > 1]
    return [
        " ".join([*map(str, before), str(int(n))])
        for *before, n in zip(*parts, table["segment"], strict=True)
    ]


def groups(table: Table, most: int) -> list[str]:
    """Return the terrain of each segment, or its wheel; all the same where there are too many."""
    for key in ("terrain", "wheel"):
        values = [str(value) or "not labelled" for value in table[key]]
        if 1 < len(set(values)) <= most:
            return values
    return ["all segments"] * len(table["segment"])


def paths(table: Table) -> list[Array]:
    """Read the tracks of the segments, each of shape (points, 2), empty where a segment has no place."""
    shapes = map(parse, table["WKT"])
    return [np.array(shape.points if shape else (), dtype=float).reshape(-1, 2) for shape in shapes]


def geographic(table: Table) -> bool:
    """Whether the tracks are in longitude and latitude."""
    return bool(np.isfinite(np.asarray(table["longitude_deg"], dtype=float)).any())


def frame(table: Table, points: Array) -> tuple[tuple[float, float], tuple[float, float], float]:
    """Return what a map shows, a third as wide as long at least, and a unit upwards in units across."""
    stretch = 1.0 / float(np.cos(np.radians(points[:, 1].mean()))) if geographic(table) else 1.0
    across, up = (shown_samples.limits(points[:, axis], margin=0.06) for axis in (0, 1))
    width, height = across[1] - across[0], (up[1] - up[0]) * stretch
    least = max(width, height) / 3.0
    side, top = max(least - width, 0.0) / 2.0, max(least - height, 0.0) / (2.0 * stretch)
    return (across[0] - side, across[1] + side), (up[0] - top, up[1] + top), stretch


def ellipse(table: Table, row: int, points: int = 60) -> Array:
    """Return the outline, shape (points, 2), of where c (kPa) and φ (degrees) are with 95 % confidence."""
    turn = np.linspace(0.0, 2.0 * np.pi, points)
    corr = float(np.clip(table["corr_c_phi"][row], -1.0, 1.0))
    along, across = np.cos(turn), np.sin(turn)
    c = table["c_kPa"][row] + ELLIPSE * table["c_se_kPa"][row] * along
    phi = table["phi_deg"][row] + ELLIPSE * table["phi_se_deg"][row] * (
        corr * along + np.sqrt(1.0 - corr**2) * across
    )
    return np.column_stack([c, phi])


def estimate_limits(table: Table) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return ranges of c (kPa) and φ (°), beyond which ellipses of what is not separated may reach."""
    sure = np.array([status == "ok" for status in table["status"]])
    c = _limits(table, "c_kPa", "c_se_kPa", sure, 0.5)
    return c, _limits(table, "phi_deg", "phi_se_deg", sure, 4.0)


def _limits(table: Table, name: str, error: str, sure: Mask, least: float) -> tuple[float, float]:
    values, errors = (np.asarray(table[column], dtype=float) for column in (name, error))
    # What the drive does not separate has errors beyond all measure.
    shown = np.minimum(errors, least) if sure.any() else np.minimum(ELLIPSE * errors, _WIDEST * least)
    reach = np.nan_to_num(np.where(sure, ELLIPSE * errors, shown))
    finite = np.isfinite(values)
    if not finite.any():
        return 0.0, 1.0
    low, high = usual(np.concatenate([(values - reach)[finite], (values + reach)[finite]]))
    # A soil that is known is shown, however far from the others.
    known = finite & sure
    low = float(np.min((values - reach)[known], initial=low))
    high = float(np.max((values + reach)[known], initial=high))
    space = max(0.08 * (high - low), 0.2 * least)
    return low - space, high + space


def usual(values: Array) -> tuple[float, float]:
    """Return the range of finite values, without those far from the others."""
    first, third = np.percentile(values, [25.0, 75.0])
    far = 2.5 * (third - first)
    near = values[(values >= first - far) & (values <= third + far)]
    return float(near.min()), float(near.max())


def strength_limits(table: Table) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return ranges of normal stress and strength, in kPa, in which the strength lines can be seen."""
    known = tested(table)
    pivot, value = (
        np.asarray(table[name], dtype=float)[known] for name in ("sigma_star_kPa", "strength_kPa")
    )
    low, high = usual(value)
    # Soil without any strength is drawn on an axis of 1 kPa.
    return (0.0, 1.5 * usual(pivot)[1]), (min(0.0, 1.5 * low), max(1.5 * high, 0.5 * abs(low)) or 1.0)


def tested(table: Table) -> Index:
    """Return the rows of the segments whose strength is known at a stress that can be."""
    pivot, value = (np.asarray(table[name], dtype=float) for name in ("sigma_star_kPa", "strength_kPa"))
    return np.flatnonzero(np.isfinite(value) & (pivot > 0.0))


def mapped_strength(table: Table) -> tuple[str, Array]:
    """Return the strength of each segment at the stress at which segments compare, in kPa, with its label."""
    stresses = {value for value in map(float, table["stress_kPa"]) if np.isfinite(value)}
    where = f"{stresses.pop():.4g} kPa" if len(stresses) == 1 else "the typical stress of its wheel"
    return f"strength at {where} (kPa)", np.asarray(table["strength_at_stress_kPa"], dtype=float)


def strength(table: Table, row: int, stress: Array) -> tuple[Array, Array]:
    """Return the strength of a segment's soil under normal stresses, with its standard error, all in kPa."""
    return strength_at(
        stress,
        PooledEstimate(
            c=table["c_kPa"][row],
            c_se=table["c_se_kPa"][row],
            phi=np.radians(table["phi_deg"][row]),
            phi_se=np.radians(table["phi_se_deg"][row]),
            corr=table["corr_c_phi"][row],
        ),
    )


class Moment(NamedTuple):
    """One wheel at one time, on a soil that was estimated."""

    title: str
    model: Model  # With the base "wong-reece"
    wheel: WheelGeometry
    channels: Mapping[str, ArrayLike]  # Shape (1,)
    values: Mapping[str, float]  # Of all parameters

    @property
    def stresses(self) -> tuple[Array, Array, Array]:
        """Angles under the rim in °, and normal and shear stress there in kPa, as the model has them."""
        seen: list[tuple[Array, Array, Array]] = []

        def look(q: Mapping[str, Any]) -> Any:
            seen.append((q["angle"][:, 0], q["normal_stress"][:, 0], q["shear_stress"][:, 0]))
            return q["shear_stress"]

        # A law sees the stresses at the nodes, and the last one sees them as all others left them.
        witness = Effect(id="looks-on", title="", kind="stress", parameters=(), laws={"shear_stress": look})
        model = Model(self.model.base, (*self.model.effects, witness))
        predict(model, self.wheel, self.channels, self.values, order=_NODES)
        angle, normal, shear = np.array(seen[0])[:, np.argsort(seen[0][0])]
        return np.degrees(angle), normal / 1e3, shear / 1e3


def soil_table(comparison: Comparison) -> segment_table.Table:
    """Return the soil of every segment, as `estimate` gives it."""
    return segment_table.join([segment_table.table(*soils[:2]) for soils in segment_soils(comparison)])


def moments(comparison: Comparison) -> list[Moment]:
    """Choose a moment of each wheel of the full model: the middle sinkage in its longest segment."""
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
        f"{the_wheel(wheel.wheel)}, segment {segment + 1}: z = {1e3 * sinkage[row]:.1f} mm, "
        f"i = {samples.channels['slip'][row]:.2f}",
        wheel.model,
        samples.geometry.wheel,
        {name: column[row : row + 1] for name, column in columns.items() if np.isfinite(column[row])},
        values,
    )
