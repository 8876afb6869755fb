"""How fast the full wheel–soil model and its fits are, against scipy in the same run.

    python benchmarks/model_speed.py [ROUNDS]

writes benchmarks/results/model_speed.txt. One core; every cell is the median of ROUNDS interleaved
runs, 5 by default. Only the ratios mean something on another machine.
"""

from __future__ import annotations

import math
import os
import sys
import time
import tracemalloc
from pathlib import Path
from statistics import median

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import numpy as np
from scipy.integrate import quad
from scipy.optimize import least_squares

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent)]

from terrain_cli.estimation.wheel_fit import DEFAULT, Noise, fit  # noqa: E402 - found through the path
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict  # noqa: E402 - as above

RESULT = HERE / "results" / "model_speed.txt"
WHEEL = WheelGeometry(0.1, 0.1)
SOIL = {
    "cohesion": 1e3,
    "tan_phi": 0.6,
    "shear_modulus": 0.018,
    "stiffness": 1.5e6,
    "sinkage_exponent": 0.9,
}
SAMPLES, BY_QUAD = 1_000_000, 200
WINDOWS, POINTS = 1_000, 30
#: Windows fitted by the slow ways in each round.
BY_QUAD_WINDOWS, BY_DIFFERENCES_WINDOWS = 2, 20
NOISE = 0.01
PRIORS = {name: DEFAULT[name] for name in ("cohesion", "tan_phi", "shear_modulus")}


def wheel_by_quad(functions, z, i, cohesion, tan_phi, shear_modulus, stiffness, sinkage_exponent):
    """Return W, T, DP of one sample as equations [1] to [9] stand, with quad on each arc.

    `functions` is math, or numpy as in most scripts, whose functions are slow on single numbers.
    """
    cos, sin, exp = functions.cos, functions.sin, functions.exp
    r, b = WHEEL.radius, WHEEL.width
    entry = math.acos(1.0 - z / r)
    peak = entry / 2.0

    def sigma(theta):
        front = theta if theta >= peak else entry - theta * (entry - peak) / peak
        return stiffness * (r * (cos(front) - cos(entry))) ** sinkage_exponent

    def tau(theta):
        travel = r * (entry - theta - (1.0 - i) * (sin(entry) - sin(theta)))
        return (cohesion + sigma(theta) * tan_phi) * (1.0 - exp(-travel / shear_modulus))

    def integral(of):
        return quad(of, 0.0, peak)[0] + quad(of, peak, entry)[0]

    return (
        r * b * integral(lambda t: sigma(t) * cos(t) + tau(t) * sin(t)),
        r * r * b * integral(tau),
        r * b * integral(lambda t: tau(t) * cos(t) - sigma(t) * sin(t)),
    )


def timed(run):
    start = time.perf_counter()
    result = run()
    return time.perf_counter() - start, result


def forward(rounds):
    """Return the rows of the forward model."""
    rng = np.random.default_rng(1)
    channels = {"sinkage": rng.uniform(0.002, 0.05, SAMPLES), "slip": rng.uniform(0.05, 0.9, SAMPLES)}
    pairs = list(zip(channels["sinkage"][:BY_QUAD], channels["slip"][:BY_QUAD], strict=True))
    ways = {
        "predict, 10^6 samples": lambda: predict(Model(), WHEEL, channels, SOIL),
        "quad, functions of numpy": lambda: [wheel_by_quad(np, z, i, **SOIL) for z, i in pairs],
        "quad, functions of math": lambda: [wheel_by_quad(math, z, i, **SOIL) for z, i in pairs],
    }
    times, results = interleaved(ways, rounds)
    per_sample = {
        way: seconds / (SAMPLES if way.startswith("predict") else BY_QUAD) for way, seconds in times.items()
    }
    found = results["predict, 10^6 samples"]
    ours = np.array([found.load[:BY_QUAD], found.torque[:BY_QUAD], found.drawbar_pull[:BY_QUAD]])
    peer = np.array(results["quad, functions of numpy"]).T
    worst = np.max(np.abs(ours - peer) / np.abs(peer[[0, 1, 0]]))
    fastest = per_sample["predict, 10^6 samples"]
    yield "1. W, T and DP of a sample, sinkage measured"
    for way, seconds in per_sample.items():
        yield f"{way:<40}{1e6 * seconds:12.2f} µs{seconds / fastest:12.0f} ×"
    yield f"largest difference, as a share (of the load for DP): {worst:.1e}"
    by = ("cohesion", "tan_phi", "shear_modulus", "stiffness", "sinkage_exponent", "sinkage", "slip")
    few = {name: column[:100_000] for name, column in channels.items()}
    seconds = median(timed(lambda: predict(Model(), WHEEL, few, SOIL, by=by))[0] for _ in range(rounds))
    yield f"{'predict with its 7 derivatives':<40}{1e6 * seconds / 100_000:12.2f} µs"
    tracemalloc.start()
    predict(Model(), WHEEL, channels, SOIL)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    yield f"peak memory of predict on 10^6 samples: {peak / 2**20:.0f} MB, of which results {3 * 8 * SAMPLES / 2**20:.0f} MB"


