"""Settings of the fits of a comparison: parameters held fixed, priors, parameters common to all wheels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from numpy.typing import ArrayLike

    from terrain_cli.estimation.wheel_fit import Noise, Prior


@dataclass(frozen=True)
class FitSettings:
    """How models are fitted."""

    fixed: Mapping[str, ArrayLike]  # Parameters held; the others are sought
    priors: Mapping[str, Prior]
    shared: Collection[str]  # Parameters of the soil with one value for all windows of a wheel
    noise: Noise | None  # Of the sensors; learnt from the data if not given
