"""Model against measurement: errors, noise, held-out errors, and where the model fails.

`compare` makes the errors of each channel, the held-out ones from the predictions of `held_out`;
`findings` are the terms of `residual_search`, with p values of `blocks`; `two_models` is `--against`.
"""

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