def interleaved(ways, rounds):
    """Return the median time of each way and its last result."""
    times = {way: [] for way in ways}
    results = {}
    for _ in range(rounds):
        for way, run in ways.items():
            seconds, results[way] = timed(run)
            times[way].append(seconds)
    return {way: median(all_) for way, all_ in times.items()}, results


def drawn(n, seed=2):
    """Draw soils, loads and slips of wide ranges, which enclose the published soils."""
    rng = np.random.default_rng(seed)
    values = {
        "cohesion": rng.uniform(0.5e3, 10e3, n),
        "tan_phi": np.tan(np.radians(rng.uniform(15.0, 40.0, n))),
        "shear_modulus": rng.uniform(0.01, 0.03, n),
        "stiffness": rng.uniform(0.9e3, 15e3, n) / WHEEL.width + rng.uniform(500e3, 1600e3, n),
        "sinkage_exponent": rng.uniform(0.5, 1.2, n),
    }
    return values, {"load": 98.1 * rng.uniform(0.1, 2.0, n), "slip": rng.uniform(0.0, 1.0, n)}


def sought_sinkage():
    """Return the rows of the sinkage solved from the load."""
    values, channels = drawn(SAMPLES)
    seconds, found = timed(lambda: predict(Model(), WHEEL, channels, values, given="load"))
    known = np.isfinite(found.sinkage)
    deepest = np.full(SAMPLES, WHEEL.radius * (1.0 - math.cos(1.5)))
    limit = predict(Model(), WHEEL, {"sinkage": deepest, "slip": channels["slip"]}, values).load
    given_up = np.count_nonzero(~known & (limit >= channels["load"]))
    back = predict(
        Model(),
        WHEEL,
        {"sinkage": found.sinkage[known], "slip": channels["slip"][known]},
        {name: column[known] for name, column in values.items()},
    )
    off = np.abs(back.load / channels["load"][known] - 1.0)
    yield "2. Sinkage solved from the load, 10^6 random soils, loads of 10 to 196 N and slips of 0 to 1"
    yield f"{'predict, given load':<40}{1e6 * seconds / SAMPLES:12.2f} µs"
    yield (
        f"stuck wheels, whose soil does not carry the load before θ1 = 86°: {np.count_nonzero(~known)}; "
        f"given up though carried: {given_up}; not converged (load off by 1e-7 of itself): "
        f"{np.count_nonzero(off > 1e-7)}; largest error {off.max():.1e}"
    )


def windows(count=WINDOWS):
    """Return channels of windows, torque with noise."""
    rng = np.random.default_rng(3)
    shape = (count, POINTS)
    soil = {
        "cohesion": rng.uniform(0.5e3, 5e3, count),
        "tan_phi": np.tan(np.radians(rng.uniform(20.0, 40.0, count))),
        "shear_modulus": rng.uniform(0.01, 0.03, count),
    }
    channels = {"sinkage": rng.uniform(0.004, 0.02, shape), "slip": rng.uniform(0.05, 0.9, shape)}
    flat = {name: column.ravel() for name, column in channels.items()}
    each = {name: np.repeat(value, POINTS) for name, value in soil.items()}
    torque = predict(Model(), WHEEL, flat, {**SOIL, **each}).torque.reshape(shape)
    channels["torque"] = torque * (1.0 + NOISE * rng.standard_normal(shape))
    return channels


