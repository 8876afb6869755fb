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
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests"), str(HERE)]

import wheel_truth as truth  # noqa: E402 - found through the path above
from accuracy_cells import (  # noqa: E402 - as above
    LARGEST_SLIP,
    MEAN_STRESS,
    NOISES,
    NORMAL_95,
    POINTS,
    SLIPS,
    bound_of,
    drive,
    line_errors,
    measure,
    prior_columns,
    rms,
    wheel_errors,
)
from simulator import paper  # noqa: E402 - as above

from terrain_cli.estimation.wheel_fit import DEFAULT, Prior  # noqa: E402 - as above

RESULT = HERE / "results" / "accuracy_study.txt"
POSITIVE = {"shear_modulus", "stiffness"}
#: The paper's estimators with the true k and with that which it assumes.
LINES = ("LS, k", "LS, 1.5 k", "ridge, k", "ridge, 1.5 k")
#: Above this share of the prior's deviation the bound says that the data tell nothing.
MEANINGLESS = 0.9


def pair(errors, digits=3):
    return f"{rms(errors.cohesion):8.{digits}f} {rms(errors.phi):6.{digits - 1}f}"


def prior_of(values, *, positive):
    """Return the prior with the mean and the variance of values, or of their logarithms if positive."""
    if positive:
        return Prior.factor(np.exp(np.log(values).mean()), np.exp(np.log(values).std()))
    return Prior(float(values.mean()), float(values.std()))


def range_95(prior, logarithm):
    """Return the ends between which a parameter lies with 95 %, shape (2,)."""
    mean, deviation = prior.of_logarithm() if logarithm else (prior.mean, prior.sd)
    ends = mean + NORMAL_95 * deviation * np.array([-1.0, 1.0])
    return np.exp(ends) if logarithm else ends


def between(ends):
    return " – ".join(f"{end:,.0f}" if abs(end) >= 100 else f"{end:.3g}" for end in ends)


def heading(names, width=16):
    return "".join(f"{name:>{width}}" for name in names)


