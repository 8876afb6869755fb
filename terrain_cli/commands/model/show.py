"""`terrain-est model show FILE`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options, paths
from terrain_cli.presentation.terminal import aligned, say

if TYPE_CHECKING:
    from terrain_cli.models import ModelFile

FORMAT = "terrain-est/model-description/1"


@click.command(
    "show",
    cls=paths.Verb,
    context_settings=options.CONTEXT,
    short_help="Say what a model file holds.",
    epilog="""\b
Examples:
  terrain-est model show model.toml
  terrain-est model show wong-reece --json
""",
)
@click.argument("file", type=paths.MODEL, metavar="FILE")
@options.as_json
def show(file: str, as_json: bool) -> None:
    """Say what a model is made of: its base, its effects, their parameters, and the channels it needs.

    FILE is a model file, or the name of a base.
    """
    from terrain_cli import models

    document = _description(file, models.resolve(file))
    if as_json:
        click.echo(json.dumps(document, ensure_ascii=False, indent=2, default=str))
    else:
        say("\n".join(_text(document)))


def _description(name: str, file: ModelFile) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "model": name,
        "base": file.model.base,
        "effects": [
            {
                "id": effect.id,
                "title": effect.title,
                "kind": effect.kind,
                "formula": effect.formula,
                "needs": list(effect.needs),
                "any_of": list(effect.any_of),
                "origin": effect.origin,
            }
            for effect in file.model.effects
        ],
        "parameters": {name: _parameter(name, unit, file) for name, unit in file.units.items()},
        "needs": list(file.model.needs),
        "uses": list(dict.fromkeys(name for effect in file.model.effects for name in effect.reads)),
        "history": list(file.history),
    }


def _parameter(name: str, unit: str, file: ModelFile) -> dict[str, Any]:
    from terrain_cli.models.model_file import SOIL_MEANINGS

    own = file.model.parameters.get(name)
    prior, factor = file.priors.get(name), file.factor(name)
    return {
        "unit": unit,
        "meaning": own.meaning if own else SOIL_MEANINGS[name],
        "held": file.fixed[name] / factor if name in file.fixed else None,
        "prior": {"mean": prior.mean / factor, "sd": prior.sd / factor} if prior else None,
        "per": "wheel" if own or name in file.shared else "window",
        "null": own.null / factor if own else None,
    }


def _text(document: dict[str, Any]) -> list[str]:
    lines = [f"{document['model']}: base {document['base']}"]
    for effect in document["effects"]:
        lines.append(f"  + {effect['id']} ({effect['kind']}): {effect['title']}")
        lines += [f"      {effect['formula']}"] * bool(effect["formula"])
    rows = [("parameter", "unit", "", "meaning")]
    for name, entry in document["parameters"].items():
        state = f"estimated for each {entry['per']}"
        if entry["held"] is not None:
            state = f"held at {entry['held']:g}"
        elif entry["prior"]:
            state += f", known as {entry['prior']['mean']:g} ± {entry['prior']['sd']:g}"
        rows.append((name, entry["unit"], state, entry["meaning"]))
    lines += aligned(rows, "  ")
    if document["uses"]:
        names = (name if name in document["needs"] else f"{name} (if there)" for name in document["uses"])
        lines.append(f"channels that the effects use: {', '.join(names)}")
    if document["history"]:
        from terrain_cli.improvement.model_history import rungs

        lines.append("history:")
        lines += [
            f"  {rung.number}. " + ": ".join(filter(None, [rung.label, rung.because]))
            for rung in rungs(document["history"])
        ]
    return lines
