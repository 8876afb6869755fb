"""`terrain-est model new FILE`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from terrain_cli.commands import options, paths, suggestions
from terrain_cli.vocabulary.choices import BASES


@click.command(
    "new",
    cls=paths.Verb,
    context_settings=options.CONTEXT,
    short_help="Write a new model file.",
    epilog="""\b
Examples:
  terrain-est model new model.toml
  terrain-est model new model.toml --effect slip-sinkage --effect drivetrain-friction
  terrain-est model new model.toml --effect cable-drag.toml --fix shear_modulus=0.018
""",
)
@click.argument("file", type=paths.RESULT, metavar="FILE")
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
    type=paths.EFFECT,
    envvar="TERRAIN_EST_EFFECT",
    metavar="EFFECT",
    shell_complete=suggestions.effects,
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

    FILE must not exist, unless --force is given. Parameters are named as in the file: cohesion,
    tan_phi, shear_modulus, stiffness, sinkage_exponent, and those of effects slip-sinkage.n1 and so on.
    """
    import formats
    from terrain_cli import models
    from terrain_cli.errors import UsageError

    formats.check_free(file, replace=force)
    folder = Path(file).parent
    named = models.named_from(effects, folder)
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
