"""Cohesion and internal friction angle from windows of samples."""

from terrain_cli.estimation.pooled import PooledEstimate, pool
from terrain_cli.estimation.trace import Trace, recursive
from terrain_cli.estimation.windows import WindowEstimates, estimate_windows, join

__all__ = [
    "PooledEstimate",
    "Trace",
    "WindowEstimates",
    "estimate_windows",
    "join",
    "pool",
    "recursive",
]
