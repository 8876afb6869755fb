"""Changes of a model: effects added and removed, assumptions of its base lifted and made again."""

import math
import os
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from terrain_cli import effects
from terrain_cli.errors import ConfigurationError, UsageError, nearest
from terrain_cli.mechanics.effect import Effect, Prior
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models.model_file import ModelFile, find_effect, is_path
from terrain_cli.vocabulary.choices import K_FACTOR

T = TypeVar("T")

STRESSES, MODULUS = "linearised-stresses", "assumed-shear-modulus"
_K = "shear_modulus"


@dataclass(frozen=True)
class Assumption:
    """Something that a model takes for granted, and that the data may deny."""

    id: str  # Named where an effect is named; no effect has it
    title: str
    explanation: str  # One paragraph: what is assumed, and what it does to the residuals where it is wrong
    reference: str
    settled_by: str  # The manoeuvre that tells it from its neighbours


ASSUMPTIONS: dict[str, Assumption] = {
    name: Assumption(id=name, **{key: " ".join(text.split()) for key, text in entry.items()})
    for name, entry in tomllib.loads(Path(__file__).with_name("assumptions.toml").read_text("utf-8")).items()
}


def made_by(file: ModelFile, shear_modulus: float) -> list[Assumption]:
    """Return the assumptions that a model makes; that of k holds rover.toml's (m) where it says nothing."""
    made = [ASSUMPTIONS[STRESSES]] if file.model.base == "linear" else []
    held = _held(file, shear_modulus)
    if held is not None:
        known = ASSUMPTIONS[MODULUS]
        made.append(replace(known, title=f"{known.title}: {1e3 * held:.3g} mm"))
    return made


def lifted(file: ModelFile, name: str, shear_modulus: float) -> ModelFile:
    """Return a model without an assumption; a k that only the base linear holds is then estimated."""
    _check(name)
    held = _held(file, shear_modulus)
    if name == STRESSES and file.model.base == "linear":
        return replace(file, model=Model("wong-reece", file.model.effects))
    if name == MODULUS and held is not None:
        expected = Prior.factor(held, K_FACTOR)
        # Numbers that a person can read in the file.
        prior = Prior(float(f"{expected.mean:.4g}"), float(f"{expected.sd:.4g}"))
        fixed = {name: value for name, value in file.fixed.items() if name != _K}
        return replace(file, fixed=fixed, priors={**file.priors, _K: prior})
    raise UsageError(
        f"the model does not make the assumption {name}",
        hint="terrain-est model show FILE lists what it assumes",
    )


def with_stresses(file: ModelFile, shear_modulus: float) -> ModelFile:
    """Return a model of the base linear with the stresses of the full one, and k estimated as there."""
    for assumption in made_by(file, shear_modulus)[::-1]:
        file = lifted(file, assumption.id, shear_modulus)
    return file


def imposed(file: ModelFile, name: str, shear_modulus: float) -> ModelFile:
    """Return a model with an assumption that it did not make: the reverse of `lifted`."""
    _check(name)
    if name in {one.id for one in made_by(file, shear_modulus)}:
        raise UsageError(f"the model makes the assumption {name} already")
    if name == MODULUS:
        shared = tuple(other for other in file.shared if other != _K)
        priors = {other: prior for other, prior in file.priors.items() if other != _K}
        file = replace(file, priors=priors, shared=shared)
        # The base linear holds it without being told.
        held = _held(file, shear_modulus) is not None
        return file if held else replace(file, fixed={**file.fixed, _K: shear_modulus})
    model = Model("linear", file.model.effects)
    lost = {*file.fixed, *file.priors, *file.shared} - {*model.soil, *model.parameters}
    if lost:
        raise ConfigurationError(
            f"the base linear has no {', '.join(sorted(lost))}, which the model file sets",
            hint="take that out of the file first",
        )
    return replace(file, model=model)


def _check(name: str) -> None:
    if name not in ASSUMPTIONS:
        raise UsageError(f"there is no assumption {name!r}", hint=f"there are {', '.join(ASSUMPTIONS)}")


def _held(file: ModelFile, shear_modulus: float) -> float | None:
    """Return the k that is held, as `fitting` does it; None where it is estimated."""
    if _K in file.fixed:
        return file.fixed[_K]
    said = _K in {*file.priors, *file.shared}
    return shear_modulus if file.model.base == "linear" and not said else None


class Changed(NamedTuple):
    """A model file after a change."""

    file: ModelFile
    ids: tuple[str, ...]  # Effects that it has more or less, and assumptions lifted or made anew


