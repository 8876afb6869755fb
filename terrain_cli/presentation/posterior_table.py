"""The table of joint posteriors: c and φ on a grid, and the covariance of all parameters, of each segment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.estimation.joint_grid import JointGrid, JointPosterior
    from terrain_cli.windows.cut_windows import Windows

    Table = dict[str, Any]

#: Rows of c and φ, and rows of two parameters.
GRID, PARAMETER = "grid", "parameter"
_NUMBERS_OF_GRID = ("c_kPa", "phi_deg", "pivot_kPa", "strength_kPa", "log_posterior", "probability")
_TEXTS = ("parameter", "unit", "other")
_NUMBERS = ("value", "se", "prior", "prior_sd", "covariance", "correlation")


def table(windows: Windows, estimates: WindowEstimates, joint: Sequence[JointPosterior]) -> Table:
    """Return the joint posteriors of one wheel: rows of the kind "grid", then of the kind "parameter".

    `log_posterior` is 0 where it is greatest, `probability` that of the cell; NaN or "" where a row has none.
    """
    parts = [_rows(one) for one in joint]
    length = [len(part["kind"]) for part in parts]
    repeated = list(zip(joint, length, strict=True))
    along: Table = {
        "source": [windows.samples.source] * sum(length),
        "wheel": [windows.samples.wheel] * sum(length),
        "segment": np.repeat([one.window + 1 for one in joint], length).astype(np.intp),
        "method": [str(estimates.method[one.window]) for one, n in repeated for _ in range(n)],
        "status": [str(estimates.status[one.window]) for one, n in repeated for _ in range(n)],
    }
    texts = {name: [text for part in parts for text in part[name]] for name in ("kind", *_TEXTS)}
    numbers = {
        name: np.concatenate([np.zeros(0), *(part[name] for part in parts)])
        for name in (*_NUMBERS_OF_GRID, *_NUMBERS)
    }
    names = (
        "kind",
        *along,
        *_NUMBERS_OF_GRID,
        "parameter",
        "unit",
        *_NUMBERS[:4],
        "other",
        *_NUMBERS[4:],
    )
    every = along | texts | numbers
    return {name: every[name] for name in names}


def _rows(one: JointPosterior) -> Table:
    """Return the rows of one window: its grid, if it has one, then its parameters."""
    upper, lower = _of_grid(one.grid) if one.grid else {}, _of_parameters(one)
    a, b = len(upper.get("c_kPa", ())), len(lower["value"])
    rows: Table = {"kind": [GRID] * a + [PARAMETER] * b}
    for name in _TEXTS:
        rows[name] = [""] * a + lower[name]
    for name in (*_NUMBERS_OF_GRID, *_NUMBERS):
        rows[name] = np.concatenate(
            [upper.get(name, np.full(a, np.nan)), lower.get(name, np.full(b, np.nan))]
        )
    return rows


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
    correlation = np.divide(one.covariance, product, out=np.full_like(product, np.nan), where=product > 0.0)
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
