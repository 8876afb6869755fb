"""Noise of the sensors: standard deviations by channel, given or learnt from the data."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

#: Channels whose noise counts.
CHANNELS = ("load", "torque", "sinkage", "slip", "drawbar_pull")


@dataclass(frozen=True)
class Noise:
    """Standard deviations of independent errors: the root of (relative · value)² + absolute².

    Raises
    ------
    UsageError
        Unknown channel, or a negative deviation.
    """

    # Channel → share of the value. A channel not named here nor in `absolute` is exact.
    relative: Mapping[str, float] = field(default_factory=dict)
    absolute: Mapping[str, float] = field(default_factory=dict)  # Channel → in the channel's SI unit

    def __post_init__(self) -> None:
        for name, deviation in (*self.relative.items(), *self.absolute.items()):
            if name not in CHANNELS:
                raise UsageError(
                    f"no noise is known of a channel {name!r}", hint=f"one of {', '.join(CHANNELS)}"
                )
            if not 0.0 <= deviation < np.inf:
                raise UsageError(f"noise of {name}: {deviation!r} is no standard deviation")

    @classmethod
    def equal(cls, relative: float) -> Noise:
        """Return the same relative noise in every channel."""
        return cls(dict.fromkeys(CHANNELS, relative))

    def variance(self, channel: str, value: Array) -> Array:
        """Variance of a channel's error at its true values, in the SI unit squared."""
        share, constant = self.relative.get(channel, 0.0), self.absolute.get(channel, 0.0)
        return (share * value) ** 2 + constant**2

    def scaled(self, factor: float) -> Noise:
        """Return the same noise, larger or smaller in all channels."""
        return Noise(
            {name: factor * deviation for name, deviation in self.relative.items()},
            {name: factor * deviation for name, deviation in self.absolute.items()},
        )


def level(column: Array) -> float:
    """Return the root mean square of the known values of a channel; 1 where there are none."""
    known = column[np.isfinite(column)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else 1.0
