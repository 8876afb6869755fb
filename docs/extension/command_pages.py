"""The reference of the commands, made from the commands as the man pages are."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import click
from generate import blocks, contexts, short_help, variable

if TYPE_CHECKING:
    from collections.abc import Iterator


def markdown() -> str:
    """Write the sections of all commands."""
    return "\n\n".join("\n\n".join(section(context)) for context in contexts())


def section(context: click.Context) -> Iterator[str]:
    """Yield the paragraphs on a command."""
    command = context.command
    yield f"## {context.command_path}"
    yield f"{short_help(command)}"
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    yield f"```text\n{usage}\n```"
    # The first paragraph of the help is the line above.
    for paragraph in (command.help or "").split("\n\n")[1:]:
        yield escaped(" ".join(paragraph.split()))
    records = [
        (option, record)
        for option in command.get_params(context)
        if isinstance(option, click.Option) and (record := option.get_help_record(context))
    ]
    rows = [
        f"| `{cell(names)}` | {cell(escaped(' '.join(words.split())))} |" for _, (names, words) in records
    ]
    yield "\n".join(["| option | |", "|---|---|", *rows])
    variables = [f"`{name}`" for option, _ in records if (name := variable(option, context))]
    if variables:
        yield f"Environment: {', '.join(variables)}. The option takes precedence over its variable."
    examples = blocks(command.epilog).get("Examples")
    if examples:
        yield f"```sh\n{textwrap.dedent(examples)}\n```"


def escaped(words: str) -> str:
    """Keep what Markdown or HTML would take for its own."""
    return "".join(rf"\{letter}" if letter in "*_<>[]$" else letter for letter in words)


def cell(words: str) -> str:
    """Keep a cell of a table in one."""
    return words.replace("|", r"\|")
