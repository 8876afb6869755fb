"""The table of segments in the columns that users rely on, and of their joint posteriors."""

from collections.abc import Iterable, Sequence, Sized
from itertools import chain
from sys import intern
from typing import Any

import numpy as np
from numpy.typing import NDArray

from terrain_cli.estimation import WindowEstimates, assumed, strength
from terrain_cli.estimation.joint_grid import JointGrid, JointPosterior
from terrain_cli.telemetry.wheel_samples import NEEDED, Samples
from terrain_cli.vocabulary.arrays import Array, Index, ratio
from terrain_cli.vocabulary.quantities import the_wheel
from terrain_cli.windows.cut_windows import Windows

Table = dict[str, Any]

#: In this order; scripts and GIS projects are built on it.
COLUMNS = (
    *("source", "wheel", "segment", "terrain", "t_start_s", "t_end_s", "distance_m"),
    *("n_samples", "n_rejected", "method", "status"),
    *("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg", "corr_c_phi", "c_ls_kPa", "phi_ls_deg"),
    *("c_ridge_kPa", "phi_ridge_deg", "delta", "condition_number", "k_mm"),
    *("sigma_star_kPa", "strength_kPa", "strength_se_kPa"),
    *("stress_kPa", "strength_at_stress_kPa", "strength_at_stress_se_kPa", "torque_rmse_Nm"),
    *("x_m", "y_m", "longitude_deg", "latitude_deg", "WKT"),
)
#: What each window's estimate gives, with its unit at the end of the name.
SOIL = ("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg", "corr_c_phi")
_MAPPED = ("stress_kPa", "strength_at_stress_kPa", "strength_at_stress_se_kPa")
_ESTIMATED = (
    *(*SOIL, "c_ls_kPa", "phi_ls_deg", "c_ridge_kPa", "phi_ridge_deg", "delta", "condition_number"),
    *("sigma_star_kPa", "strength_kPa", "strength_se_kPa", *_MAPPED),
)
#: Of a table of samples: channel → column.
_SAMPLE_COLUMNS = {
    "load": "load_N",
    "torque": "torque_Nm",
    "sinkage": "sinkage_m",
    "slip": "slip",
    "drawbar_pull": "drawbar_pull_N",
    "x": "x_m",
    "y": "y_m",
    "longitude": "longitude_deg",
    "latitude": "latitude_deg",
}
VERTICES = 64  # Vertices of a segment's line at the most: enough to see its course on a map
#: Rows of c and φ, and rows of two parameters.
GRID, PARAMETER = "grid", "parameter"
_POSTERIOR = (
    *("c_kPa", "phi_deg", "pivot_kPa", "strength_kPa", "log_posterior", "probability"),
    *("parameter", "unit", "value", "se", "prior", "prior_sd", "other", "covariance", "correlation"),
)
_POSTERIOR_TEXTS = ("parameter", "unit", "other")
_SHARE_NAMED = 0.1  # Of a window, as a share of its labelled samples, from which on a label is named. Judged.


