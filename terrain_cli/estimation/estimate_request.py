"""What `estimate` says of several wheels, worked out where somebody asks for it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from terrain_cli.estimation import estimators

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.models import ModelFile
    from terrain_cli.windows.cut_windows import Windows


@dataclass(frozen=True, kw_only=True)
class EstimateRequest:
    """Windows, a model, and the options of `estimate`."""

    wheels: Sequence[Windows]  # As they were cut: neither joined nor thinned
    file: ModelFile  # Of which the line is estimated where it is plain
    min_samples: int | None = None  # min_samples, folds, robust: as for `estimators.estimate`
    folds: int | None = None
    robust: bool = False
    at_stress: float | None = None  # In kPa

    @cached_property
    def estimates(self) -> list[WindowEstimates | None]:
        """Of each wheel; None without torque or sinkage, where `estimate` has no answer."""
        file = estimators.choose("auto", self.file, robust=self.robust)
        stresses: dict[str, float | None] = {}
        found: list[WindowEstimates | None] = []
        for windows in self.wheels:
            if not windows.lined:
                found.append(None)
                continue
            source = windows.samples.source
            fitted = estimators.estimate(
                windows,
                "auto",
                file,
                min_samples=self.min_samples,
                folds=self.folds,
                robust=self.robust,
                at_stress=stresses.get(source, self.stress),
            )
            # Wheels of one log are compared at one stress.
            stresses[source] = estimators.common_stress(stresses.get(source, self.stress), fitted)
            found.append(fitted.estimates)
        return found

    @property
    def stress(self) -> float | None:
        """`at_stress` in Pa."""
        return None if self.at_stress is None else 1e3 * self.at_stress
