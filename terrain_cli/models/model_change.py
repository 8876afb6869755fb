"""Model files with an effect more, or one less."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeVar

from terrain_cli.errors import UsageError, nearest
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models.assumptions import ASSUMPTIONS, imposed, lifted
from terrain_cli.models.model_reader import find_effect, is_path

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from terrain_cli.models.model_file import ModelFile

T = TypeVar("T")


class Changed(NamedTuple):
    """A model file after a change.

    Parameters
    ----------
    ids : tuple of str
        Effects that it has more or less, and assumptions lifted or made anew.
    """

    file: ModelFile
    ids: tuple[str, ...]


def folder_of(file: ModelFile) -> Path:
    """Return the folder in which the paths of a model file begin."""
    return file.path.parent if file.path else Path()


def named_from(names: Sequence[str], folder: Path) -> list[str]:
    """Return names of effects as a model file in a folder writes them.

    Parameters
    ----------
    names : sequence of str
        Ids of the catalogue, and paths that begin in the current folder.
    """
    return [os.path.relpath(name, folder) if is_path(name) else name for name in names]


def moved(file: ModelFile, path: Path) -> ModelFile:
    """Return a model file as it stands in another place."""
    if path.parent == folder_of(file):
        return replace(file, path=path)
    here = [str(folder_of(file) / name) if is_path(name) else name for name in file.effects]
    return replace(file, effects=tuple(named_from(here, path.parent)), path=path)


def added(file: ModelFile, names: Sequence[str], shear_modulus: float) -> Changed:
    """Add effects, or lift assumptions of the base.

    Parameters
    ----------
    names : sequence of str
        Ids of the catalogue, paths of effect files that begin in the folder of the model file, or ids
        of assumptions.
    shear_modulus : float
        The k of rover.toml in m, where an assumption is lifted.

    Raises
    ------
    UsageError
        No such effect, or the model has it already.
    ConfigurationError
        The file of an effect is wrong, or the base cannot have the effect.
    """
    # A base without its assumptions may take effects that it does not take with them. That of k comes
    # first: with the full stresses k is no longer assumed.
    for name in [*ASSUMPTIONS][::-1]:
        if name in names:
            file = lifted(file, name, shear_modulus)
    ids = []
    for name in names:
        if name in ASSUMPTIONS:
            ids.append(name)
            continue
        effect = find_effect(name, folder_of(file))
        if effect.id in {one.id for one in file.model.effects}:
            raise UsageError(f"effect {effect.id} is in the model already")
        model = Model(file.model.base, (*file.model.effects, effect))
        file = replace(file, model=model, effects=(*file.effects, name))
        ids.append(effect.id)
    return Changed(file, tuple(ids))


def removed(file: ModelFile, names: Sequence[str], shear_modulus: float) -> Changed:
    """Remove effects with all that the file says of their parameters, or make assumptions again.

    Parameters
    ----------
    names : sequence of str
        Ids, or paths as for `added`.

    Raises
    ------
    UsageError
        The model does not have it.
    ConfigurationError
        The base cannot have what is left.
    """
    ids = []
    for name in names:
        if name in ASSUMPTIONS:
            continue
        place = _place(file, name)
        gone = file.model.effects[place].id
        ids.append(gone)
        file = replace(
            file,
            model=Model(file.model.base, _without(file.model.effects, place)),
            effects=_without(file.effects, place),
            fixed=_others(file.fixed, gone),
            priors=_others(file.priors, gone),
        )
    for name in names:
        if name in ASSUMPTIONS:
            file = imposed(file, name, shear_modulus)
            ids.append(name)
    return Changed(file, tuple(ids))


def recorded(file: ModelFile, entry: Mapping[str, Any]) -> ModelFile:
    """Add an entry to the history."""
    return replace(file, history=(*file.history, entry))


def _place(file: ModelFile, name: str) -> int:
    ids = [effect.id for effect in file.model.effects]
    if name in ids:
        return ids.index(name)
    if is_path(name):
        folder = folder_of(file)
        paths = [(folder / one).resolve() if is_path(one) else None for one in file.effects]
        if (folder / name).resolve() in paths:
            return paths.index((folder / name).resolve())
    raise UsageError(
        f"the model has no effect {name}{nearest(name, ids)}",
        hint=f"it has {', '.join(ids)}" if ids else "it has none",
    )


def _without(several: tuple[T, ...], place: int) -> tuple[T, ...]:
    return (*several[:place], *several[place + 1 :])


def _others(table: Mapping[str, T], effect: str) -> dict[str, T]:
    return {name: value for name, value in table.items() if not name.startswith(f"{effect}.")}
