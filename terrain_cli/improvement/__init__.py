"""Better models, step by step: an effect added or removed, and what held-out data say of it."""

from terrain_cli.improvement.change_trial import compared
from terrain_cli.improvement.improvement_outcome import Step, Stopped
from terrain_cli.improvement.loop import tried_in_forms, until_quiet

__all__ = ["Step", "Stopped", "compared", "tried_in_forms", "until_quiet"]
