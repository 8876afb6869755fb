"""Physical effects that can be added to a model: those of the program, and those of other packages."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NoReturn

from terrain_cli.effects import library
from terrain_cli.effects.library import NAMES as NAMES
from terrain_cli.errors import ConfigurationError, UsageError, nearest
from terrain_cli.mechanics.effect import Effect, Parameter

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

    from terrain_cli.mechanics.wheel_model import Model

__all__ = ["GROUP", "NAMES", "Effect", "Parameter", "catalogue", "conflict", "find"]

#: Entry points of other packages: each loads to an `Effect`, or to a function that returns one.
GROUP = "terrain_est.effects"


def catalogue() -> dict[str, Effect]:
    """Return every effect by id, those of other packages last; ConfigurationError where one is at fault."""
    from importlib import metadata

    effects = {name: library.effect(name) for name in NAMES}
    for point in sorted(metadata.entry_points(group=GROUP), key=lambda point: point.name):
        effect = _load(point)
        if effect.id in effects:
            raise ConfigurationError(
                f"{_place(point)}: the id {effect.id} is taken ({effects[effect.id].origin})",
                hint="give it another id, or remove the package",
            )
        effects[effect.id] = effect
    return effects


def find(name: str) -> Effect:
    """Return an effect by its id; UsageError where there is none, ConfigurationError as from `catalogue`."""
    if name in NAMES:
        return library.effect(name)
    effects = catalogue()
    if name not in effects:
        raise UsageError(
            f"there is no effect {name!r}{nearest(name, effects)}", hint=f"there are {', '.join(effects)}"
        )
    return effects[name]


def conflict(model: Model, effect: Effect) -> str:
    """Tell why a model cannot have an effect; nothing if it can."""
    try:
        replace(model, effects=(*model.effects, effect))
    except ConfigurationError as error:
        return str(error)
    return ""


def _place(point: EntryPoint) -> str:
    package = f" of package {point.dist.name}" if point.dist else ""
    return f"entry point {point.name} of {GROUP}{package}"


def _load(point: EntryPoint) -> Effect:
    try:
        effect = point.load()
        if not isinstance(effect, Effect) and callable(effect):
            effect = effect()
    except Exception as error:  # noqa: BLE001 -- another package's code may raise anything
        reason = str(error).strip().partition("\n")[0]
        _refuse(point, f"{type(error).__name__}{f': {reason}' if reason else ''}")
    if not isinstance(effect, Effect):
        _refuse(point, f"it gives a {type(effect).__name__}, not an Effect")
    return replace(effect, origin=_place(point))


def _refuse(point: EntryPoint, reason: str) -> NoReturn:
    raise ConfigurationError(
        f"{_place(point)} ({point.value}) cannot be loaded: {reason}", hint="update or remove the package"
    )
