"""What a fit tells beside the table: what it was made with, and all parameters of a window together."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np

from terrain_cli.estimation import WindowEstimates, joint_grid
from terrain_cli.estimation.joint_grid import Frame, JointPosterior
from terrain_cli.estimation.wheel_fit import Fit
from terrain_cli.estimation.wheel_fit.unknowns import POSITIVE
from terrain_cli.models import ModelFile
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.windows.cut_windows import Windows

#: Parameters of the soil that the summary shows by segment: key, unit in it, and that unit in SI.
_SHOWN = (
    ("shear_modulus", "k", "_mm", 1e3),
    ("stiffness", "keq", "_kPa_per_m_n", 1e-3),
    ("sinkage_exponent", "n", "", 1.0),
)
#: Quantities whose laws say of what c and φ are the values: of which speed, stress or pass.
_OF_STRENGTH = {"cohesion", "tan_phi", "shear_stress"}
_PAIR, _UNITS = ("cohesion", "tan_phi"), ("Pa", "1")


class CommonParameters(NamedTuple):
    """Parameters with one value for all windows of a wheel, and what the data leave open; SI."""

    values: Mapping[str, float]
    errors: Mapping[str, float]
    covariance: Array  # Shape (q, q), in the order of `values`
    open_samples: Mapping[str, int]  # Samples in whose window the data leave a parameter open, its own too
    samples: int

    @classmethod
    def of(cls, fit: Fit) -> Self:
        left = {name: int(fit.n[there].sum()) for name, there in fit.undetermined.items()}
        return cls(fit.shared, fit.shared_errors, fit.shared_covariance, left, int(fit.n.sum()))

    def determined(self, name: str) -> bool:
        """Tell whether the data determine a parameter in any window."""
        return self.open_samples.get(name, 0) < self.samples


def account(
    windows: Windows, file: ModelFile, fit: Fit, held: Mapping[str, float], because: Mapping[str, str]
) -> dict[str, Any]:
    """Say what a wheel was fitted with; `because` says why what is `held` was, where the file does not."""
    own = [name for name in file.model.parameters if name not in file.local]
    names = [*own, *(name for name in file.shared if name not in own)]
    return {
        "base": file.model.base,
        "effects": [effect.id for effect in file.model.effects],
        "parameters": {name: _parameter(name, file, fit, held, because.get(name)) for name in names},
        "strength": {
            effect.id: " ".join(effect.formula.split())
            for effect in file.model.effects
            if not _OF_STRENGTH.isdisjoint(effect.laws)
        },
        "noise": _noise_account(windows, fit),
        "missed": int(np.count_nonzero(fit.missed)),
        "moved": int(np.count_nonzero(fit.moved & ~fit.missed)),
        "unsettled": int(np.count_nonzero(~fit.converged & (fit.n > 0))),
        "segments": [_segment(fit, j) for j in range(len(fit))],
    }


def _parameter(
    name: str, file: ModelFile, fit: Fit, held: Mapping[str, float], because: str | None
) -> dict[str, Any]:
    factor, sought = file.factor(name), name not in held
    return {
        "value": (fit.shared if sought else held)[name] / factor,
        "se": fit.shared_errors[name] / factor if sought else None,
        "unit": file.units[name],
        "held": not sought,
        "because": because,
        # The same in all windows, save that nothing is determined in one without samples.
        "fixed_by_data": not bool(fit.undetermined[name].all()) if sought else None,
    }


def _noise_account(windows: Windows, fit: Fit) -> dict[str, Any]:
    channels = [name for name in CHANNELS if name in {*fit.noise.relative, *fit.noise.absolute}]
    given = windows.samples.noise
    return {
        name: {
            "relative": float(fit.noise.relative.get(name, 0.0)),
            "absolute": float(fit.noise.absolute.get(name, 0.0)),
            "unit": CHANNELS[name].unit.symbol,  # type: ignore[union-attr]
            "given": name in given and given[name].known,
        }
        for name in channels
    }


def _segment(fit: Fit, j: int) -> dict[str, Any]:
    """Return the soil of a window as far as the table has no column for it."""
    entry: dict[str, Any] = {"segment": j + 1}
    for parameter, key, unit, scale in _SHOWN:
        for part, column in (("", fit.values.get(parameter)), ("_se", fit.errors.get(parameter))):
            known = column is not None and np.isfinite(column[j])
            entry[f"{key}{part}{unit}"] = float(column[j]) * scale if column is not None and known else None
    for name, column in ((name, fit.values[name]) for name in fit.values if name not in fit.model.soil):
        entry[name] = float(column[j]) if np.isfinite(column[j]) else None
        entry[f"{name}_se"] = float(fit.errors[name][j]) if np.isfinite(column[j]) else None
    entry["at_bound"] = [name for name, there in fit.bounded.items() if bool(there[j])]
    entry["not_fixed_by_data"] = [name for name in fit.names if bool(fit.undetermined[name][j])]
    ratio = fit.chi2[j] / fit.dof[j] if fit.dof[j] > 0.0 else np.nan
    entry["chi2_per_dof"] = float(ratio) if np.isfinite(ratio) else None
    return entry


def chosen(windows: Windows, most: int) -> list[int]:
    """Return windows of several samples, evenly spread, `most` of them at the most."""
    there = np.flatnonzero(np.diff(windows.bounds) > 1)
    if len(there) > most:
        there = there[np.round(np.linspace(0, len(there) - 1, most)).astype(int)]
    return [int(j) for j in there]


def of_line(estimates: WindowEstimates, windows: Sequence[int]) -> list[JointPosterior]:
    """Return the normal distributions that the errors of a line stand for, where there is an estimate."""
    found = []
    for j in windows:
        tan_phi = float(np.tan(estimates.phi[j]))
        errors = np.array([estimates.c_se[j], estimates.phi_se[j] * (1.0 + tan_phi**2)])
        covariance = np.outer(errors, errors) * np.array([[1.0, estimates.corr[j]], [estimates.corr[j], 1.0]])
        if not joint_grid.possible(covariance):
            continue
        values = np.array([estimates.c[j], tan_phi])
        found.append(
            JointPosterior(
                window=j,
                names=_PAIR,
                units=_UNITS,
                values=values,
                covariance=covariance,
                prior=np.full((2, 2), np.nan),
                grid=joint_grid.grid(Frame(values, covariance)),
            )
        )
    return found


def of_fit(fit: Fit, file: ModelFile, windows: Sequence[int]) -> list[JointPosterior]:
    """Return what a fit knows of windows, in the units of the model file."""
    units = tuple(file.units[name] for name in fit.names)
    factor = np.array([file.factor(name) for name in fit.names])
    prior = np.array([_prior(fit, name) for name in fit.names]).reshape(-1, 2) / factor[:, None]
    found = []
    for j in windows:
        values = np.array([fit.values[n][j] if n in fit.values else fit.shared[n] for n in fit.names])
        if not np.isfinite(values).all():
            continue
        found.append(
            JointPosterior(
                window=j,
                names=fit.names,
                units=units,
                values=values / factor,
                covariance=fit.covariance[j] / np.outer(factor, factor),
                prior=prior,
                grid=fit.grids.get(j),
            )
        )
    return found


def _prior(fit: Fit, name: str) -> tuple[float, float]:
    """Return the prior of a window's own parameter; the median of one that is sought by its logarithm."""
    mean, sd = fit.priors.get(name, (np.nan, np.nan))
    if name not in POSITIVE:
        return mean, sd
    return float(np.exp(mean)), float(np.exp(mean)) * sd
