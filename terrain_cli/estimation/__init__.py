"""Cohesion and internal friction angle from windows of samples."""

from terrain_cli.estimation.line.pooled import PooledEstimate, Trace, pool, recursive
from terrain_cli.estimation.line.window_estimates import WindowEstimates, estimate_windows, join

__all__ = ["PooledEstimate", "Trace", "WindowEstimates", "estimate_windows", "join", "pool", "recursive"]