def folder_of(file: ModelFile) -> Path:
    """Return the folder in which the paths of a model file begin."""
    return file.path.parent if file.path else Path()


def named_from(names: Sequence[str], folder: Path) -> list[str]:
    """Return ids, and paths that begin in the current folder, as a model file in a folder writes them."""
    return [os.path.relpath(name, folder) if is_path(name) else name for name in names]


def moved(file: ModelFile, path: Path) -> ModelFile:
    """Return a model file as it stands in another place."""
    if path.parent == folder_of(file):
        return replace(file, path=path)
    here = [str(folder_of(file) / name) if is_path(name) else name for name in file.effects]
    return replace(file, effects=tuple(named_from(here, path.parent)), path=path)


def added(file: ModelFile, names: Sequence[str], shear_modulus: float) -> Changed:
    """Add effects, by id or by path from the folder of the model file, or lift assumptions of the base."""
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


def in_forms(change: Changed) -> list[ModelFile]:
    """Return a changed model, and the same with each effect that it has more in its other form.

    That is chosen by a parameter which is held at its null value where the file says nothing, by its upper
    bound; one without bounds is a number that is known.
    """
    file, _ = change
    named = {
        effect.qualified(parameter): parameter
        for effect in file.model.effects
        if effect.id in change.ids
        for parameter in effect.parameters
    }
    others = {
        name: one.upper
        for name, one in named.items()
        if one.held and math.isfinite(one.upper) and name not in file.fixed
    }
    return [file, *(replace(file, fixed={**file.fixed, name: value}) for name, value in others.items())]


def removed(file: ModelFile, names: Sequence[str], shear_modulus: float) -> Changed:
    """Remove effects with all that the file says of their parameters, or make assumptions again."""
    ids = []
    for name in names:
        if name in ASSUMPTIONS:
            continue
        place = _place(file, name)
        gone = file.model.effects[place].id
        ids.append(gone)
        file = replace(
            file,
            model=Model(file.model.base, tuple(one for one in file.model.effects if one.id != gone)),
            effects=(*file.effects[:place], *file.effects[place + 1 :]),
            fixed=_others(file.fixed, gone),
            priors=_others(file.priors, gone),
        )
    for name in names:
        if name in ASSUMPTIONS:
            file = imposed(file, name, shear_modulus)
            ids.append(name)
    return Changed(file, tuple(ids))


def recorded(file: ModelFile, entry: Mapping[str, Any]) -> ModelFile:
    return replace(file, history=(*file.history, entry))


class Refused(NamedTuple):
    """What was tried to be added to a model on some data, and was refused."""

    effects: tuple[tuple[str, ...], ...] = ()  # Those of each try
    ended: bool = False  # Whether --until-quiet found nothing more on them

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(dict.fromkeys(name for one in self.effects for name in one))


def refused(file: ModelFile, sources: Collection[str], samples: int) -> Refused:
    """Return what the history says was refused of the model as it is now, on so many samples of inputs."""
    now = file.model.base, list(file.effects), _inputs(sources), samples
    same = [entry for entry in file.history if entry.get("kept") is False and _tried_on(entry) == now]
    several = (tuple(map(str, entry.get("changed", ()))) for entry in same)
    return Refused(tuple(dict.fromkeys(filter(None, several))), any(entry.get("ended") for entry in same))


def rivals(file: ModelFile) -> list[Effect]:
    """Return effects that a model lacks, but that data did not tell from its own, as its history says."""
    ids = {effect.id for effect in file.model.effects}
    names = [
        name
        for entry in file.history
        if entry.get("kept") is not False and ids.issuperset(_names(entry, "changed"))
        for name in _names(entry, "rivals")
    ]
    return [effects.find(name) for name in dict.fromkeys(names) if name in effects.NAMES and name not in ids]


def _names(entry: Mapping[str, Any], key: str) -> list[str]:
    found = entry.get(key)
    return [str(name) for name in found] if isinstance(found, list | tuple) else []


def _tried_on(entry: Mapping[str, Any]) -> tuple[Any, ...]:
    data = entry["data"] if isinstance(entry.get("data"), dict) else {}
    return entry.get("base"), entry.get("effects"), _inputs(data.get("sources", ())), data.get("samples")


def _inputs(sources: Collection[str]) -> set[str]:
    return {one for several in sources for one in several.split(", ")}


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
        hint=f"it has {', '.join(ids)}" if ids else "it has no effects",
    )


def _others(table: Mapping[str, T], effect: str) -> dict[str, T]:
    return {name: value for name, value in table.items() if not name.startswith(f"{effect}.")}
