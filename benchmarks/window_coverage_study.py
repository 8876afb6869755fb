"""Whether the errors of the full model hold: windows of six vehicles on ten soils, rough loads, noise unknown.

    python benchmarks/window_coverage_study.py [--windows N] [--seed N]

writes benchmarks/results/window_coverage_study.txt, in some minutes on one core. The truth is that of
`wheel_truth`, code and quadrature other than those that are fitted.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests"), str(HERE)]

import wheel_truth as truth  # noqa: E402 - found through the path above

from terrain_cli.estimation.wheel_fit import Noise, fit  # noqa: E402 - as above
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry  # noqa: E402 - as above

RESULT = HERE / "results" / "window_coverage_study.txt"
#: c in kPa, φ in degrees, k in m, kc in kPa/m^(n-1), kφ in kPa/m^n, n: Table I of the paper, and others of its range.
SOILS = {
    "dry sand": (1.0, 30.0, 0.025, 0.9, 1523.4, 1.1),
    "sandy loam": (1.7, 29.0, 0.025, 5.3, 1515.0, 0.7),
    "clayey soil": (4.14, 13.0, 0.010, 13.2, 692.2, 0.5),
    "snow": (1.0, 19.7, 0.040, 4.4, 196.7, 1.6),
    "lunar regolith": (0.17, 35.0, 0.018, 1.4, 820.0, 1.0),
    "firm soil": (6.0, 33.0, 0.012, 30.0, 2500.0, 0.8),
    "bentonite": (0.7, 32.1, 0.015, 5.0, 1200.0, 0.9),
    "topsoil": (1.04, 43.7, 0.020, 8.0, 2000.0, 1.0),
    "loose sand": (0.3, 27.0, 0.030, 1.0, 500.0, 0.9),
    "clay loam": (8.0, 22.0, 0.015, 40.0, 1500.0, 0.6),
}
#: Radius and width in m, mean load in N.
VEHICLES = (
    (0.05, 0.05, 15.0),
    (0.073, 0.06, 30.0),
    (0.10, 0.10, 98.0),
    (0.13, 0.10, 110.0),
    (0.20, 0.16, 250.0),
    (0.30, 0.25, 600.0),
)
NOISES, ROUGHNESS, SAMPLES = (0.01, 0.03, 0.10), ("white", "AR(1) 0.95", "smooth"), 300
MEAN_SLIP, DEEPEST = 0.35, 0.6


class Window(NamedTuple):
    soil: tuple
    wheel: WheelGeometry
    channels: dict
    noise: Noise


def wander(kind, rng):
    """Return a series of mean 0 and variance 1."""
    white = rng.standard_normal(SAMPLES)
    if kind == "white":
        return white
    if kind == "smooth":
        turns = rng.uniform(1.0, 4.0)
        return np.sqrt(2.0) * np.sin(2.0 * np.pi * (turns * np.linspace(0.0, 1.0, SAMPLES) + rng.random()))
    for step in range(1, SAMPLES):
        white[step] = 0.95 * white[step - 1] + np.sqrt(1.0 - 0.95**2) * white[step]
    return white


def window(noise, roughness, pull, rng):
    """Draw a window; None where the soil does not carry the wheel."""
    soil = list(SOILS.values())[rng.integers(len(SOILS))]
    radius, width, weight = VEHICLES[rng.integers(len(VEHICLES))]
    cohesion, phi, modulus, kc, kphi, exponent = soil
    values = (cohesion * 1e3, np.tan(np.radians(phi)), modulus, (kc / width + kphi) * 1e3, exponent)
    soils = truth.Soils(*(np.full(SAMPLES, value) for value in values))
    load = weight * np.clip(1.0 + 0.25 * wander(roughness, rng), 0.3, 2.0)
    slip = np.clip(MEAN_SLIP + 0.25 * wander("smooth", rng) + 0.05 * wander(roughness, rng), 0.03, 0.9)
    try:
        depth = truth.sinkage(soils, load, slip, (radius, width))
    except ValueError:
        return None
    torque, drawbar = truth.forces(soils, depth, slip, (radius, width))[1:]
    channels = {"load": load, "torque": torque, "sinkage": depth, "slip": slip}
    if pull:
        channels["drawbar_pull"] = drawbar
    size = {name: float(np.sqrt(np.mean(column**2))) for name, column in channels.items()} | {
        "slip": MEAN_SLIP
    }
    sensors = Noise(absolute={name: noise * size[name] for name in channels})
    measured = {
        name: column + noise * size[name] * rng.standard_normal(SAMPLES) for name, column in channels.items()
    }
    if depth.max() > DEEPEST * radius or min(measured["sinkage"].min(), measured["load"].min()) <= 0.0:
        return None
    return Window(soil, WheelGeometry(radius, width), measured, sensors)


def judged(drawn, noise):
    """Return how many standard errors c, φ and strength are off, the relative error said of the strength, and `ok`."""
    found = fit(Model("wong-reece"), drawn.wheel, drawn.channels, [0, SAMPLES], noise=noise)
    cohesion, phi = drawn.soil[0] * 1e3, np.radians(drawn.soil[1])
    strength = cohesion + found.sigma_star[0] * np.tan(phi)
    return (
        (found.values["cohesion"][0] - cohesion) / found.errors["cohesion"][0],
        (found.phi[0] - phi) / found.phi_se[0],
        (found.strength[0] - strength) / found.strength_se[0],
        found.strength_se[0] / strength,
        found.status[0] == "ok",
    )


def cell(number, noise, roughness, pull, seed):
    rng = np.random.default_rng([seed, round(1000 * noise), ROUGHNESS.index(roughness), pull])
    learnt, told = [], []
    while len(learnt) < number:
        drawn = window(noise, roughness, pull, rng)
        if drawn:
            learnt.append(judged(drawn, None))
            told.append(judged(drawn, drawn.noise))
    return np.array(learnt, float), np.array(told, float)


def lines(number, seed):
    yield "Do the errors of the full model hold? Noise of the sensors learnt from the window itself, k unknown"
    yield ""
    yield f"{number} windows of {SAMPLES} samples a row, seed {seed}; six vehicles of 5 to 30 cm radius, ten soils. The load"
    yield "wanders by 25 %. covered: share of 95 % intervals that hold the truth. false ok: rows marked ok of which c or φ is"
    yield "more than three standard errors off. width: median of the strength's error over that with the noise told."
    yield ""
    yield f"{'noise':>5} {'roughness':<11}{'pull':<5}{'c':>6}{'φ':>6}{'strength':>10}{'ok':>6}{'false ok':>10}{'worst':>7}{'width':>7}"
    false = okay = 0
    for noise in NOISES:
        for roughness in ROUGHNESS:
            for pull in (False, True):
                learnt, told = cell(number, noise, roughness, pull, seed)
                off = np.abs(learnt[:, :3])
                ok = learnt[:, 4] > 0.0
                wrong = int(np.count_nonzero(ok & (off[:, :2] > 3.0).any(axis=1)))
                false, okay = false + wrong, okay + int(ok.sum())
                covered = 100.0 * np.mean(off < 1.96, axis=0)
                width = np.median(learnt[:, 3] / told[:, 3])
                yield (
                    f"{noise:>5.0%} {roughness:<11}{'yes' if pull else 'no':<5}{covered[0]:>5.0f}%{covered[1]:>5.0f}%"
                    f"{covered[2]:>9.0f}%{ok.sum():>6}{wrong:>10}{off[ok, :2].max(initial=0.0):>7.1f}{width:>7.2f}"
                )
    yield ""
    yield f"Rows marked ok: {okay}; more than three standard errors off: {false} ({false / okay:.1%})."


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=120, help="windows of each row of the table")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    told = []
    for line in lines(asked.windows, asked.seed):
        print(line, flush=True)
        told.append(line)
    RESULT.write_text("\n".join(told) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