def table(windows: Windows, estimates: WindowEstimates) -> Table:
    """Return the rows of one wheel in the columns of the contract; NaN, None or "" where not known."""
    samples, rows, bounds = windows.samples, windows.rows, windows.bounds
    n = len(windows)
    first, last = rows[bounds[:-1]], rows[bounds[1:] - 1]
    middle = rows[(bounds[:-1] + bounds[1:]) // 2]
    nothing = np.full(n, np.nan)
    distance = samples.distance
    place = {name: samples.channels.get(name) for name in ("x", "y", "longitude", "latitude")}
    values: Table = {
        **_placed(samples, first),
        "segment": np.arange(1, n + 1),
        "terrain": _terrain(windows),
        "t_start_s": _times(samples, first),
        "t_end_s": _times(samples, last),
        "distance_m": nothing if distance is None else distance[last] - distance[first],
        "n_samples": np.diff(bounds),
        "n_rejected": _rejected(windows),
        "method": _texts(estimates.method),
        "status": _texts(estimates.status),
        **in_units(estimates, _ESTIMATED),
        "k_mm": estimates.shear_modulus * 1e3,
        "torque_rmse_Nm": estimates.torque_rmse,
        **{
            f"{name}_{unit}": nothing if (channel := place[name]) is None else channel[middle]
            for name, unit in (("x", "m"), ("y", "m"), ("longitude", "deg"), ("latitude", "deg"))
        },
        "WKT": _tracks(windows),
    }
    return {name: values[name] for name in COLUMNS}


def at_one_stress(rows: Table, estimates: WindowEstimates, stress: float) -> Table:
    """Return rows of several logs with all strengths at one stress, Pa (`strength.at_one_stress`)."""
    return {**rows, **in_units(strength.at_one_stress(estimates, stress), _MAPPED)}


def in_units(found: Any, columns: Sequence[str]) -> Table:
    """Return what an estimate gives by columns, whose names are its own with the unit behind them."""
    result: Table = {}
    for column in columns:
        name, _, unit = column.rpartition("_")
        if unit == "kPa":
            result[column] = getattr(found, name) / 1e3
        elif unit == "deg":
            result[column] = np.degrees(getattr(found, name))
        else:
            result[column] = getattr(found, "corr" if column == "corr_c_phi" else column)
    return result


def _texts(values: NDArray[np.str_]) -> list[str]:
    """Return texts of which each is held once: an object for each window takes more than its numbers."""
    return list(map(intern, values.tolist()))


def _terrain(windows: Windows) -> list[str]:
    """Return the labels of each window: those of a tenth of its labelled samples or more, joined by "+"."""
    labels = windows.samples.labels.get("terrain")
    if labels is None:
        return [""] * len(windows)
    codes = labels.codes[windows.rows]
    result = []
    for start, stop in zip(windows.bounds[:-1], windows.bounds[1:], strict=True):
        known = codes[start:stop][codes[start:stop] >= 0]
        counts = np.bincount(known)
        # A few samples of a neighbour say that a bound is a little off, not that two soils are one.
        held = np.flatnonzero(counts >= max(_SHARE_NAMED * len(known), 1))
        result.append(intern("+".join(labels.names[code] for code in held)))
    return result


def several_terrains(samples: Samples, table: Table) -> set[str]:
    """Return what the table calls windows of more than one label."""
    labels = samples.labels.get("terrain")
    return set() if labels is None else {*table["terrain"]} - {"", *labels.names}


def mixed_terrain_notes(wheel: str, names: Iterable[str]) -> list[str]:
    """Say that windows hold more than one label, if there are any."""
    listed = ", ".join(sorted(names))
    told = f"{the_wheel(wheel)}: segments hold samples of more than one terrain ({listed})"
    return [f"{told}; --segments terrain keeps them apart"] if listed else []


def _rejected(windows: Windows) -> Index:
    """Count the samples set aside, each with the window before it, so that used and rejected ones add up."""
    codes = windows.samples.set_aside.codes
    if not (codes >= 0).any():
        return np.zeros(len(windows), dtype=np.intp)
    order = np.argsort(windows.rows, kind="stable")
    before = np.searchsorted(windows.rows[order], np.flatnonzero(codes >= 0)) - 1
    window = np.searchsorted(windows.bounds, order[np.maximum(before, 0)], side="right") - 1
    return np.bincount(window, minlength=len(windows))


def coordinates(samples: Samples) -> tuple[Array, Array] | None:
    """Return longitude and latitude in degrees where they are known, else x and y of the site frame in m."""
    for pair in (("longitude", "latitude"), ("x", "y")):
        if all(name in samples.channels and np.isfinite(samples.channels[name]).any() for name in pair):
            return samples.channels[pair[0]], samples.channels[pair[1]]
    return None


def _tracks(windows: Windows) -> list[str]:
    place = coordinates(windows.samples)
    if place is None:
        return [""] * len(windows)
    result = []
    for start, stop in zip(windows.bounds[:-1], windows.bounds[1:], strict=True):
        rows = windows.rows[start:stop]
        points = np.column_stack([axis[rows] for axis in place])
        result.append(wkt(points[np.isfinite(points).all(axis=1)]))
    return result


def reference_system(table: Table, crs: str | None) -> str | None:
    """Return the reference system of a geometry; None for a site frame, whose x and y are no longitudes."""
    return (crs or "EPSG:4326") if np.isfinite(table["longitude_deg"]).any() else None


def wkt(points: Array) -> str:
    """Write a track, shape (n, 2), as a LINESTRING of at most `VERTICES`, or a POINT if it does not move."""
    if len(points) > VERTICES:
        points = points[np.round(np.linspace(0, len(points) - 1, VERTICES)).astype(int)]
    if len(points) > 1:
        points = points[np.concatenate([[True], np.any(np.diff(points, axis=0) != 0.0, axis=1)])]
    texts = [f"{a!r} {b!r}" for a, b in points.tolist()]
    if not texts:
        return ""
    return f"POINT ({texts[0]})" if len(texts) == 1 else f"LINESTRING ({', '.join(texts)})"


def join(tables: Sequence[Table]) -> Table:
    """Put rows under one another; beside longitudes, tracks in x and y of a site frame are left out."""
    if len(tables) == 1:
        # The rows of a long log with short windows take gigabytes.
        return tables[0]
    if "WKT" in tables[0]:
        known = [bool(np.isfinite(t["longitude_deg"]).any()) for t in tables]
        if any(known):
            tables = [
                t if located else {**t, "WKT": [""] * len(t["WKT"])}
                for t, located in zip(tables, known, strict=True)
            ]
    return {
        name: list(chain.from_iterable(t[name] for t in tables))
        if isinstance(tables[0][name], list)
        else np.concatenate([t[name] for t in tables])
        for name in tables[0]
    }


def _placed(samples: Samples, rows: Sized) -> Table:
    return {"source": [samples.source] * len(rows), "wheel": [samples.wheel] * len(rows)}


def _in_segments(windows: Windows) -> Table:
    """Return the first columns of a table with a row for each usable sample."""
    segment = np.repeat(np.arange(1, len(windows) + 1), np.diff(windows.bounds))
    return {**_placed(windows.samples, windows.rows), "segment": segment}


def _times(samples: Samples, rows: Index) -> Array:
    return np.full(len(rows), np.nan) if samples.time is None else samples.time[rows] + samples.origin


def rejects(samples: Samples) -> Table:
    """Return the samples set aside, counted from 1 within the wheel, with the reason of each."""
    codes = samples.set_aside.codes
    rows = np.flatnonzero(codes >= 0)
    return {
        **_placed(samples, rows),
        "sample": rows + 1,
        "time_s": _times(samples, rows),
        "reason": [samples.set_aside.names[code] for code in codes[rows]],
        **{_SAMPLE_COLUMNS[name]: samples.channels[name][rows] for name in NEEDED},
    }


def samples(windows: Windows) -> Table:
    """Return the samples of every window as points, in the system of the segments' tracks."""
    of, rows = windows.samples, windows.rows
    nothing = np.full(len(rows), np.nan)
    place = coordinates(of)
    points = np.column_stack([axis[rows] for axis in place]) if place else np.full((len(rows), 2), np.nan)
    return {
        **_in_segments(windows),
        "sample": rows + 1,
        "time_s": _times(of, rows),
        **{
            column: nothing if name not in of.channels else of.channels[name][rows]
            for name, column in _SAMPLE_COLUMNS.items()
        },
        "WKT": [
            wkt(point) if known else ""
            for point, known in zip(points[:, None], np.isfinite(points).all(axis=1), strict=True)
        ],
    }


def trace(windows: Windows) -> Table:
    """Return the recursive estimate after each sample of a wheel that does not skid, NaN until the second."""
    windows = windows.on_line()
    return {
        **_in_segments(windows),
        "time_s": _times(windows.samples, windows.rows),
        **in_units(assumed.trace(windows), SOIL),
    }


def posterior_table(windows: Windows, estimates: WindowEstimates, joint: Sequence[JointPosterior]) -> Table:
    """Return the joint posteriors of one wheel: rows of the kind "grid", then of the kind "parameter"."""

    def rows(kind: str, window: int, columns: Table) -> Table:
        n = len(next(iter(columns.values()), ()))
        return {
            "kind": [kind] * n,
            **_placed(windows.samples, range(n)),
            "segment": np.full(n, window + 1),
            "method": [str(estimates.method[window]) for _ in range(n)],
            "status": [str(estimates.status[window]) for _ in range(n)],
            **{
                name: columns.get(name, [""] * n if name in _POSTERIOR_TEXTS else np.full(n, np.nan))
                for name in _POSTERIOR
            },
        }

    parts = [rows(GRID, 0, {})]
    for one in joint:
        parts += [rows(GRID, one.window, _of_grid(one.grid) if one.grid else {})]
        parts += [rows(PARAMETER, one.window, _of_parameters(one))]
    return join(parts)


def _of_grid(grid: JointGrid) -> Table:
    columns = {
        "c_kPa": grid.cohesion / 1e3,
        "phi_deg": np.degrees(np.arctan(grid.tan_phi))[:, None],
        "pivot_kPa": np.array([[grid.pivot / 1e3]]),
        "strength_kPa": grid.strength[None, :] / 1e3,
        "log_posterior": grid.log_density,
        "probability": grid.probability,
    }
    return {name: np.broadcast_to(column, grid.log_density.shape).ravel() for name, column in columns.items()}


def _of_parameters(one: JointPosterior) -> Table:
    p, error = len(one.names), np.sqrt(np.diagonal(one.covariance))
    product = np.outer(error, error)
    correlation = ratio(one.covariance, product, np.nan)
    return {
        "parameter": [name for name in one.names for _ in range(p)],
        "unit": [unit for unit in one.units for _ in range(p)],
        "other": list(one.names) * p,
        "value": np.repeat(one.values, p),
        "se": np.repeat(error, p),
        "prior": np.repeat(one.prior[:, 0], p),
        "prior_sd": np.repeat(one.prior[:, 1], p),
        "covariance": one.covariance.ravel(),
        "correlation": correlation.ravel(),
    }
