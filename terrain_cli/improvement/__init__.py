"""Better models, step by step: an effect added or removed, and what held-out data say of it."""

from terrain_cli.improvement.change_trial import compared, fitted, joined, tried
from terrain_cli.improvement.improvement_outcome import ChannelChange, Interval, Step, Stopped
from terrain_cli.improvement.loop import until_quiet

__all__ = [
    "ChannelChange",
    "Interval",
    "Step",
    "Stopped",
    "compared",
    "fitted",
    "joined",
    "tried",
    "until_quiet",
]
