"""What the tests of streams share."""

from __future__ import annotations

import sys
from pathlib import Path

# The writers of bags stand with the tests of the formats, and what is in them with those of telemetry.
sys.path[:0] = [str(Path(__file__).parents[1] / "formats"), str(Path(__file__).parents[1] / "telemetry")]
