"""`terrain-est model history FILE`."""

from __future__ import annotations

import json

import click

from terrain_cli.commands import options, paths
from terrain_cli.presentation.terminal import aligned, say
from terrain_cli.vocabulary.quantities import counted

FORMAT = "terrain-est/model-history/1"


@click.command(
    "history",
    cls=paths.Verb,
    context_settings=options.CONTEXT,
    short_help="Show what each change did to the held-out error.",
    epilog="""\b
Examples:
  terrain-est model history model.toml
  terrain-est model history model.toml --json
  terrain-est model history model.toml --plot pictures
""",
)
@click.argument("file", type=paths.MODEL, metavar="FILE")
@options.as_json
@click.option(
    "--plot",
    type=paths.PICTURES,
    metavar="DIR",
    help="Write a picture of the errors into this folder, as PNG and SVG (extra: plot).",
)
@options.quiet
def history(file: str, as_json: bool, plot: str | None, quiet: bool) -> None:
    """Show the ladder of errors of a model FILE: every effect added or removed, and what that did.

    Errors are rms errors on stretches of the data that were not fitted, with 95 % intervals, beside the
    noise that no model could predict. A step may have been tried on other data than the one before.
    """
    from terrain_cli.commands.model import change_options
    from terrain_cli.improvement import model_history
    from terrain_cli.views import ladder_table as views

    if plot:
        from terrain_cli.views import optional_libraries

        optional_libraries.need("plot")
    model = change_options.load(file)
    rungs = model_history.rungs(model.history)
    if as_json:
        content = {
            "format": FORMAT,
            "file": file,
            "base": model.model.base,
            "effects": [effect.id for effect in model.model.effects],
            "steps": [dict(entry) for entry in model.history],
        }
        click.echo(json.dumps(content, ensure_ascii=False, indent=2, default=str))
    else:
        name = " + ".join([model.model.base, *(effect.id for effect in model.model.effects)])
        say(f"{file}: {name}, after {counted(len(rungs), 'change')} on record")
        if rungs:
            head, rows = views.table(rungs)
            say("\n".join(["", *aligned([head, *rows]), "", *views.remarks(rungs)]))
    if plot:
        from terrain_cli.views import plots

        written = plots.write_ladder(rungs, plot)
        if not quiet:
            said = (
                f"{len(written)} pictures in {plot}" if written else "no step was tried on data: no picture"
            )
            click.echo(said, err=True)
