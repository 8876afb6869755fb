"""How near the estimates come to the truth, and to what the data allow.

    python benchmarks/accuracy_study.py [--sets N | --full] [--seed N]

writes benchmarks/results/accuracy_study.txt, in some minutes for 1,000 of the 15,625 sets of soil
parameters (the default) on one core. The same sets and seed give the same table.
"""

from __future__ import annotations

import argparse
import sys
import textwrap
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests"), str(HERE)]

import wheel_truth as truth  # noqa: E402 - found through the path above

from terrain_cli.estimation import estimate_windows  # noqa: E402 - as above
from terrain_cli.estimation.wheel_fit import Noise, Prior, fit  # noqa: E402 - as above
from terrain_cli.mechanics.linear import line_coordinates  # noqa: E402 - as above
from terrain_cli.mechanics.model import Model, WheelGeometry  # noqa: E402 - as above

RESULT = HERE / "results" / "accuracy_study.txt"
SLIPS = (0.1, 0.3, 0.5, 0.7, 0.9)
POINTS = (5, 10, 30)
NOISES = (0.0, 0.01, 0.03, 0.10)
VARIATION = 0.15
LARGEST_SLIP = 0.99
#: Claims of the paper's section III, kPa and degrees: without noise and with 10 %.
CLAIMS = {0.0: (0.21, 1.62), 0.10: (0.63, 2.11)}
#: Above this share of the prior's deviation the bound says that the data tell nothing.
MEANINGLESS = 0.9
NORMAL_95 = 1.959964
#: Pa, where the strength is compared if no bound says where.
MEAN_STRESS = 5e3


@dataclass(frozen=True)
class Windows:
    """One window of samples for each soil, shape (sets, points): the truth and what is measured."""

    soils: truth.Soils
    channels: dict
    measured: dict
    noise: float


@dataclass(frozen=True)
class Errors:
    """Errors of estimates, one entry a set: c in kPa, φ in degrees, strength in kPa, and what was said of them."""

    cohesion: np.ndarray
    phi: np.ndarray
    strength: np.ndarray | None = None
    covered: np.ndarray | None = None


@dataclass(frozen=True)
class Bound:
    """Cramér–Rao bound with the grid's priors, one entry a set: kPa and degrees."""

    cohesion: np.ndarray
    phi: np.ndarray
    strength: np.ndarray
    pivot: np.ndarray


def prior_columns(grid):
    """Return the parameters as they are sought: c, tan φ, log k, log keq, n."""
    return np.array(
        [
            grid.cohesion,
            grid.tan_phi,
            np.log(grid.shear_modulus),
            np.log(grid.stiffness),
            grid.sinkage_exponent,
        ]
    )


def drive(soils, slip, rng):
    """Return the true channels of windows of the most points: load and slip vary at random."""
    shape = (len(soils.cohesion), max(POINTS))
    load = truth.MEAN_LOAD * (1.0 + VARIATION * rng.uniform(-1.0, 1.0, shape))
    slips = np.minimum(slip * (1.0 + VARIATION * rng.uniform(-1.0, 1.0, shape)), LARGEST_SLIP)
    each = soils.take(np.repeat(np.arange(shape[0]), shape[1]))
    depth = truth.sinkage(each, load.ravel(), slips.ravel())
    torque = truth.forces(each, depth, slips.ravel())[1]
    slopes = truth.slopes(each, depth, slips.ravel()).reshape(7, 2, *shape)
    return {
        "load": load,
        "torque": torque.reshape(shape),
        "sinkage": depth.reshape(shape),
        "slip": slips,
    }, slopes


def measure(channels, soils, points, noise, rng):
    """Return the first points of every window with noise, a share of W, T, z and i."""
    cut = {name: column[:, :points] for name, column in channels.items()}
    shown = {name: column * (1.0 + noise * rng.standard_normal(column.shape)) for name, column in cut.items()}
    return Windows(soils, cut, shown, noise)


