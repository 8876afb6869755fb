"""The full model, forward and fitted: the cases of `model_speed`, that tells more of them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks import model_speed as speed
from benchmarks.harness import Case, Stage
from terrain_cli.estimation.wheel_fit import Noise, fit
from terrain_cli.mechanics.wheel_model import Model, predict

if TYPE_CHECKING:
    from pathlib import Path

SAMPLES = {"small": 10_000, "medium": 200_000, "full": 1_000_000}
WINDOWS = {"small": 100, "medium": 1_000, "full": 10_000}


def same_forces(ours, peer) -> str:
    """Compare W, T and DP."""
    found = np.array([ours.load, ours.torque, ours.drawbar_pull])[:, : speed.BY_QUAD]
    exact = np.array(peer).T
    worst = float(np.max(np.abs(found - exact) / np.abs(exact[[0, 1, 0]])))
    if worst > 1e-8:
        raise AssertionError(f"forces differ by {worst:.1e}")
    return f"largest difference {worst:.0e}"


def forward(size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case of the forward model."""
    rng = np.random.default_rng(1)
    n = SAMPLES[size]
    channels = {"sinkage": rng.uniform(0.002, 0.05, n), "slip": rng.uniform(0.05, 0.9, n)}
    pairs = list(zip(channels["sinkage"][: speed.BY_QUAD], channels["slip"][: speed.BY_QUAD], strict=True))
    return Case(
        lambda: predict(Model(), speed.WHEEL, channels, speed.SOIL),
        lambda: [speed.wheel_by_quad(np, z, i, **speed.SOIL) for z, i in pairs],
        same_forces,
        None,
        n,
        speed.BY_QUAD,
        "samples",
    )


def same_soils(ours, peer) -> str:
    """Compare: ours are posterior means and the peer's the mode, which differ by the skewness."""
    few = slice(speed.BY_QUAD_WINDOWS)
    values, errors = ours.values, ours.errors
    found = np.array([values["cohesion"], values["tan_phi"], np.log(values["shear_modulus"])]).T[few]
    spread = np.array(
        [errors["cohesion"], errors["tan_phi"], errors["shear_modulus"] / values["shear_modulus"]]
    ).T[few]
    worst = float(np.max(np.abs(found - np.array(peer)) / spread))
    if worst > 0.3:
        raise AssertionError(f"soils differ by {worst:.2f} standard errors")
    return f"soils differ by {worst:.2f} standard errors at most (means against modes)"


def fits(size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case of the fit."""
    channels = speed.windows(WINDOWS[size])
    flat = {name: column.ravel() for name, column in channels.items()}
    edges = np.arange(WINDOWS[size] + 1) * speed.POINTS
    held = {name: speed.SOIL[name] for name in ("stiffness", "sinkage_exponent")}
    noise = Noise({"torque": speed.NOISE})

    def ours():
        return fit(
            Model(), speed.WHEEL, flat, edges, fixed=held, priors=speed.PRIORS, noise=noise, correlated=False
        )

    def peer():
        return [
            speed.by_least_squares(channels, window, speed.torque_by_quad)
            for window in range(speed.BY_QUAD_WINDOWS)
        ]

    return Case(ours, peer, same_soils, None, WINDOWS[size], speed.BY_QUAD_WINDOWS, "windows")


STAGES = (
    Stage("model forward", "scipy quad on both arcs", partial(forward), 1500.0, 3500.0),
    Stage("model fit", "scipy least_squares over quad", partial(fits), 2000.0, 5000.0),
)