def by_least_squares(channels, window, torque_of):
    """Fit c, tan φ and log k of one window with the same priors as `fit`, and differences for derivatives."""
    z, i, measured = (channels[name][window] for name in ("sinkage", "slip", "torque"))
    mean, spread = np.array(
        [
            (PRIORS["cohesion"].mean, PRIORS["cohesion"].sd),
            (PRIORS["tan_phi"].mean, PRIORS["tan_phi"].sd),
            PRIORS["shear_modulus"].of_logarithm(),
        ]
    ).T

    def residual(x):
        c, tan_phi, log_k = mean + spread * x
        found = torque_of(z, i, c, tan_phi, math.exp(log_k))
        return np.concatenate([(found - measured) / (NOISE * measured), x])

    return mean + spread * least_squares(residual, np.zeros(3)).x


def torque_by_quad(z, i, c, tan_phi, k):
    """Return the torques of a window, each by quad on both arcs."""
    r, b, keq, n = WHEEL.radius, WHEEL.width, SOIL["stiffness"], SOIL["sinkage_exponent"]

    def torque(entry, slip):
        peak = entry / 2.0

        def tau(theta):
            front = theta if theta >= peak else entry - theta * (entry - peak) / peak
            sigma = keq * (r * (np.cos(front) - np.cos(entry))) ** n
            travel = r * (entry - theta - (1.0 - slip) * (np.sin(entry) - np.sin(theta)))
            return (c + sigma * tan_phi) * (1.0 - np.exp(-travel / k))

        return r * r * b * (quad(tau, 0.0, peak)[0] + quad(tau, peak, entry)[0])

    return np.array([torque(*pair) for pair in zip(np.arccos(1.0 - z / r), i, strict=True)])


def torque_by_model(z, i, c, tan_phi, k):
    values = {**SOIL, "cohesion": c, "tan_phi": tan_phi, "shear_modulus": k}
    return predict(Model(), WHEEL, {"sinkage": z, "slip": i}, values).torque


def fits(rounds):
    """Return the rows of the fit."""
    channels = windows()
    flat = {name: column.ravel() for name, column in channels.items()}
    edges = np.arange(WINDOWS + 1) * POINTS
    held = {name: SOIL[name] for name in ("stiffness", "sinkage_exponent")}
    noise = Noise({"torque": NOISE})
    counts = {"fit": WINDOWS, "difference": BY_DIFFERENCES_WINDOWS, "quad": BY_QUAD_WINDOWS}
    ways = {
        "fit": lambda: fit(
            Model(), WHEEL, flat, edges, fixed=held, priors=PRIORS, noise=noise, correlated=False
        ),
        "difference": lambda: [
            by_least_squares(channels, window, torque_by_model) for window in range(counts["difference"])
        ],
        "quad": lambda: [
            by_least_squares(channels, window, torque_by_quad) for window in range(counts["quad"])
        ],
    }
    labels = {
        "fit": f"fit, {WINDOWS:,} windows",
        "difference": "least_squares over predict, differences",
        "quad": "least_squares over quad",
    }
    times, results = interleaved(ways, rounds)
    per_window = {way: seconds / counts[way] for way, seconds in times.items()}
    yield f"3. c, φ and k of a window of {POINTS} samples from torque, {100 * NOISE:.0f} % noise; keq and n known"
    for way, seconds in per_window.items():
        yield f"{labels[way]:<40}{1e3 * seconds:12.3f} ms{seconds / per_window['fit']:12.0f} ×"
    found = results["fit"]
    ours = np.array(
        [found.values["cohesion"], found.values["tan_phi"], np.log(found.values["shear_modulus"])]
    ).T
    errors = np.array(
        [
            found.errors["cohesion"],
            found.errors["tan_phi"],
            found.errors["shear_modulus"] / found.values["shear_modulus"],
        ]
    ).T
    for way in ("difference", "quad"):
        apart = (ours[: counts[way]] - np.array(results[way])) / errors[: counts[way]]
        yield (
            f"{labels[way]}: c, tan φ and log k differ by {np.sqrt(np.mean(apart**2)):.3f} standard errors rms, "
            f"{np.abs(apart).max():.3f} at most"
        )
    yield "(fit gives posterior means, least_squares the mode: they differ by the skewness)"


def main(rounds):
    lines = [
        "The full wheel–soil model and its fits against scipy, one core, medians of interleaved runs",
        "",
        *forward(rounds),
        "",
        *sought_sinkage(),
        "",
        *fits(rounds),
    ]
    text = "\n".join(lines) + "\n"
    RESULT.write_text(text, encoding="utf-8")
    print(text, end="")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:] or ["5"]))
