"""`terrain-est model remove FILE EFFECT… [--data INPUT…]`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import click

from terrain_cli.commands import comparison_options, options, paths, suggestions
from terrain_cli.commands.model import change_options


@click.command(
    "remove",
    cls=change_options.TakesInputs,
    context_settings=options.CONTEXT,
    short_help="Remove an effect, and see what it was worth.",
    epilog="""\b
Examples:
  terrain-est model remove model.toml load-bias
  terrain-est model remove model.toml load-bias --data day1/*.mcap
""",
)
@click.argument("file", type=paths.CHANGED, metavar="FILE")
@click.argument(
    "effects",
    nargs=-1,
    required=True,
    type=paths.EFFECT,
    metavar="EFFECT…",
    shell_complete=suggestions.effects,
)
@change_options.with_options
@click.pass_context
def remove(context: click.Context, /, **_: Any) -> None:
    """Remove each EFFECT from the model FILE, with all that FILE says of its parameters.

    With --data the model is fitted with and without it, and both are compared on stretches of the data
    that were not fitted. It is removed whatever comes out, as you have asked for it; if the held-out
    error rises, this is said, and `terrain-est model add` brings it back. FILE remembers either.
    """
    from terrain_cli.improvement import model_history
    from terrain_cli.presentation import change_sentences, change_text

    before, changed = change_options.change(context, "remove")
    if not context.params["inputs"]:
        change_options.untested(context, "remove", changed)
        return
    step = replace(change_options.tried(context, "remove", before, changed), kept=True)
    because = f"asked for; {change_sentences.found(step)}"
    change_options.write(context.params["file"], changed.file, model_history.entry(step, because))
    asked = comparison_options.repeated(context, context.params["file"])
    change_options.tell(context, change_text.text(step, asked), change_text.document(step, asked))