def bound_of(windows, slopes, spread):
    """Return the bound: priors of the deviations `spread`, and per sample R + J Ru Jᵀ for W and T."""
    channels, noise, points = windows.channels, windows.noise, windows.channels["load"].shape[1]
    by, across = slopes[:5, :, :, :points], slopes[5:, :, :, :points]
    outputs = np.array([channels["load"], channels["torque"]])
    inputs = np.array([channels["sinkage"], channels["slip"]])
    covariance = np.einsum("uawn,ubwn,uwn->wnab", across, across, (noise * inputs) ** 2)
    for a in (0, 1):
        covariance[:, :, a, a] += (noise * outputs[a]) ** 2
    information = np.einsum("pawn,wnab,qbwn->wpq", by, np.linalg.inv(covariance), by)
    information += np.diag(1.0 / spread**2)
    posterior = np.linalg.inv(information)
    variance_c, between, variance_t = posterior[:, 0, 0], posterior[:, 0, 1], posterior[:, 1, 1]
    pivot = -between / variance_t
    tan_phi = windows.soils.tan_phi
    return Bound(
        np.sqrt(variance_c) / 1e3,
        np.degrees(np.sqrt(variance_t) / (1.0 + tan_phi**2)),
        np.sqrt(variance_c - between**2 / variance_t) / 1e3,
        pivot,
    )


def line_errors(windows, share, method):
    """Return the errors of the linearised estimator with k wrong by a share."""
    sets, points = windows.measured["load"].shape
    cohesion, phi = np.empty(sets), np.empty(sets)
    for k in np.unique(windows.soils.shear_modulus):
        here = np.flatnonzero(windows.soils.shear_modulus == k)
        channels = {name: column[here].ravel() for name, column in windows.measured.items()}
        geometry = {"radius": truth.RADIUS, "width": truth.WIDTH, "shear_modulus": k * share}
        with np.errstate(invalid="ignore"):
            x, y = line_coordinates(**channels, **geometry)
            found = estimate_windows(
                x,
                y,
                np.arange(len(here) + 1) * points,
                **channels,
                **geometry,
                method=method,
                correlated=False,
                min_samples=3,
            )
        cohesion[here], phi[here] = found.c, found.phi
    return Errors(
        (cohesion - windows.soils.cohesion) / 1e3, np.degrees(phi - np.arctan(windows.soils.tan_phi))
    )


