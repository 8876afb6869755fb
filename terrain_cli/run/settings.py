"""The settings of one command, the same for each of its logs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from terrain_cli.estimation.estimators import FitOptions
    from terrain_cli.models import ModelFile
    from terrain_cli.vocabulary.choices import Method, Segments
    from terrain_cli.windows.locations import Places


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How one input is turned into a table."""

    method: Method = "auto"
    segments: Segments = "auto"
    # Fewest samples of a window; `CUT_SAMPLES` to cut and `FIT_SAMPLES` to estimate if not given
    min_samples: int | None = None
    window_samples: int | None = None
    window_distance: float | None = None  # In m
    folds: int | None = None  # Contiguous blocks for the cross-validation of δ; leave-one-out if not given
    wheels: tuple[str, ...] = ()  # Only these; all if empty
    where: str | None = None
    # "linear", "wong-reece", or a model file; or what it holds, for a process that cannot read it
    model: ModelFile | str | None = None
    robust: bool = False  # Give wild samples little weight in the fit of the whole model
    at_stress: float | None = None  # Stress in kPa at which the strengths of all windows are compared
    places: Places | None = None  # Localisation table whose positions the samples get
    samples: bool = False  # Also keep a table of the samples of every window
    joint: int = 0  # Segments of each wheel, evenly spread, of which the posterior of c and φ is kept
    whole: bool = False  # Also keep, of a long log too, the samples set aside and the recursive estimate
    salvage: bool = False  # Read what is left of damaged inputs

    @property
    def automatic(self) -> bool:
        """Whether the full model gives way to the line where the data do not allow it."""
        return self.method == "auto" and self.model is None

    @property
    def stress(self) -> float | None:
        return None if self.at_stress is None else 1e3 * self.at_stress  # Pa

    @property
    def of_fits(self) -> FitOptions:
        """What every estimator is told."""
        from terrain_cli.estimation.estimators import FitOptions

        least, folds, robust = self.min_samples, self.folds, self.robust
        return FitOptions(min_samples=least, folds=folds, robust=robust, at_stress=self.stress)

    def document(self) -> dict[str, Any]:
        """Return what a summary says of them, ready for JSON."""
        return {
            "method": self.method,
            "segments": self.segments,
            "min_samples": self.min_samples,
            "window_samples": self.window_samples,
            "window_distance_m": self.window_distance,
            "folds": self.folds,
            "wheels": list(self.wheels),
            "where": self.where,
            "model": self.model,
            "robust": self.robust,
            "at_stress_kPa": self.at_stress,
            "places": self.places.path if self.places else None,
            "salvage": self.salvage,
        }
