"""Model against measurement: errors, noise, held-out errors, and where the model fails."""

from terrain_cli.comparison.against import against
from terrain_cli.comparison.compare import compare
from terrain_cli.comparison.parts import (
    ChannelErrors,
    Comparison,
    Difference,
    Driver,
    Finding,
    Series,
    WheelComparison,
)

__all__ = [
    "ChannelErrors",
    "Comparison",
    "Difference",
    "Driver",
    "Finding",
    "Series",
    "WheelComparison",
    "against",
    "compare",
]
