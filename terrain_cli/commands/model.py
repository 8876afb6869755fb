"""`terrain-est model new FILE` and `terrain-est model show FILE`."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options
from terrain_cli.commands.group import Group
from terrain_cli.settings import BASES

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.models import ModelFile

FORMAT = "terrain-est/model-description/1"


@click.group(
    "model",
    cls=Group,
    context_settings=options.CONTEXT,
    short_help="Write and show model files.",
    epilog="""\b
Examples:
  terrain-est model new model.toml --effect slip-sinkage
  terrain-est model show model.toml
""",
)
def command() -> None:
    """Write and show model files.

    A model file names a base (wong-reece or linear) and the physical effects added to it, and holds
    those of their parameters that are not to be estimated. `terrain-est estimate --model FILE` fits it.
    """


@command.command(
    "new",
    context_settings=options.CONTEXT,
    short_help="Write a new model file.",
    epilog="""\b
Examples:
  terrain-est model new model.toml
  terrain-est model new model.toml --effect slip-sinkage --effect drivetrain-friction
  terrain-est model new model.toml --effect cable-drag.toml --fix shear_modulus=0.018
""",
)
@click.argument("file", type=options.FILE, metavar="FILE")
@click.option(
    "--base",
    type=click.Choice(BASES),
    default="wong-reece",
    show_default=True,
    help="The stresses under the rim: those of Wong and Reece, or the triangles of the linearised model.",
)
@click.option(
    "--effect",
    "effects",
    multiple=True,
    envvar="TERRAIN_EST_EFFECT",
    metavar="EFFECT",
    help="An id of the catalogue, or the TOML file of an effect (repeatable).",
)
@click.option(
    "--fix",
    "fixed",
    multiple=True,
    envvar="TERRAIN_EST_FIX",
    metavar="NAME=VALUE",
    help="Hold a parameter at a value instead of estimating it, in the unit that `model show` lists "
    "(repeatable).",
)
@click.option("--force", is_flag=True, help="Replace FILE if it is there.")
def new(file: str, base: str, effects: tuple[str, ...], fixed: tuple[str, ...], force: bool) -> None:
    """Write a model file: plain text, to be edited.

    FILE must not exist. Parameters are named as in the file: cohesion, tan_phi, shear_modulus,
    stiffness, sinkage_exponent, and those of effects slip-sinkage.n1 and so on.
    """
    from formats.errors import CannotWriteError
    from terrain_cli import models
    from terrain_cli.errors import UsageError

    if Path(file).exists() and not force:
        raise CannotWriteError(file, "is there already", hint="--force replaces it")
    folder = Path(file).parent
    named = [os.path.relpath(name, folder) if models.is_path(name) else name for name in effects]
    values: dict[str, Any] = {}
    for text in fixed:
        name, equals, number = text.partition("=")
        try:
            values[name.strip()] = float(number)
        except ValueError:
            equals = ""
        if not equals:
            raise UsageError(f"--fix {text}: is not NAME=VALUE", hint="such as --fix shear_modulus=0.018")
    models.save(models.build(base, named, values, folder), file)


@command.command(
    "show",
    context_settings=options.CONTEXT,
    short_help="Say what a model file holds.",
    epilog="""\b
Examples:
  terrain-est model show model.toml
  terrain-est model show wong-reece --json
""",
)
@click.argument("file", type=options.FILE, metavar="FILE")
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
        click.echo("\n".join(_text(document)))


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
    own = file.model.parameters.get(name)
    prior, factor = file.priors.get(name), file.factor(name)
    return {
        "unit": unit,
        "meaning": own.meaning if own else "of the soil",
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
    lines += _aligned(rows)
    if document["uses"]:
        names = (name if name in document["needs"] else f"{name} (if there)" for name in document["uses"])
        lines.append(f"channels that the effects use: {', '.join(names)}")
    if document["history"]:
        lines.append("history:")
        for number, entry in enumerate(document["history"], 1):
            lines.append(f"  {number}. " + ", ".join(f"{key} {value}" for key, value in entry.items()))
    return lines


def _aligned(rows: Sequence[tuple[str, ...]]) -> list[str]:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return ["  " + "  ".join(c.ljust(w) for c, w in zip(row, widths, strict=True)).rstrip() for row in rows]
