"""Model against measurement: errors, noise, held-out errors, and where the model fails.

`compare` makes the errors of each channel, the held-out ones from the predictions of `held_out`;
`findings` are the terms of `residual_search`, with p values of `blocks`; `two_models` is `--against`.
"""

from terrain_cli.comparison.comparison_outcome import Comparison, Difference, Finding
from terrain_cli.comparison.two_models import against

__all__ = ["Comparison", "Difference", "Finding", "against"]
