"""Inputs that are still being written: each is taken when it has stopped growing."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.batch.batch_input import Input


class Arrivals:
    """Tells inputs whose size and stamp stayed for `settle` seconds from those that are still written."""

    def __init__(self, settle: float) -> None:
        self._settle = settle
        #: What was seen last at a location, since when, and whether it was taken.
        self._seen: dict[str, tuple[object, float, bool]] = {}

    def rested(self, items: Sequence[Input], now: float | None = None) -> list[Input]:
        """Return the inputs that are at rest and were not returned before."""
        now = time.monotonic() if now is None else now
        found = []
        for item in items:
            # What is not there (yet), or cannot be read (yet), is no failure of a batch that waits.
            if item.problem:
                continue
            look = item.size, item.stamp
            before, since, taken = self._seen.get(item.location, (None, now, False))
            if look != before:
                since, taken = now, False
            if not taken and now - since >= self._settle:
                found.append(item)
                taken = True
            self._seen[item.location] = look, since, taken
        return found
