"""x and y of the line from load, torque, sinkage and slip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness import Case, Stage
from terrain_cli.mechanics import linear

if TYPE_CHECKING:
    from pathlib import Path

SAMPLES = {"small": 10_000, "medium": 1_000_000, "full": 10_000_000}
GEOMETRY = {"radius": 0.1, "width": 0.1, "shear_modulus": 0.018}


def straightforward(load, torque, sinkage, slip, *, radius, width, shear_modulus):
    """Equations [10] to [25] as they stand in Iagnemma et al. 2004, without κ3."""
    r, b, k = radius, width, shear_modulus
    theta1 = np.arccos(1.0 - sinkage / r)
    thetam = theta1 / 2.0
    A = 1.0 - np.exp(-(r / k) * (theta1 - thetam + (1.0 - slip) * (np.sin(thetam) - np.sin(theta1))))
    kappa1 = A * (theta1**2 * load * r + 4.0 * torque * np.sin(theta1) - 8.0 * torque * np.sin(theta1 / 2.0))
    kappa2 = 4.0 * torque * (np.cos(theta1) - 2.0 * np.cos(theta1 / 2.0) + 1.0)
    kappa4 = (
        r**2
        * b
        * theta1
        * (
            np.cos(theta1)
            - 2.0 * np.cos(theta1 / 2.0)
            + 2.0 * A * np.cos(theta1)
            - 4.0 * A * np.cos(theta1 / 2.0)
            + 2.0 * A
            + 1.0
        )
    )
    return -kappa1 / kappa4, kappa2 / kappa4


def channels(n: int) -> tuple[np.ndarray, ...]:
    """Return load, torque, sinkage and slip."""
    rng = np.random.default_rng(4)
    return (
        rng.uniform(50.0, 150.0, n),
        rng.uniform(1.0, 6.0, n),
        rng.uniform(0.002, 0.03, n),
        rng.uniform(0.05, 0.9, n),
    )


def same(ours, peer) -> str:
    """Compare."""
    worst = max(float(np.max(np.abs(a - b) / np.max(np.abs(b)))) for a, b in zip(ours, peer, strict=True))
    if worst > 1e-10:
        raise AssertionError(f"stresses differ by {worst:.1e} of the largest")
    return f"largest difference {worst:.0e} of the largest stress"


def make(size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case."""
    n = SAMPLES[size]
    given = channels(n)
    return Case(
        lambda: linear.line_coordinates(*given, **GEOMETRY),
        lambda: straightforward(*given, **GEOMETRY),
        same,
        lambda: (given[0] + given[1], given[2] + given[3]),
        n,
        n,
        "samples",
    )


STAGES = (Stage("stresses x, y", "the paper's equations in NumPy", make, 6.0, 10.0),)
