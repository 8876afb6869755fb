"""`model add` and `model remove`: their common options, the trial on data, the writing of the result."""

from __future__ import annotations

from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import comparison_options, options, paths
from terrain_cli.presentation.terminal import say
from terrain_cli.vocabulary.choices import BASES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from terrain_cli.improvement import Step
    from terrain_cli.improvement.improvement_outcome import Action
    from terrain_cli.models import Changed, ModelFile


class TakesInputs(paths.Verb):
    """A command whose --data takes all that follows, up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat --data before each of its inputs, as click wants it."""
        spread: list[str] = []
        inside = False
        for word in args:
            option = word.startswith("-") and word != "-"
            if option:
                inside = word == "--data" or word.startswith("--data=")
            elif inside and spread[-1] != "--data":
                spread.append("--data")
            spread.append(word)
        return super().parse_args(ctx, spread)


_OPTIONS = (
    click.option(
        "--data",
        "inputs",
        multiple=True,
        type=paths.INPUT,
        envvar="TERRAIN_EST_DATA",
        metavar="INPUT…",
        help="Try it on these: files (CSV, Parquet, ROS 1 or ROS 2 bag), folders, patterns, or - for the "
        "standard input. Takes all that follows, up to the next option.",
    ),
    options.rover,
    options.wheel,
    comparison_options.cutting,
    options.as_json,
    options.quiet,
)


def with_options(command: options.F) -> options.F:
    """Add the options of a change that is tried on data."""
    return reduce(lambda decorated, option: option(decorated), reversed(_OPTIONS), command)


def load(path: str) -> ModelFile:
    """Read the model file that is to be changed, which is not the name of a base."""
    from terrain_cli import models
    from terrain_cli.errors import UsageError

    if path in BASES and not Path(path).exists():
        raise UsageError(
            f"{path} is a base, not a file", hint=f"terrain-est model new model.toml --base {path}"
        )
    return models.load(path) if Path(path).exists() else models.resolve(path)


def change(context: click.Context, action: Action) -> tuple[ModelFile, Changed]:
    """Read the model file, and change it as the command line says."""
    from terrain_cli import models

    given = context.params
    before = load(given["file"])
    names = models.named_from(given["effects"], Path(given["file"]).parent)
    modulus = _shear_modulus(context) if models.ASSUMPTIONS.keys() & set(names) else 0.0
    return before, (models.added if action == "add" else models.removed)(before, names, modulus)


def _shear_modulus(context: click.Context) -> float:
    """Return the k of rover.toml: of the data, or beside the model file where there are none."""
    import formats

    given = context.params
    paths = formats.expand(given["inputs"]) if given["inputs"] else [given["file"]]
    return options.load_rover(given["rover"], paths).soil_shear_modulus()


def tried(
    context: click.Context,
    action: Action,
    before: ModelFile,
    changed: Changed,
    inputs: Sequence[str] | None = None,
) -> Step:
    """Try a change on the data of the command line, or on other inputs; it is not kept."""
    from terrain_cli import improvement
    from terrain_cli.commands.progress import Progress

    given = context.params
    number = len(given["inputs"] if inputs is None else inputs)
    with Progress(number + 1, enabled=not given["quiet"]) as progress:
        cut = comparison_options.read(context, [before, changed.file], progress, inputs)
        return improvement.tried(
            cut,
            action,
            changed.ids,
            before,
            changed.file,
            seed=given["seed"],
            progress=lambda step: progress.say(given["file"], step),
        )


def untested(context: click.Context, action: Action, changed: Changed) -> None:
    """Make a change without data, and tell it."""
    from terrain_cli.improvement import model_history
    from terrain_cli.presentation import change_text

    entry = model_history.untested(action, changed.ids, changed.file)
    sentence = change_text.untested_sentence(action, changed.ids)
    write(context.params["file"], changed.file, entry)
    tell(context, sentence, change_text.untested(entry, sentence))


def tell(context: click.Context, text: str, content: Mapping[str, Any]) -> None:
    """Write what came out, for a person or as JSON."""
    from terrain_cli.presentation import terminal

    file = context.params["file"]
    if context.params["as_json"]:
        click.echo(terminal.as_json({**content, "file": file}))
    else:
        say(f"{file}: {text}")


def write(path: str, after: ModelFile, *entries: Mapping[str, Any]) -> None:
    """Write a model file with further entries of its history, whole or not at all."""
    from terrain_cli import models

    for entry in entries:
        after = models.recorded(after, entry)
    models.save(after, path)
