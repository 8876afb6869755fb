"""What `estimate` says of wheels, asked for before it is known, and answered in this process or beside it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import NamedTuple

from terrain_cli import effects, processes
from terrain_cli.estimation import WindowEstimates
from terrain_cli.estimation.estimators import choose, common_stress, estimate
from terrain_cli.estimation.fit_account import CommonParameters
from terrain_cli.estimation.wheel_fit import Fit
from terrain_cli.models import ModelFile
from terrain_cli.vocabulary.arrays import Bounds
from terrain_cli.windows.cut_windows import Windows


class WheelEstimates(NamedTuple):
    """What `estimate` says of a wheel."""

    bounds: Bounds  # Of its windows, of which cuts may have been taken back
    windows: WindowEstimates
    common: CommonParameters | None  # None for the line


@dataclass(frozen=True, kw_only=True)
class EstimateRequest:
    """Windows, a model, and the options of `estimate`."""

    wheels: Sequence[Windows]  # As they were cut: neither joined nor thinned
    file: ModelFile  # Of which the line is estimated where it is plain
    min_samples: int | None = None  # min_samples, folds, robust: as for `estimators.estimate`
    folds: int | None = None
    robust: bool = False
    at_stress: float | None = None  # In kPa
    needed: Callable[[Windows, ModelFile, Fit], Windows] | None = None  # As for `estimators.estimate`

    @cached_property
    def estimates(self) -> list[WheelEstimates | None]:
        """Of each wheel; None without torque or sinkage, where `estimate` has no answer."""
        file = choose("auto", self.file, robust=self.robust)
        stress = self.stress
        found: list[WheelEstimates | None] = []
        for windows in self.wheels:
            if not windows.lined:
                found.append(None)
                continue
            fitted = estimate(
                windows,
                "auto",
                file,
                min_samples=self.min_samples,
                folds=self.folds,
                robust=self.robust,
                at_stress=stress,
                needed=self.needed,
            )
            stress = common_stress(stress, fitted.estimates)
            found.append(WheelEstimates(fitted.windows.bounds, fitted.estimates, fitted.common))
        return found

    @property
    def stress(self) -> float | None:
        """`at_stress` in Pa."""
        return None if self.at_stress is None else 1e3 * self.at_stress


def estimates_of(asked: Sequence[EstimateRequest]) -> list[list[WheelEstimates | None]]:
    return [one.estimates for one in asked]


def estimate_beside(asked: Sequence[EstimateRequest]) -> Callable[[], None]:
    """Begin to estimate in another process; return what waits for it, and then has the requests answered."""
    # Both processes need the catalogue, which is read before there are two.
    effects.catalogue()
    waited = processes.beside(partial(estimates_of, asked))

    def answer() -> None:
        for one, found in zip(asked, waited(), strict=True):
            vars(one)["estimates"] = found

    return answer
