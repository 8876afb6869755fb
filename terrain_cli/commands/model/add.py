"""`terrain-est model add FILE EFFECT… [--data INPUT…]`, and the loop `--until-quiet`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import comparison_options, options, paths, suggestions
from terrain_cli.commands.model import change_options

if TYPE_CHECKING:
    from collections.abc import Mapping


@click.command(
    "add",
    cls=change_options.TakesInputs,
    context_settings=options.CONTEXT,
    short_help="Add an effect, if it makes the held-out error fall.",
    epilog="""\b
Examples:
  terrain-est model add model.toml slip-sinkage --data day1/*.mcap
  terrain-est model add model.toml cable-drag.toml --data run.bag --json > change.json
  terrain-est model add model.toml slip-sinkage --data monday.csv --confirm tuesday.csv
  terrain-est model add model.toml load-bias slope --data run.csv --segments none --keep
  terrain-est model add model.toml --until-quiet --data run.bag
  terrain-est model add model.toml hardpan
""",
)
@click.argument("file", type=paths.CHANGED, metavar="FILE")
@click.argument(
    "effects", nargs=-1, type=paths.EFFECT, metavar="[EFFECT…]", shell_complete=suggestions.effects
)
@click.option(
    "--confirm",
    multiple=True,
    type=paths.INPUT,
    metavar="INPUT",
    help="Another drive, which did not choose the effect (repeatable): FILE gets the effect only if the "
    "held-out error falls there too.",
)
@click.option("--keep", is_flag=True, help="Add it even if the held-out error does not fall.")
@click.option(
    "--until-quiet",
    is_flag=True,
    help="Let the data choose: diagnose, add what pays, and again, until nothing is missing that the data "
    "could tell. EFFECT… are then candidates beside the catalogue.",
)
@click.option(
    "--draft",
    type=paths.OUTPUT,
    metavar="FILE.toml|DIR",
    help="With --until-quiet: where to write an effect of your own for what no candidate explains.  "
    "[stop there]",
)
@change_options.with_options
@click.pass_context
def add(context: click.Context, /, **_: Any) -> None:
    """Add each EFFECT to the model FILE, if that makes the error on held-out data fall.

    EFFECT is an id of the catalogue (terrain-est effects list), the TOML file of an effect of your own
    or of a draft, or an assumption of the base that is lifted. With --data the model is fitted without
    and with it, c, φ and all, and both are compared on stretches of the data that were not fitted.
    Several are added together. FILE gets the effect and an entry of its history, which says whether
    the same data proved the effect or another drive (--confirm).

    FILE is left as it is, unless --keep is given, if the held-out error falls significantly in no
    channel, rises in one by more than it falls in others, or falls only with a parameter that is
    physically impossible (friction that drives the wheel). The reason is told; the exit code is 0.
    Without --data the effect is added untested, which the history says too.
    """
    from terrain_cli.errors import UsageError

    given = context.params
    if given["confirm"]:
        _check_confirm(given)
    if given["until_quiet"]:
        if not given["inputs"]:
            raise UsageError("--until-quiet needs --data", hint="--data run.bag, or several inputs")
        if given["keep"]:
            raise UsageError("--keep and --until-quiet contradict each other", hint="leave out one of them")
        from terrain_cli.commands.model import until_quiet

        until_quiet.run(context)
        return
    if not given["effects"]:
        raise UsageError(
            "model add: which EFFECT?", hint="terrain-est effects list shows them; --until-quiet finds out"
        )
    if given["draft"]:
        raise UsageError("--draft is for --until-quiet", hint="a draft is added by its file name")
    _add(context)


def _check_confirm(given: Mapping[str, Any]) -> None:
    """Refuse a proof that is none: no data to compare with, or the same data."""
    import formats
    from terrain_cli.errors import UsageError

    if not given["inputs"]:
        raise UsageError("--confirm needs --data", hint="--data is the drive that the effect was named on")
    if given["until_quiet"]:
        raise UsageError(
            "--confirm is for effects that are named",
            hint="let --until-quiet choose first, then add what it chose to a new model with --confirm",
        )
    data = {Path(path).resolve() for path in formats.expand(given["inputs"])}
    for path in formats.expand(given["confirm"]):
        if Path(path).resolve() in data:
            raise UsageError(f"--confirm {path} is of --data too", hint="name another drive")


def _add(context: click.Context) -> None:
    from terrain_cli.improvement import model_history
    from terrain_cli.presentation import change_sentences, change_text

    given = context.params
    before, changed = change_options.change(context, "add")
    if not given["inputs"]:
        change_options.untested(context, "add", changed)
        return
    step = change_options.tried(context, "add", before, changed)
    if given["confirm"] and step.pays:
        step = replace(
            step, confirmation=change_options.tried(context, "add", before, changed, given["confirm"])
        )
    step = replace(step, kept=(step.pays and step.confirmed) or given["keep"])
    if step.kept:
        entry = model_history.entry(step, change_sentences.reason(step))
        change_options.write(given["file"], changed.file, entry)
    asked = comparison_options.repeated(context, given["file"])
    change_options.tell(context, change_text.text(step, asked), change_text.document(step, asked))
