"""Effects as a person reads them, and as JSON."""

import math
import textwrap
from collections.abc import Iterable, Iterator
from typing import Any

from terrain_cli.effects.laws.effect_file import Understood
from terrain_cli.mechanics.effect import QUANTITIES, Effect, Parameter
from terrain_cli.models import Assumption
from terrain_cli.presentation.terminal import aligned

LIST_FORMAT = "terrain-est/effects/1"
CHECK_FORMAT = "terrain-est/effects-check/1"
_WIDTH = 100
_PROSE = ("explanation", "shows", "settled_by", "reference", "origin")
_KINDS = {
    "soil": "changes what the soil is",
    "stress": "changes the stress under the rim",
    "contact": "changes the shape of the contact",
    "force": "changes a force on the wheel",
    "sensor": "changes what a sensor shows",
}


def document(effect: Effect) -> dict[str, Any]:
    """Describe an effect for JSON, with the keys of docs/effects.md."""
    return {
        **{key: getattr(effect, key) for key in ("id", "title", "kind")},
        "changes": list(effect.laws),
        "needs": list(effect.needs),
        "any_of": list(effect.any_of),
        "formula": effect.formula,
        "parameters": [_parameter(parameter) for parameter in effect.parameters],
        **{key: getattr(effect, key) for key in _PROSE},
    }


def _parameter(parameter: Parameter) -> dict[str, Any]:
    return {
        "name": parameter.name,
        "unit": parameter.unit,
        **_numbers(parameter),
        "meaning": parameter.meaning,
        "shape": parameter.shape,
        "needs": list(parameter.needs),
        "skids": parameter.skids,
        "grows": dict(zip(("load", "radius"), parameter.grows, strict=True)),
    }


def _numbers(parameter: Parameter) -> dict[str, float | None]:
    """Return the values of a parameter in its unit as they were written there; None for no bound."""
    values = {name: getattr(parameter, name) for name in ("null", "scale", "lower", "upper")}
    return {
        name: float(f"{value / parameter.factor:.12g}") if math.isfinite(value) else None
        for name, value in values.items()
    }


def checked(file: str, understood: Understood) -> dict[str, Any]:
    return {
        "file": file,
        "ok": True,
        "effect": document(understood.effect),
        "laws": [
            {
                "changes": quantity,
                "unit": QUANTITIES[quantity],
                "reads": units,
                "deviation_at_null": understood.trials[quantity].deviation,
            }
            for quantity, units in understood.units.items()
        ],
        "warnings": understood.warnings,
    }


def overview(effects: Iterable[Effect]) -> str:
    """Return a table of effects, a line for each."""
    rows = [
        (effect.id, effect.kind, ", ".join(effect.laws), _needed(effect), effect.title) for effect in effects
    ]
    return "\n".join(aligned([("id", "kind", "changes", "needs", "title"), *rows]))


def text(effect: Effect) -> str:
    lines = [f"{effect.id}: {effect.title}", *_summary(effect), "", *_parameters(effect), *_prose(effect)]
    return "\n".join(lines)


def _prose(one: Effect | Assumption) -> Iterator[str]:
    if one.explanation:
        yield from ("", textwrap.fill(one.explanation, _WIDTH))
    for name in _PROSE[1:4]:
        if words := getattr(one, name, ""):
            yield from _field(name.replace("_", " "), words)


def overview_of_assumptions(assumptions: Iterable[Assumption]) -> str:
    """Return a table of what bases take for granted, a line for each."""
    rows = [(one.id, one.title) for one in assumptions]
    return "\n".join(["assumptions of a base, which model add removes:", *aligned(rows)])


def text_of_assumption(assumption: Assumption) -> str:
    what = _field("what", "an assumption of a base, which model add removes")
    return "\n".join([f"{assumption.id}: {assumption.title}", *what, *_prose(assumption)])


def checked_text(file: str, understood: Understood) -> str:
    effect = understood.effect
    lines = [f"{file}: nothing is wrong", f"{effect.id}: {effect.title}", *_summary(effect)]
    for quantity, units in understood.units.items():
        read = ", ".join(f"{name} [{unit}]" for name, unit in units.items())
        deviation = understood.trials[quantity].deviation
        exactness = "exactly" if deviation == 0.0 else f"to {deviation:.0e} of it"
        lines += [
            *_field("units", f"the law gives {quantity} in {QUANTITIES[quantity]}; it reads {read}"),
            *_field("at null", f"the law gives back {quantity}, {exactness}"),
        ]
    return "\n".join([*lines, "", *_parameters(effect)])


def _summary(effect: Effect) -> list[str]:
    how = f"{_KINDS[effect.kind]} ({effect.kind}): {', '.join(effect.laws)}"
    return [
        *_field("what", how),
        *_field("law", effect.formula),
        *_field("needs", _needed(effect) or "no channel beyond those of every model"),
    ]


def _needed(effect: Effect) -> str:
    return ", ".join([*effect.needs, *filter(None, [" or ".join(effect.any_of)])])


def _parameters(effect: Effect) -> list[str]:
    header = ("parameter", "unit", "null", "scale", "lower", "upper", "meaning")
    rows = []
    for parameter in effect.parameters:
        numbers = ["" if n is None else f"{n:.6g}" for n in _numbers(parameter).values()]
        powers = zip("Wr", parameter.grows, strict=True)
        grows = " ".join(of if power == 1.0 else f"{of}^{power:g}" for of, power in powers if power)
        remarks = [
            parameter.meaning,
            "shapes the others' influence" * parameter.shape,
            f"needs {', '.join(parameter.needs)}" * bool(parameter.needs),
            "shows on a skidding wheel alone" * parameter.skids,
            f"beyond 98 N or r = 0.1 m scale and bounds grow as {grows}"
            * bool(grows and not parameter.absolute),
        ]
        rows.append((parameter.name, parameter.unit, *numbers, "; ".join(filter(None, remarks))))
    lines = aligned([header, *rows])
    # The last column is prose.
    hang = " " * lines[0].index(header[-1])
    return [
        part
        for line in lines
        for part in textwrap.wrap(line, _WIDTH, subsequent_indent=hang, drop_whitespace=True)
    ]


def _field(name: str, words: str) -> list[str]:
    return textwrap.wrap(
        words, _WIDTH, initial_indent=f"  {name:<10}  ", subsequent_indent=" " * 14, break_long_words=False
    )
