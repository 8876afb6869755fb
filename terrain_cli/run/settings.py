"""The settings of one command, the same for each of its logs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from terrain_cli.models import ModelFile
    from terrain_cli.vocabulary.choices import Method, Segments
    from terrain_cli.windows.locations import Places


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How one input is turned into a table.

    Parameters
    ----------
    method : {"auto", "least-squares", "ridge", "recursive", "wong-reece"}
    segments : {"auto", "fixed", "terrain", "none"}
    min_samples : int, optional
        Fewest samples of a window; `CUT_SAMPLES` to cut and `FIT_SAMPLES` to estimate if not given.
    window_distance : float, optional
        In m.
    folds : int, optional
        Contiguous blocks for the cross-validation of δ; leave-one-out if not given.
    wheels : tuple of str
        Only these; all if empty.
    model : ModelFile or str, optional
        "linear", "wong-reece", or a model file; or what it holds, for a process that cannot read it.
    robust : bool
        Give wild samples little weight in the fit of the whole model.
    at_stress : float, optional
        Stress in kPa at which the strengths of all windows are compared.
    places : Places, optional
        Localisation table whose positions the samples get.
    samples : bool
        Also keep a table of the samples of every window.
    joint : int
        Segments of each wheel, evenly spread, of which the joint posterior of c and φ is kept.
    whole : bool
        Also keep, of a long log too, the samples set aside and the recursive estimate.
    salvage : bool
        Read what is left of damaged inputs.
    """

    method: Method = "auto"
    segments: Segments = "auto"
    min_samples: int | None = None
    window_samples: int | None = None
    window_distance: float | None = None
    folds: int | None = None
    wheels: tuple[str, ...] = ()
    where: str | None = None
    model: ModelFile | str | None = None
    robust: bool = False
    at_stress: float | None = None
    places: Places | None = None
    samples: bool = False
    joint: int = 0
    whole: bool = False
    salvage: bool = False

    @property
    def automatic(self) -> bool:
        """Whether the full model gives way to the line where the data do not allow it."""
        return self.method == "auto" and self.model is None

    @property
    def stress(self) -> float | None:
        """`at_stress` in Pa."""
        return None if self.at_stress is None else 1e3 * self.at_stress

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
