"""Better models, step by step: an effect added or removed, and what held-out data say of it."""

from terrain_cli.improvement.loop import until_quiet
from terrain_cli.improvement.parts import ChannelChange, Interval, Step, Stopped
from terrain_cli.improvement.step import fitted, joined, tried

__all__ = ["ChannelChange", "Interval", "Step", "Stopped", "fitted", "joined", "tried", "until_quiet"]
