"""Windows of homogeneous terrain along one wheel's drive."""

from terrain_cli.windows.segmentation.change_points import (
    PENALTY,
    change_points,
    needed,
    sinkage_changes,
)
from terrain_cli.windows.segmentation.plain_windows import fixed_windows, label_windows, whole_windows

__all__ = [
    "PENALTY",
    "change_points",
    "fixed_windows",
    "label_windows",
    "needed",
    "sinkage_changes",
    "whole_windows",
]
