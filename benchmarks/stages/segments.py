"""Change points of the line y = c + x tan φ: short drives against ruptures, long ones against one pass."""

from __future__ import annotations

import itertools
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.harness import Case, Stage
from benchmarks.rover_bag import GEOMETRY, drive
from terrain_cli.mechanics import linear
from terrain_cli.windows.change_points import change_points

if TYPE_CHECKING:
    from pathlib import Path

LONG = {"small": 100_000, "medium": 1_000_000, "full": 10_000_000}
#: Samples of a stretch of one soil in long drives.
SOIL_SAMPLES = 5_000
#: Changes found this many samples beside the true ones are found.
TOLERANCE = 12
#: Penalty of the peer in units of the noise's variance across the line, where ours is 25 by default.
PENALTY = 25.0


@lru_cache(maxsize=2)
def stresses(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x, y and the samples where the soil changes."""
    pieces, changes = [], []
    length = min(n, 4 * SOIL_SAMPLES)
    truth = drive(length / 100.0, 100.0)
    angular = truth["angular_velocity"][:, 0]
    slip = 1.0 - truth["speed"] / (GEOMETRY["radius"] * angular)
    x, y = linear.line_coordinates(
        truth["load"][:, 0], truth["torque"][:, 0], truth["sinkage"][:, 0], slip, **GEOMETRY
    )
    for begin in range(0, n, length):
        pieces.append(slice(0, min(length, n - begin)))
        changes += [begin + c for c in (0, *truth["changes"]) if 0 < begin + c < n and c < n - begin]
    # Noise of its own, or the pieces would repeat themselves.
    rng = np.random.default_rng(11)
    x = np.concatenate([x[piece] for piece in pieces])
    y = np.concatenate([y[piece] for piece in pieces])
    return (
        x * (1.0 + 0.005 * rng.standard_normal(n)),
        y * (1.0 + 0.005 * rng.standard_normal(n)),
        np.array(changes),
    )


#: Times our penalty, at which the peer finds no change in a wild value either.
TOLD = 2.0


def with_ruptures(x, y, penalty):
    import ruptures

    signal = np.column_stack([y, x, np.ones(len(x))])
    return ruptures.Pelt(model="linear", min_size=10, jump=1).fit(signal).predict(pen=penalty)


def found(bounds, truth) -> int:
    """Count the true changes that a result has."""
    return int(np.sum(np.min(np.abs(np.asarray(bounds)[:, None] - truth[None, :]), axis=0) <= TOLERANCE))


def short(n: int, size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case of a short drive."""
    x, y, truth = stresses(n)

    def check(ours, peer):
        inner = ours[1:-1]
        hits = found(inner, truth), found(peer[:-1], truth)
        if hits != (len(truth), len(truth)) or len(inner) != len(truth) or len(peer) - 1 != len(truth):
            raise AssertionError(f"of {len(truth)} changes {hits} found; {inner} and {peer}")
        return f"both find the {len(truth)} changes and no other"

    # Across the line, from the residuals of a line in each soil: the peer must be told.
    edges = [0, *truth, n]
    variance = np.mean(
        [np.polyfit(x[a:b], y[a:b], 1, full=True)[1][0] / (b - a) for a, b in itertools.pairwise(edges)]
    )
    return Case(
        lambda: change_points(x, y),
        lambda: with_ruptures(x, y, TOLD * PENALTY * variance),
        check,
        unit="drive",
    )


def block_sums(x, y, length):
    """One pass: the sums of x, y, x², xy and y² over blocks."""
    n = len(x) // length * length
    u, v = x[:n].reshape(-1, length), y[:n].reshape(-1, length)
    return (
        u.sum(1),
        v.sum(1),
        np.einsum("ij,ij->i", u, u),
        np.einsum("ij,ij->i", u, v),
        np.einsum("ij,ij->i", v, v),
    )


def long(size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case of a long drive."""
    n = LONG[size]
    x, y, truth = stresses(n)

    def check(ours, _):
        hits, others = found(ours[1:-1], truth), len(ours) - 2 - len(truth)
        if hits < 0.97 * len(truth):
            raise AssertionError(f"{hits} of {len(truth)} changes found")
        return f"{hits} of {len(truth)} changes found within {TOLERANCE} samples, {others:+d} windows"

    return Case(
        lambda: change_points(x, y), lambda: block_sums(x, y, -(-n // 4000)), check, None, n, n, "samples"
    )


STAGES = (
    Stage(
        "segmentation 1,000",
        "ruptures PELT, CostLinear, jump 1",
        partial(short, 1_000),
        150.0,
        350.0,
        rounds=3,
    ),
    Stage(
        "segmentation 3,000",
        "ruptures PELT, CostLinear, jump 1",
        partial(short, 3_000),
        150.0,
        350.0,
        rounds=1,
    ),
    Stage("segmentation long", "one pass of block sums", long, 10.0, 6.0, within=True, at="full"),
)
