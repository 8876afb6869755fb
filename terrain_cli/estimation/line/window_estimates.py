"""Cohesion and friction angle of each window, with their errors and the status."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Any, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from terrain_cli.errors import UsageError
from terrain_cli.estimation.line import moments as moments_of
from terrain_cli.estimation.line import ridge
from terrain_cli.estimation.line.moments import (
    KEYS,
    LINE,
    Key,
    Line,
    WindowMoments,
    X,
    Y,
    fit_line,
    of_windows,
    segment_sum,
)
from terrain_cli.estimation.line.ridge import Ridge
from terrain_cli.estimation.line.uncertainty import uncertainty
from terrain_cli.mechanics import linear
from terrain_cli.vocabulary.arrays import Array, Bounds, Index, Mask
from terrain_cli.vocabulary.choices import FIT_SAMPLES, LARGEST_PHI, LineMethod
from terrain_cli.windows.cut_windows import runs

Text = NDArray[np.str_]

#: Above this condition number `auto` takes ridge and the status is ill-conditioned: x varies by
#: less than 2 % of its mean, so that 1 % of the stress moves c by half the strength. Belsley,
#: Kuh & Welsch (1980) call 30 to 100 a moderate to strong and more than 100 a severe dependency.
LARGEST_CONDITION = 100.0

#: c and φ are separable where samples and bounds leave φ open by no more than this (bounds 20°
#: apart), and the estimate is not much worse for its bias than knowing nothing but
#: 0 ≤ φ ≤ 60°, which is ± 17°.
LARGEST_PHI_OPEN = float(np.radians(6.0))
LARGEST_PHI_SE = float(np.radians(15.0))

#: What a window may be, the most harmful first.
STATUSES = (
    *("too-few-samples", "out-of-range", "at-bound", "prior-bound", "model-misses", "not-separable"),
    *("ill-conditioned", "ok"),
)
#: Of windows whose strength holds within its error, if a model fits.
STRENGTH_HOLDS = ("not-separable", "ill-conditioned", "ok")
_OF_THE_FULL_MODEL = (
    *("shear_modulus_se", "stiffness", "stiffness_se"),
    *("sinkage_exponent", "sinkage_exponent_se"),
)
#: From `strength.with_strengths`, which knows the stresses under the wheel.
_AT_STRESS = ("stress", "strength_at_stress", "strength_at_stress_se")

_BLOCK = 32_768  # Samples worked on at a time: few enough to stay in the processor's cache
_TOGETHER = 1024  # Windows estimated together from their moments


@dataclass(frozen=True, kw_only=True)
class WindowEstimates:
    """Estimates of windows: one entry per window in every array, NaN where not known."""

    n: Index  # Samples
    # Of `c` and `phi`: "least-squares", "ridge" or "recursive"; "wong-reece" or "linear" where the whole
    # model was fitted
    method: Text
    # The first that applies of `STATUSES`: "out-of-range" (c < 0 or φ outside 0 to 60°), "at-bound" (a
    # parameter of the full model is at its bound), "prior-bound" (c or φ is not told by the data), "model-
    # misses" (by more than noise), "not-separable" (the samples and the channels' bounds leave φ open by more
    # than ± 6°, or its standard error is above 15°), "ill-conditioned" (the condition number is above 100)
    status: Text
    separable: Mask  # Whether c and φ can be told apart, whatever else the status says
    c: Array  # c, c_se: cohesion and its standard error, Pa. Never clipped.
    c_se: Array
    phi: Array  # phi, phi_se: friction angle and its standard error, rad
    phi_se: Array
    corr: Array  # Correlation of the errors of c and φ
    c_ls: Array  # c_ls, phi_ls, c_ridge, phi_ridge: by both methods, Pa and rad
    phi_ls: Array
    c_ridge: Array
    phi_ridge: Array
    delta: Array  # δ of the ridge estimate
    condition_number: Array  # Of the design [1, x], both columns scaled to unit length
    # Stress at which the strength is not correlated with φ, or the nearest under the wheel, Pa
    sigma_star: Array
    strength: Array  # strength, strength_se: c + σ* tan φ and its standard error, Pa
    strength_se: Array
    # stress, strength_at_stress, strength_at_stress_se: one stress for all windows of a wheel, and the
    # strength there with its standard error, Pa
    stress: Array
    strength_at_stress: Array
    strength_at_stress_se: Array
    # data_c, data_c_se, data_tan_phi, data_tan_phi_se, data_corr: c in Pa and tan φ, also where the table
    # leaves them empty, with the errors that each window has of its own, from noise
    data_c: Array
    data_c_se: Array
    data_tan_phi: Array
    data_tan_phi_se: Array
    data_corr: Array
    # assumed_c_se, assumed_tan_phi_se, assumed_corr: the errors that all windows have in common, from what is
    # taken for true: k and the stresses of the line (`assumed.deviations`), and the priors of the full model
    assumed_c_se: Array
    assumed_tan_phi_se: Array
    assumed_corr: Array
    torque_rmse: Array  # Of the torque that c and φ predict, N m
    # The part of `phi_se` that comes from the bounds of φ for any noise in the four sensors, rad; it does not
    # average out over windows
    phi_bias: Array
    # shear_modulus, shear_modulus_se: k and its standard error, m; of the line the k assumed, without one
    shear_modulus: Array
    shear_modulus_se: Array
    # stiffness, stiffness_se, sinkage_exponent, sinkage_exponent_se: keq in Pa/m^n and n with their standard
    # errors; of the full model
    stiffness: Array
    stiffness_se: Array
    sinkage_exponent: Array
    sinkage_exponent_se: Array

    def __len__(self) -> int:
        return len(self.n)


def estimate_windows(
    columns: Sequence[ArrayLike] | Array,
    bounds: ArrayLike,
    geometry: dict[str, float],
    *,
    method: LineMethod = "auto",
    min_samples: int = FIT_SAMPLES,
    correlated: bool = True,
    folds: int | None = None,
) -> WindowEstimates:
    """Estimate c and φ of every window by equations [26] and [27] of Iagnemma et al. 2004.

    Both least squares and ridge are computed; `auto` is least squares up to a condition number of 100, and
    ridge above; the recursive estimate of a whole window is that of least squares.

    Standard errors hold for correlated residuals and include the bias of a line fitted to stresses computed
    from noisy channels (`uncertainty`): they do not go to zero with the number of samples. Of simulated
    windows with 3 % of white noise in all channels, a constant load is called anything but "not-separable" in
    less than 1 %; random variation of the load by ±15 % is called so in 3 % of the windows of 30 samples and
    less than 1 % of 100. The linearised stresses and k are taken as true; see `assumed.with_assumptions`. Of
    ridge it is a mean square error: it has the distance to the bounds of φ and to the mean stress too, where
    the penalty's bias shows.

    The columns, shape (n,), finite, are x and y of `mechanics.linear.line_coordinates`, and the load, torque,
    sinkage, slip and geometry that it takes; window j is the samples bounds[j] to bounds[j + 1] − 1. Steady
    test points, which have no order in time, are not `correlated`, and `folds` are contiguous blocks, the
    better judge of samples that are; by default single samples are left out.
    """
    if method not in get_args(LineMethod):
        raise UsageError(f"no method {method!r}", hint=f"one of {', '.join(get_args(LineMethod))}")
    if folds is not None and folds < 2:
        raise UsageError(f"cross-validation over {folds} blocks", hint="2 or more")
    rows = [np.asarray(column, dtype=float) for column in columns]
    bounds = np.asarray(bounds, dtype=np.intp)
    told: dict[str, Any] = {"min_samples": min_samples, "correlated": correlated, "folds": folds}
    return join([_estimate(rows, some, geometry, method, **told) for some in _together(bounds)])


def _together(bounds: Bounds) -> list[Bounds]:
    return [bounds[first : first + _TOGETHER + 1] for first in range(0, max(len(bounds) - 1, 1), _TOGETHER)]


def soils(x: Array, y: Array, bounds: Bounds, method: LineMethod) -> Array:
    """Return c and tan φ of every window, shape (2, w), as `estimate_windows` without costly errors."""
    found = []
    for inner in _together(bounds):
        moments, losses = _measured([x, y], inner, LINE, penalised=method in {"auto", "ridge"})
        line = fit_line(moments)
        cohesion, tan_phi = line.cohesion, line.tan_phi
        if losses:
            cohesion, tan_phi, _ = _chosen(
                line, ridge.choose(moments, np.concatenate(losses, axis=1)), method
            )
        known = np.where(np.diff(inner) > 1, 1.0, np.nan)
        found.append([cohesion * known, np.tan(np.arctan(tan_phi) * known)])
    return np.concatenate(found, axis=1)


def _measured(
    rows: Sequence[Array], bounds: Bounds, keys: Sequence[Key], *, penalised: bool, folds: int | None = None
) -> tuple[WindowMoments, list[Array]]:
    """Return moments of some windows and, if wanted, the losses of penalised lines, block by block."""
    measured, losses = [], []
    for columns, inner, _, _ in _blocks(rows, bounds):
        measured.append(of_windows(columns, inner, keys))
        if penalised:
            losses.append(ridge.losses(columns[X], columns[Y], inner, measured[-1], folds=folds))
    return moments_of.join(measured), losses


def _chosen(line: Line, penalty: Ridge, method: LineMethod) -> tuple[Array, Array, Mask]:
    """Return c and tan φ of the windows, and which of them have the penalised line."""
    penalised = np.full(len(line.tan_phi), method == "ridge")
    if method == "auto":
        penalised = line.condition_number > LARGEST_CONDITION
    cohesion = np.where(penalised, penalty.cohesion, line.cohesion)
    return cohesion, np.where(penalised, penalty.tan_phi, line.tan_phi), penalised


def join(parts: Sequence[WindowEstimates]) -> WindowEstimates:
    if len(parts) == 1:
        return parts[0]
    return WindowEstimates(
        **{f.name: np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(parts[0])}
    )


def blocks(bounds: Bounds) -> list[tuple[int, int]]:
    """Part windows into runs, first to last − 1, of about `_BLOCK` samples; one empty run if none."""
    return list(runs(bounds, _BLOCK)) or [(0, 0)]


def _blocks(rows: Sequence[Array], bounds: Bounds) -> Iterator[tuple[list[Array], Bounds, int, int]]:
    """Yield columns and bounds of runs of windows, the first window and the one after the last."""
    for first, last in blocks(bounds):
        begin, end = bounds[first], bounds[last]
        yield [row[begin:end] for row in rows], bounds[first : last + 1] - begin, first, last


def _estimate(
    rows: Sequence[Array],
    bounds: Bounds,
    geometry: dict[str, float],
    method: LineMethod,
    *,
    min_samples: int,
    correlated: bool,
    folds: int | None,
) -> WindowEstimates:
    """Estimate some windows; `rows` are those of `moments`."""
    moments, losses = _measured(rows, bounds, KEYS, penalised=True, folds=folds)
    line, penalty = fit_line(moments), ridge.choose(moments, np.concatenate(losses, axis=1))
    cohesion, tan_phi, penalised = _chosen(line, penalty, method)
    gain = np.where(penalised, penalty.gain, np.eye(2)[:, :, None])
    errors, phi_open = uncertainty(moments, line, cohesion, tan_phi, gain, correlated=correlated)

    count = np.diff(bounds)
    torque_rmse = np.empty(len(count))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for columns, inner, first, last in _blocks(rows, bounds):
            _, _, load, torque, sinkage, slip = columns
            c, t = (np.repeat(values[first:last], count[first:last]) for values in (cohesion, tan_phi))
            away = torque - linear.torque(load, sinkage, slip, c, t, **geometry)
            torque_rmse[first:last] = np.sqrt(segment_sum(away**2, inner) / count[first:last])
    known = np.where(count > 0, 1.0, np.nan)
    phi = np.arctan(tan_phi) * known
    separable = (phi_open <= LARGEST_PHI_OPEN) & (errors.phi_se <= LARGEST_PHI_SE)
    status = np.select(
        [
            count < max(min_samples, 3),
            ~((cohesion >= 0.0) & (phi >= 0.0) & (phi <= LARGEST_PHI)),
            ~separable,
            line.condition_number > LARGEST_CONDITION,
        ],
        ["too-few-samples", "out-of-range", "not-separable", "ill-conditioned"],
        "ok",
    )
    known = np.where(count > 1, 1.0, np.nan)
    plain = "recursive" if method == "recursive" else "least-squares"
    return WindowEstimates(
        n=count,
        method=np.where(penalised, "ridge", plain),
        status=status,
        separable=separable,
        c=cohesion * known,
        phi=phi * known,
        **errors._replace(sigma_star=errors.sigma_star * known, strength=errors.strength * known)._asdict(),
        c_ls=line.cohesion,
        phi_ls=np.arctan(line.tan_phi),
        c_ridge=penalty.cohesion * known,
        phi_ridge=np.arctan(penalty.tan_phi) * known,
        delta=penalty.delta * known,
        condition_number=line.condition_number,
        torque_rmse=torque_rmse,
        shear_modulus=np.full(len(count), geometry["shear_modulus"]),
        **dict.fromkeys((*_OF_THE_FULL_MODEL, *_AT_STRESS), np.full(len(count), np.nan)),
        data_c=cohesion * known,
        data_c_se=errors.c_se,
        data_tan_phi=tan_phi * known,
        data_tan_phi_se=errors.phi_se * (1.0 + tan_phi**2),
        data_corr=errors.corr,
        **dict.fromkeys(("assumed_c_se", "assumed_tan_phi_se", "assumed_corr"), np.zeros(len(count))),
    )
