"""The samples of the segment in which a wheel is now."""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli.run.long_log import BEHIND
from terrain_cli.telemetry.long_logs import joined

if TYPE_CHECKING:
    from terrain_cli.telemetry import Samples

#: Pieces that are joined together: every sample is copied twice or so, however few come at a time.
_PIECES = 32
#: Samples of a piece that is not joined with small ones.
_LARGE = 1024


class OpenSegment:
    """Usable samples in the order of time; those set aside are counted behind the one before."""

    def __init__(self) -> None:
        self._large: list[Samples] = []
        self._small: list[Samples] = []
        #: Samples, and those set aside ahead of the first.
        self.count = self.ahead = 0

    def add(self, samples: Samples) -> None:
        """Take the samples that follow, with what is behind each among their drivers."""
        self.count += len(samples)
        if len(samples) >= _LARGE:
            self._join()
            self._large.append(samples)
        else:
            self._small.append(samples)
        if len(self._small) >= _PIECES:
            self._join()
        if len(self._large) >= _PIECES * _PIECES:
            self._large = [joined(self._large)]

    def _join(self) -> None:
        if self._small:
            self._large.append(joined(self._small))
            self._small = []

    def set_aside(self, count: int) -> None:
        """Count samples that are set aside."""
        if self.count:
            (self._small or self._large)[-1].drivers[BEHIND][-1] += count
        else:
            self.ahead += count

    def whole(self) -> Samples:
        """Return all of it; one sample at least."""
        self._join()
        self._large = [joined(self._large)]
        return self._large[0]

    def split(self, first: int) -> Samples:
        """Take the first so many samples away, and return them."""
        whole = self.whole()
        self._large = [] if first == self.count else [whole.taken(slice(first, None))]
        self.count -= first
        return whole if not self.count else whole.taken(slice(0, first))
