"""What the estimators of the line take for true, and what that may do to c and φ.

They take k for known, and the stresses under the rim for triangles. How far c and tan φ would move is found
with the same estimator: with k, and each error that rover.toml states, a standard deviation larger and
smaller; and by how far the estimate is from that soil whose torques and loads, by the full model, lead to it:
the triangles may leave a tenth of c. None averages out over samples, nor over windows.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from terrain_cli import estimation
from terrain_cli.estimation import WindowEstimates
from terrain_cli.estimation.further_unknowns import stated_errors, with_error
from terrain_cli.estimation.line.moments import segment_sum
from terrain_cli.estimation.line.pooled import Trace
from terrain_cli.estimation.line.window_estimates import LARGEST_PHI_SE, soils
from terrain_cli.mechanics import contact, linear
from terrain_cli.telemetry.wheel_samples import Geometry
from terrain_cli.vocabulary.arrays import Array, ratio
from terrain_cli.vocabulary.choices import LARGEST_PHI, LineMethod
from terrain_cli.windows.cut_windows import Windows

#: Samples of a window that tell how far the estimates would move, and samples at a time.
_SOME, _GROUP = 60, 20_000
#: c1 and c2 of θm = (c1 + c2 i) θ1: Iagnemma et al. 2004, and loose and compact sand (Wong & Reece 1967).
_SHAPES = ((0.5, 0.0), (0.18, 0.32), (0.43, 0.32))
#: n: mean less and plus standard deviation of Table II of Iagnemma et al. 2004. keq follows from the loads.
_EXPONENTS = (0.6, 1.1)
_ORDER = 8  # Nodes on each arc: 1e-4 of the forces
#: Least and greatest c in Pa and tan φ of soils: c as far as four standard deviations of `unknowns.DEFAULT`.
_SOILS = (np.array([0.0, 0.05]), np.array([22.5e3, np.tan(LARGEST_PHI)]))
_SPREAD_C = 5e3  # Standard deviation of c over published soils, Pa: one that errs by more is not told
#: Steps in c and tan φ that tell how the estimate moves with the soil, and steps towards it.
_STEPS, _NEWTON = np.array([1e3, 0.05]), 3


def with_assumptions(
    estimates: WindowEstimates, windows: Windows, method: LineMethod, moved: Array | None = None
) -> WindowEstimates:
    """Return estimates of the line whose errors include a wrong k and triangles (`deviations`)."""
    moved = deviations(estimates, windows, method) if moved is None else moved
    c_se, phi_se, corr = _wider(estimates, moved)
    tan_se = phi_se * (1.0 + np.tan(estimates.phi) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        pivot = np.maximum(-corr * c_se / tan_se, 0.0)
    (size_c, size_t), mixed = (np.sqrt(np.sum(moved**2, axis=2)).T, np.sum(moved[:, 0] * moved[:, 1], axis=1))
    both = size_c * size_t
    separable = estimates.separable & (phi_se <= LARGEST_PHI_SE) & (c_se <= _SPREAD_C)
    lost = ~separable & np.isin(estimates.status, ("ill-conditioned", "ok"))
    return replace(
        estimates,
        status=np.where(lost, "not-separable", estimates.status),
        separable=separable,
        c_se=c_se,
        phi_se=phi_se,
        corr=corr,
        sigma_star=np.where(np.isfinite(pivot), pivot, estimates.sigma_star),
        assumed_c_se=size_c,
        assumed_tan_phi_se=size_t,
        assumed_corr=np.clip(ratio(mixed, both), -1.0, 1.0),
    )


def trace(windows: Windows) -> Trace:
    """Follow c and φ sample by sample (`recursive`), with errors that include what each window assumes.

    The windows hold no samples of a skidding wheel.
    """
    samples = windows.samples
    correlated = samples.time is not None
    columns = windows.line_columns
    steps = estimation.recursive(columns, windows.bounds, correlated=correlated)
    ends = estimation.estimate_windows(
        columns, windows.bounds, samples.geometry.line, method="recursive", correlated=correlated
    )
    moved = deviations(ends, windows, "recursive")
    c_se, phi_se, corr = _wider(steps, np.repeat(moved, np.diff(windows.bounds), axis=0))
    return replace(steps, c_se=c_se, phi_se=phi_se, corr=corr)


def _wider(of: WindowEstimates | Trace, moved: Array) -> tuple[Array, Array, Array]:
    """Return the errors of c and φ and their correlation with what moves c and tan φ added."""
    c, t = moved[:, 0], moved[:, 1]
    slope = 1.0 + np.tan(of.phi) ** 2
    covariance = np.nan_to_num(of.corr) * of.c_se * of.phi_se * slope + np.sum(c * t, axis=1)
    c_se = np.sqrt(of.c_se**2 + np.sum(c**2, axis=1))
    tan_se = np.sqrt((of.phi_se * slope) ** 2 + np.sum(t**2, axis=1))
    with np.errstate(divide="ignore", invalid="ignore"):
        corr = np.clip(covariance / (c_se * tan_se), -1.0, 1.0)
    return c_se, tan_se / slope, corr


def deviations(estimates: WindowEstimates, windows: Windows, method: LineMethod) -> Array:
    """Return how far c (Pa) and tan φ move with each assumption, by a standard deviation of it.

    Shape (w, 2, 1 + stated errors + shapes); 0 where it is not known.
    """
    found = np.array([estimates.c, np.tan(estimates.phi)])
    groups = list(windows.thinned(_SOME).groups(_GROUP))
    ends = np.cumsum([len(group) for group in groups])[:-1]
    parts = zip(np.split(found, ends, axis=1), groups, strict=True)
    moved = [_deviations(of, group, method) for of, group in parts]
    return np.concatenate(moved) if moved else np.zeros((0, 2, 1))


def _deviations(found: Array, windows: Windows, method: LineMethod) -> Array:
    """Return the deviations of estimates of (c, tan φ), shape (2, w)."""
    samples, geometry = windows.samples, windows.samples.geometry
    measured = windows.measured()

    def line(wheel: Geometry, columns: Mapping[str, Array]) -> Array:
        x, y = linear.line_coordinates(**{**columns, **wheel.line})
        return soils(x, y, windows.bounds, method)

    k, factor = geometry.shear_modulus, geometry.shear_modulus_factor
    stiffer, softer = (geometry._replace(shear_modulus=other) for other in (k * factor, k / factor))
    moved = [0.5 * (line(stiffer, measured) - line(softer, measured))]
    for error in stated_errors(samples, measured):
        more, less = (line(*with_error(error, by, samples, measured)) for by in (1.0, -1.0))
        moved.append(0.5 * (more - less))
    triangles = list(product(_SHAPES, _EXPONENTS))
    for under in triangles:
        forces = _under_wheel(windows, *under)

        def estimated(soil: Array, forces: Callable[[Array], dict[str, Array]] = forces) -> Array:
            return line(geometry, {**measured, **forces(soil)})

        moved.append((found - _origin(found, estimated)) / np.sqrt(len(triangles)))
    return np.nan_to_num(np.array(moved).transpose(2, 1, 0), posinf=0.0, neginf=0.0)


def _origin(found: Array, estimated: Callable[[Array], Array]) -> Array:
    """Return the soils (c, tan φ) of which the estimates are those found, by Newton's method."""
    low, high = (end[:, None] for end in _SOILS)
    soil = np.clip(np.nan_to_num(found), low, high)
    here = estimated(soil)
    by = [(estimated(soil + step[:, None]) - here) / step.sum() for step in np.diag(_STEPS)]
    (a, b), (c, d) = np.array(by).swapaxes(0, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(_NEWTON):
            x, y = found - here
            step = np.array([d * x - b * y, a * y - c * x]) / (a * d - b * c)
            soil = np.clip(soil + np.nan_to_num(step), low, high)
            here = estimated(soil)
    return soil


def _under_wheel(
    windows: Windows, shape: tuple[float, float], exponent: float
) -> Callable[[Array], dict[str, Array]]:
    """Return load and torque by the full model, as a function of soils (c, tan φ), at what was measured."""
    geometry, measured, count = windows.samples.geometry, windows.measured(), np.diff(windows.bounds)
    entry = linear.entry_angle(measured["sinkage"], geometry.radius)
    number = len(entry)

    def forces(stiffness: float, c: float, tan_phi: float) -> Array:
        found, _ = contact.forces(
            contact.Contact(
                entry_angle=entry,
                max_stress_angle=(shape[0] + shape[1] * measured["slip"]) * entry,
                exit_angle=np.zeros(number),
                slip=measured["slip"],
                cohesion=np.full(number, c),
                tan_phi=np.full(number, tan_phi),
                shear_modulus=np.full(number, geometry.shear_modulus),
                stiffness=np.full(number, stiffness),
                sinkage_exponent=np.full(number, exponent),
                radius=np.full(number, geometry.radius),
                shear_radius=np.full(number, geometry.radius),
            ),
            geometry.width,
            order=_ORDER,
        )
        return found

    # The forces are linear in keq, in c, and in tan φ where keq is given.
    of_c, normal, both = forces(0.0, 1.0, 0.0), forces(1.0, 0.0, 0.0), forces(1.0, 0.0, 1.0)
    sheared = both - normal

    def under(soil: Array) -> dict[str, Array]:
        cohesion, tan_phi = (np.repeat(np.nan_to_num(column), count) for column in soil)
        of_stiffness = normal + tan_phi * sheared
        carried = np.maximum(measured["load"] - cohesion * of_c[0], 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            stiffness = segment_sum(carried * of_stiffness[0], windows.bounds) / segment_sum(
                of_stiffness[0] ** 2, windows.bounds
            )
        total = cohesion * of_c + np.repeat(np.nan_to_num(stiffness), count) * of_stiffness
        return {"load": total[0], "torque": total[1]}

    return under
