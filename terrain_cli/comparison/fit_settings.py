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
    """How models are fitted.

    Parameters
    ----------
    fixed : mapping of str to float or array_like
        Parameters held; the others are sought.
    shared : collection of str
        Parameters of the soil with one value for all windows of a wheel.
    noise : Noise or None
        Of the sensors; learnt from the data if not given.
    """

    fixed: Mapping[str, ArrayLike]
    priors: Mapping[str, Prior]
    shared: Collection[str]
    noise: Noise | None
