"""The steps that a model was built in, and the effects that it may lack, each fitted to the same windows."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from terrain_cli import models
from terrain_cli.improvement.change_trial import fitted
from terrain_cli.vocabulary.quantities import listed

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from terrain_cli.comparison import Comparison
    from terrain_cli.models import ModelFile
    from terrain_cli.windows.cut_windows import Windows


class Alternative(NamedTuple):
    """A model that a reader may choose to look at."""

    label: str
    comparison: Comparison
    own: bool = False  # Whether it is the model that was asked for


def alternatives(
    wheels: Sequence[Windows],
    file: ModelFile,
    own: Comparison,
    *,
    candidates: int,
    seed: int = 0,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Alternative]:
    """Fit a model effect by effect, on the blocks of `own`, and with each further one that scores name."""
    modulus = wheels[0].samples.geometry.shear_modulus

    def compared(label: str, other: ModelFile) -> Alternative:
        progress(label)
        return Alternative(label, fitted(wheels, other, like=own, seed=seed))

    ids = [effect.id for effect in file.model.effects]
    steps = [
        compared(_named(file, ids[:count]), models.removed(file, ids[count:], modulus).file)
        for count in range(len(ids))
    ]
    scores = own.scores() if own.scores else None
    missing = scores.effects[:candidates] if scores and scores.raised else ()
    return [
        *steps,
        Alternative(_named(file, ids), own, own=True),
        *(compared(f"+ {name}", models.added(file, [name], modulus).file) for name in missing),
    ]


def _named(file: ModelFile, ids: Sequence[str]) -> str:
    return f"{file.model.base}{f' with {listed(ids)}' if ids else ''}"