def rms(values):
    known = np.asarray(values)[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else np.nan


def wheel_errors(windows, priors, pivot, *, learn):
    """Return the errors of wong-reece, which is told the noise or learns it, and what its intervals cover.

    The strength is that at `pivot`, the bound's σ*, but its intervals are judged at the estimate's own.
    """
    sets, points = windows.measured["load"].shape
    found = fit(
        Model(),
        WheelGeometry(truth.RADIUS, truth.WIDTH),
        {name: column.ravel() for name, column in windows.measured.items()},
        np.arange(sets + 1) * points,
        priors=priors,
        noise=None if learn else Noise.equal(windows.noise),
        correlated=False,
        min_samples=3,
    )
    soils = windows.soils
    cohesion = found.values["cohesion"] - soils.cohesion
    tan_phi = found.values["tan_phi"] - soils.tan_phi
    phi = found.phi - np.arctan(soils.tan_phi)
    strength = found.strength - (soils.cohesion + found.sigma_star * soils.tan_phi)
    off = np.abs([cohesion, phi, strength])
    said = np.array([found.errors["cohesion"], found.phi_se, found.strength_se])
    return Errors(
        cohesion / 1e3, np.degrees(phi), (cohesion + pivot * tan_phi) / 1e3, off <= NORMAL_95 * said
    )


# The report


def pair(errors, digits=3):
    return f"{rms(errors.cohesion):8.{digits}f} {rms(errors.phi):6.{digits - 1}f}"


def heading(names, width=16):
    return "".join(f"{name:>{width}}" for name in names)


class Study:
    """Every cell of the study: a slip, a number of points and a noise."""

    def __init__(self, sets, seed):
        self.grid = truth.table()
        self.spread = prior_columns(self.grid).std(axis=1)
        self.priors = {
            name: Prior.of(getattr(self.grid, name), positive=name in {"shear_modulus", "stiffness"})
            for name in truth.PARAMETERS
        }
        self.total, self.seed = len(self.grid.cohesion), seed
        lightest = min(SLIPS) * (1.0 - VARIATION)
        carried = truth.carry(self.grid, truth.MEAN_LOAD * (1.0 + VARIATION), lightest)
        self.left_out = int(np.count_nonzero(~carried))
        rows = np.flatnonzero(carried)
        if sets < len(rows):
            rows = np.sort(np.random.default_rng(seed).choice(rows, sets, replace=False))
        self.soils = self.grid.take(rows)
        self.cells = {}
        self.checked = np.zeros(4)

    def run(self):
        """Simulate, measure and estimate."""
        for place, slip in enumerate(SLIPS):
            rng = np.random.default_rng([self.seed, place])
            channels, slopes = drive(self.soils, slip, rng)
            self.check(channels, rng)
            for points in POINTS:
                for noise in NOISES:
                    windows = measure(channels, self.soils, points, noise, rng)
                    self.cells[slip, points, noise] = self.cell(windows, slopes)

    def check(self, channels, rng):
        """Compare some samples with adaptive integration."""
        sets, most = channels["load"].shape
        each = self.soils.take(np.repeat(np.arange(sets), most))
        rows = rng.choice(sets * most, min(20, sets), replace=False)
        worst = truth.error_of_sample(each, channels["sinkage"].ravel(), channels["slip"].ravel(), rows)
        self.checked = np.maximum(self.checked, worst)

    def cell(self, windows, slopes):
        bound = bound_of(windows, slopes, self.spread) if windows.noise else None
        found = {
            f"{method}, {label}": line_errors(windows, share, method)
            for method in ("least-squares", "ridge")
            for label, share in (("k", 1.0), ("1.5 k", 1.5))
        }
        pivot = bound.pivot if bound else MEAN_STRESS
        found["wong-reece"] = wheel_errors(windows, self.priors, pivot, learn=False)
        found["noise learnt"] = wheel_errors(windows, self.priors, pivot, learn=True)
        return found, bound

    def report(self):
        """Yield the lines of the result."""
        yield from self.header()
        yield from self.errors("1. Without noise, k unknown", 0.0)
        for number, noise in enumerate(NOISES[1:], 2):
            yield from self.errors(f"{number}. {100 * noise:g} % noise on W, T, z and i", noise)
        number = len(NOISES) + 1
        yield from self.against_bound(number, "wong-reece", "wong-reece, told the noise")
        yield from self.against_bound(number + 1, "noise learnt", "wong-reece, noise learnt from the data")

    def header(self):
        spread = self.spread
        phi = np.degrees(np.std(np.arctan(self.grid.tan_phi)))
        off = ", ".join(f"{share:.0e}" for share in self.checked)
        yield "c and φ from one window: errors, what the data allow, and what the intervals cover"
        for paragraph in (
            (
                f"{len(self.soils.cohesion)} of the {self.total} sets of soil parameters, seed {self.seed}. The ranges of "
                "the paper's Table II are not at hand: five values each of n 0.5–1.2, kc 0.9–15 kN/m^(n+1), kφ "
                "500–1600 kN/m^(n+2), c 0.5–10 kPa, φ 15–40° and k 10–30 mm enclose the soils of its Table I. "
                f"{self.left_out} of all sets do not carry {100 * (1 + VARIATION):.0f} % of the mean load before θ1 = 80° and "
                f"are left out. Wheel r = b = 0.1 m, mean load {truth.MEAN_LOAD} N; load and slip vary by "
                f"±{100 * VARIATION:.0f} %, uniform, slip up to {LARGEST_SLIP}. Noise is normal, a share of each of W, T, z "
                "and i; wong-reece is told it, or learns it from the scatter of all windows together."
            ),
            (
                "The truth is the full model with θm = θ1/2 and θ2 = 0, integrated by a composite Gauss–Legendre rule "
                f"of its own; against the scalar adaptive quadrature of tests/simulator it is off by {off} of W, T, "
                "DP/W and z at worst."
            ),
            (
                "Least squares and ridge know the true k, or take it 50 % too large; keq and n they do not need. "
                "wong-reece knows none of c, φ, k, keq and n: its priors are normal with the grid's mean and "
                f"deviation, c ± {spread[0] / 1e3:.2f} kPa, tan φ ± {spread[1]:.3f} (±{phi:.1f}°), log k ± {spread[2]:.2f}, "
                f"log keq ± {spread[3]:.2f}, n ± {spread[4]:.2f}."
            ),
            (
                "The bound is the Bayesian Cramér–Rao bound with the same priors: per sample the balances of W and T "
                "have the covariance R + J Ru Jᵀ, J their derivatives by z and i, at the truth."
            ),
            "Errors are root mean squares over the sets, of c in kPa and φ in degrees, in pairs.",
        ):
            yield from ("", *textwrap.wrap(paragraph, 104))

    def errors(self, title, noise):
        names = ["LS, k", "LS, 1.5 k", "ridge, k", "ridge, 1.5 k", "wong-reece", "noise learnt"]
        claim = CLAIMS.get(noise)
        yield from ("", title)
        yield f"{'slip':>4} {'points':>6}" + heading(
            [*(["paper says"] if claim else []), *names, *(["bound"] if noise else [])]
        )
        for slip in SLIPS:
            for points in POINTS:
                found, bound = self.cells[slip, points, noise]
                cells = [f"{claim[0]:8.3f} {claim[1]:6.2f}"] if claim else []
                cells += [pair(errors, 3 if noise else 4) for errors in found.values()]
                cells += [pair(bound)] if bound else []
                yield f"{slip:>4} {points:>6}" + heading(cells)

    def against_bound(self, number, method, title):
        yield from (
            "",
            f"{number}. {title}: errors over the bound, and coverage of the 95 % intervals in %",
            f"A dot marks what the data hardly tell: a bound above {100 * MEANINGLESS:.0f} % of the prior's deviation.",
            "s is the strength at σ*, the stress at which it is not correlated with tan φ; kPa.",
            f"{'noise':>5} {'slip':>4} {'points':>6}"
            + heading(["c/bound", "φ/bound", "s/bound"], 10)
            + heading(["s error", "σ*"], 10)
            + heading(["c covered", "φ covered", "s covered"], 11),
        )
        phi_prior = rms(np.degrees(self.spread[1] / (1.0 + self.soils.tan_phi**2)))
        worst, covered = 0.0, []
        for (slip, points, noise), (found, bound) in sorted(self.cells.items(), key=lambda cell: cell[0][2]):
            if bound is None:
                continue
            errors, ratios = found[method], []
            for mine, least, prior in (
                (errors.cohesion, bound.cohesion, self.spread[0] / 1e3),
                (errors.phi, bound.phi, phi_prior),
                (errors.strength, bound.strength, np.inf),
            ):
                ratio, tells = rms(mine) / rms(least), rms(least) < MEANINGLESS * prior
                worst = max(worst, ratio) if tells else worst
                ratios.append(f"{ratio:.3f}{' ' if tells else '·'}")
            covered.append(errors.covered)
            yield (
                f"{100 * noise:>4g}% {slip:>4} {points:>6}"
                + heading(ratios, 10)
                + heading([f"{rms(errors.strength):.4f}", f"{np.median(bound.pivot) / 1e3:.2f}"], 10)
                + heading([f"{100 * share:.1f}" for share in np.mean(errors.covered, axis=1)], 11)
            )
        every = 100.0 * np.mean(np.concatenate(covered, axis=1), axis=1)
        unknown = sum(np.count_nonzero(~np.isfinite(found[method].phi)) for found, _ in self.cells.values())
        yield ""
        yield f"Windows without an estimate, of all {len(self.cells) * len(self.soils.cohesion)}: {unknown}."
        yield (
            f"Largest ratio where the bound tells something: {worst:.3f}. Covered over all: c {every[0]:.1f} %, "
            f"φ {every[1]:.1f} %, strength {every[2]:.1f} %."
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--sets", type=int, default=1000, help="sets of soil parameters, drawn from the grid")
    parser.add_argument("--full", action="store_true", help="all 15,625 sets")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    start = time.perf_counter()
    study = Study(sys.maxsize if options.full else options.sets, options.seed)
    study.run()
    text = "\n".join(study.report()) + "\n"
    RESULT.write_text(text, encoding="utf-8")
    print(text, end="")
    print(f"{time.perf_counter() - start:.0f} s", file=sys.stderr)


if __name__ == "__main__":
    main()
