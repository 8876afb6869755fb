"""Settings of the fits of a comparison: parameters held fixed, priors, parameters common to all wheels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from terrain_cli.estimation import estimators

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping, Sequence

    from numpy.typing import ArrayLike

    from terrain_cli.estimation.wheel_fit import Noise, Prior
    from terrain_cli.models import ModelFile
    from terrain_cli.windows.cut_windows import Windows


@dataclass(frozen=True)
class FitSettings:
    """How models are fitted."""

    fixed: Mapping[str, ArrayLike]  # Parameters held; the others are sought
    priors: Mapping[str, Prior]
    shared: Collection[str]  # Parameters of the soil with one value for all windows of a wheel
    noise: Noise | None  # Of the sensors; learnt from the data if not given

    @classmethod
    def of(cls, wheels: Sequence[Windows], file: ModelFile) -> FitSettings:
        """Return what a model file and rover.toml say of some wheels of one rover."""
        held, priors, noise = estimators.assumed(wheels, file)
        return cls(held, priors, [name for name in file.shared if name not in held], noise)
