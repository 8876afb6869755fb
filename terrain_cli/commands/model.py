"""`terrain-est model new|show|add|remove|history`."""

import json
from pathlib import Path
from typing import Any

import click

from terrain_cli.commands import comparison_options, model_changes, options, paths
from terrain_cli.commands.model_changes import add
from terrain_cli.errors import UsageError
from terrain_cli.presentation.terminal import say
from terrain_cli.vocabulary.choices import BASES


@options.verb(
    "new",
    "terrain-est model new model.toml",
    "terrain-est model new model.toml --effect slip-sinkage --effect drivetrain-friction",
    "terrain-est model new model.toml --effect cable-drag.toml --fix shear_modulus=0.018",
    short_help="Write a new model file.",
)
@click.argument("file", type=paths.RESULT, metavar="FILE")
@click.option(
    "--base",
    type=click.Choice(BASES),
    default="wong-reece",
    show_default=True,
    help="The stresses under the rim: those of Wong and Reece, or the triangles of the linearised model.",
)
@options.value(
    "--effect effects EFFECT",
    paths.EFFECT,
    "An id of the catalogue, or the TOML file of an effect (repeatable).",
    multiple=True,
    envvar="TERRAIN_EST_EFFECT",
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


@options.verb(
    "show",
    "terrain-est model show model.toml",
    "terrain-est model show wong-reece --json",
    short_help="Say what a model file holds.",
)
@click.argument("file", type=paths.MODEL, metavar="FILE")
@options.as_json
def show(file: str, as_json: bool) -> None:
    """Say what a model is made of: its base, its effects, their parameters, and the channels it needs.

    FILE is a model file, or the name of a base.
    """
    from terrain_cli import models
    from terrain_cli.presentation import model_text

    document = model_text.document(file, models.resolve(file))
    if as_json:
        click.echo(json.dumps(document, ensure_ascii=False, indent=2, default=str))
    else:
        say("\n".join(model_text.text(document)))


@options.verb(
    "history",
    "terrain-est model history model.toml",
    "terrain-est model history model.toml --json",
    "terrain-est model history model.toml --plot pictures",
    short_help="Show what each change did to the held-out error.",
)
@click.argument("file", type=paths.MODEL, metavar="FILE")
@options.as_json
@options.plot("Write a picture of the errors into this folder, as PNG and SVG (extra: plot).")
@options.quiet
def history(file: str, as_json: bool, plot: str | None, quiet: bool) -> None:
    """Show every effect added to a model FILE or removed, and the errors before and after.

    Errors are rms errors on stretches of the data that were not fitted, with 95 % intervals, beside the
    noise, which no model can predict. A step may have been tried on other data than the one before.
    """
    from terrain_cli.improvement import model_history
    from terrain_cli.presentation import model_text

    model = model_changes.load(file)
    rungs = model_history.rungs(model.history)
    if as_json:
        click.echo(json.dumps(model_text.history(file, model), ensure_ascii=False, indent=2, default=str))
    else:
        say("\n".join(model_text.history_text(file, model)))
    given = {"plot": plot, "quiet": quiet}
    comparison_options.draw(rungs, given, "no step was tried on data: no picture")


@options.verb(
    "remove",
    "terrain-est model remove model.toml load-bias",
    "terrain-est model remove model.toml load-bias --data day1/*.mcap",
    cls=model_changes.TakesInputs,
    short_help="Remove an effect, and see what it was worth.",
)
@click.argument("file", type=paths.CHANGED, metavar="FILE")
@click.argument("effects", nargs=-1, required=True, type=paths.EFFECT, metavar="EFFECT…")
@model_changes.with_options
@click.pass_context
def remove(context: click.Context, /, **_: Any) -> None:
    """Remove each EFFECT from the model FILE, with all that FILE says of its parameters.

    With --data the model is fitted with and without it, and both are compared on stretches of the data
    that were not fitted. It is removed in any case. If the held-out error rises, the output
    says so, and `terrain-est model add` adds it again. FILE records both changes.
    """
    model_changes.change(context, "remove")


@options.group(
    "model",
    "terrain-est model new model.toml",
    "terrain-est model add model.toml slip-sinkage --data day1/*.mcap",
    "terrain-est model add model.toml --until-quiet --data run.bag",
    "terrain-est model history model.toml",
)
def command() -> None:
    """Write model files, show them, and improve them step by step.

    A model file names a base (wong-reece or linear) and the physical effects added to it. It may hold
    parameters at given values, which are then not estimated, and it records what each change did to
    the error on data that were not fitted. `terrain-est estimate --model FILE` fits it.
    """


for verb in (new, show, add, remove, history):
    command.add_command(verb)
