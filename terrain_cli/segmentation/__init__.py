"""Windows of homogeneous terrain along one wheel's drive."""

from terrain_cli.segmentation.changes import (
    PENALTY,
    TOLERANCE,
    change_points,
)
from terrain_cli.segmentation.windows import fixed_windows, label_windows, whole_windows

__all__ = [
    "PENALTY",
    "TOLERANCE",
    "change_points",
    "fixed_windows",
    "label_windows",
    "whole_windows",
]
