"""Model against measurement: errors, noise, held-out errors, and where the model fails."""

from terrain_cli.comparison.compare import compare
from terrain_cli.comparison.comparison_outcome import (
    ChannelErrors,
    Comparison,
    Difference,
    Driver,
    Finding,
    Series,
    WheelComparison,
)
from terrain_cli.comparison.two_models import against

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
