"""What `terrain-est estimate` can be asked for: one place for the choices and their defaults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

if TYPE_CHECKING:
    from terrain_cli.models import ModelFile
    from terrain_cli.places import Places

#: Estimators of the line y = c + x tan φ.
LineMethod = Literal["auto", "least-squares", "ridge", "recursive"]
Method = Literal[LineMethod, "wong-reece"]
METHODS: tuple[Method, ...] = get_args(Method)
Segments = Literal["auto", "fixed", "terrain", "none"]
SEGMENTS: tuple[Segments, ...] = get_args(Segments)
#: Models that need no file.
Base = Literal["linear", "wong-reece"]
BASES: tuple[Base, ...] = get_args(Base)
#: Fewest samples of a window that is cut where the soil's line changes.
CUT_SAMPLES = 10
#: Fewest samples that say something of a line and of the scatter about it.
FIT_SAMPLES = 5
#: In m. A window of soil shorter than this is no terrain of its own (Iagnemma et al. 2004, section II).
MIN_DISTANCE = 0.10


@dataclass(frozen=True)
class Settings:
    """How one input is turned into a table.

    Parameters
    ----------
    method : {"auto", "least-squares", "ridge", "recursive", "wong-reece"}
    segments : {"auto", "fixed", "terrain", "none"}
    min_samples : int, optional
        Fewest samples of a window; `CUT_SAMPLES` to cut and `FIT_SAMPLES` to estimate if not given.
    window_samples : int, optional
    window_distance : float, optional
        In m.
    folds : int, optional
        Contiguous blocks for the cross-validation of δ; leave-one-out if not given.
    wheels : tuple of str
        Only these; all if empty.
    where : str, optional
    model : ModelFile or str, optional
        "linear", "wong-reece", or a model file; or what it holds, for a process that cannot read it.
    robust : bool
        Give wild samples little weight in the fit of the whole model.
    places : Places, optional
        Localisation table whose positions the samples get.
    samples : bool
        Also keep a table of the samples of every window.
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
    places: Places | None = None
    samples: bool = False
    whole: bool = False
    salvage: bool = False