class Study:
    """Every cell of the study: a slip, a number of points and a noise."""

    def __init__(self, sets, seed):
        self.grid = truth.table()
        self.spread = prior_columns(self.grid).std(axis=1)
        self.priors = {
            name: prior_of(getattr(self.grid, name), positive=name in POSITIVE) for name in truth.PARAMETERS
        }
        self.total, self.seed = len(self.grid.cohesion), seed
        lightest = min(SLIPS) * (1.0 - paper.VARIATION)
        carried = truth.carry(self.grid, paper.LOAD * (1.0 + paper.VARIATION), lightest)
        self.left_out = int(np.count_nonzero(~carried))
        rows = np.flatnonzero(carried)
        if sets < len(rows):
            rows = np.sort(np.random.default_rng(seed).choice(rows, sets, replace=False))
        self.soils = self.grid.take(rows)
        self.cells, self.claims = {}, {}
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
            for claim in paper.CLAIMS:
                windows = measure(channels, self.soils, claim.points, claim.noise, rng, of_maximum=True)
                self.claims[slip, claim] = self.line(windows)
                self.claims[slip, claim]["noise learnt"] = wheel_errors(
                    windows, self.priors, MEAN_STRESS, learn=True
                )

    def check(self, channels, rng):
        """Compare some samples with adaptive integration."""
        sets, most = channels["load"].shape
        each = self.soils.take(np.repeat(np.arange(sets), most))
        rows = rng.choice(sets * most, min(20, sets), replace=False)
        worst = truth.error_of_sample(each, channels["sinkage"].ravel(), channels["slip"].ravel(), rows)
        self.checked = np.maximum(self.checked, worst)

    def cell(self, windows, slopes):
        bound = bound_of(windows, slopes, self.spread) if windows.noise else None
        found = self.line(windows)
        pivot = bound.pivot if bound else MEAN_STRESS
        found["wong-reece"] = wheel_errors(windows, self.priors, pivot, learn=False)
        found["noise learnt"] = wheel_errors(windows, self.priors, pivot, learn=True)
        return found, bound

    @staticmethod
    def line(windows):
        """Return the errors of the paper's estimators."""
        return {
            f"{method}, {label}": line_errors(windows, share, method)
            for method in ("least-squares", "ridge")
            for label, share in (("k", 1.0), ("1.5 k", paper.ASSUMED_K))
        }

    def report(self):
        """Yield the lines of the result."""
        yield from self.header()
        yield from self.shipped_priors()
        yield from self.claimed()
        for number, noise in enumerate(NOISES, 2):
            what = f"{100 * noise:g} % noise on W, T, z and i" if noise else "Without noise, k unknown"
            yield from self.errors(f"{number}. {what}", noise)
        number = len(NOISES) + 2
        yield from self.against_bound(number, "wong-reece", "wong-reece, told the noise")
        yield from self.against_bound(number + 1, "noise learnt", "wong-reece, noise learnt from the data")

    def header(self):
        spread = self.spread
        phi = np.degrees(np.std(np.arctan(self.grid.tan_phi)))
        off = ", ".join(f"{share:.0e}" for share in self.checked)
        yield "c and φ from one window: errors, what the data allow, and what the intervals cover"
        for paragraph in (
            (
                f"{len(self.soils.cohesion)} of the {self.total} sets of soil parameters, seed {self.seed}: five values each of "
                "the six parameters of Table II of Iagnemma et al. 2004, of which the ranges stand below. "
                f"{self.left_out} of all sets do not carry {100 * (1 + paper.VARIATION):.0f} % of the mean load before θ1 = 80° "
                f"and are left out. Wheel r = b = {truth.RADIUS} m, mean load {paper.LOAD} N; load and slip vary by "
                f"±{100 * paper.VARIATION:.0f} %, uniform, slip up to {LARGEST_SLIP}. Noise is normal, from section 3 on a share of "
                "each of W, T, z and i; wong-reece is told it, or learns it from the scatter of all windows together."
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

    def shipped_priors(self):
        """Yield the ranges of Table II beside the priors of the program, of which the study makes no use."""
        ends = {name: np.array(pair) for name, pair in paper.TABLE_II.items()}
        priors = {name: range_95(prior, name in POSITIVE) for name, prior in DEFAULT.items()}
        stiffness = ends["cohesive_modulus"] / truth.WIDTH + ends["frictional_modulus"]
        rows = (
            ("c", "kPa", ends["cohesion"] / 1e3, priors["cohesion"] / 1e3),
            ("φ", "degrees", np.degrees(ends["friction_angle"]), np.degrees(np.arctan(priors["tan_phi"]))),
            ("k", "mm", ends["shear_modulus"] * 1e3, priors["shear_modulus"] * 1e3),
            ("n", "", ends["exponent"], priors["sinkage_exponent"]),
            ("kc", "kPa/m^(n-1)", ends["cohesive_modulus"] / 1e3, None),
            ("kφ", "kPa/m^n", ends["frictional_modulus"] / 1e3, None),
            ("keq", "kPa/m^n", stiffness / 1e3, priors["stiffness"] / 1e3),
        )
        yield from (
            "",
            "Table II, and what the program takes for likely of any soil (not used in this study)",
        )
        yield f"{'':<4} {'unit':<12}{'Table II':>16}{'prior, 95 %':>20}"
        for name, unit, grid, prior in rows:
            yield f"{name:<4} {unit:<12}{between(grid):>16}{between(prior) if prior is not None else '-':>20}"
        yield from textwrap.wrap(
            "keq = kc/b + kφ is what the program knows of kc and kφ. c is normal, and tan φ, kept within 0 to "
            "60°; k and keq are log-normal. The k expected is that of rover.toml, of which 18 mm is an example.",
            104,
        )

    def claimed(self):
        """Yield the paper's claims beside what its estimators, and the full model, reach in the same cells."""
        yield from (
            "",
            "1. What the paper claims; noise, where there is any, is a share of each channel's maximum",
        )
        yield f"{'slip':>4} {'points':>6} {'noise':>5}" + heading(["paper says", *LINES, "noise learnt"])
        for (slip, claim), found in self.claims.items():
            cells = [f"{claim.cohesion:8.3f} {claim.phi:6.2f}", *map(pair, found.values())]
            yield f"{slip:>4} {claim.points:>6} {100 * claim.noise:>4g}%" + heading(cells)

    def errors(self, title, noise):
        yield from ("", title)
        yield f"{'slip':>4} {'points':>6}" + heading(
            [*LINES, "wong-reece", "noise learnt", *(["bound"] if noise else [])]
        )
        for slip in SLIPS:
            for points in POINTS:
                found, bound = self.cells[slip, points, noise]
                cells = [pair(errors, 3 if noise else 4) for errors in found.values()]
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
