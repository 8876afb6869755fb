"""`terrain-est inspect INPUT…`."""

from __future__ import annotations

import json
from typing import Any

import click

from terrain_cli.commands import options


@click.command(
    "inspect",
    context_settings=options.CONTEXT,
    short_help="Say what a log holds, and what would be used of it.",
    epilog="""\b
Examples:
  terrain-est inspect run.bag
  terrain-est inspect day1/*.mcap --rover rover.toml --json
""",
)
@options.inputs
@options.rover
@options.wheel
@options.as_json
@options.quiet
@options.verbose
def command(
    inputs: tuple[str, ...],
    rover: str | None,
    wheels: tuple[str, ...],
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> None:
    """Say what is inside each INPUT, and for each channel what would be used, in which unit.

    Where something is missing it gives the lines of rover.toml that would supply it. Rates, gaps
    and the samples that would be set aside are counted by reading the file.
    """
    import formats
    from terrain_cli import inspection
    from terrain_cli.commands.progress import Progress

    paths = formats.expand(inputs)
    rovers = options.load_rover(rover, paths)
    documents: list[dict[str, Any]] = []
    with Progress(len(paths), enabled=not quiet) as progress:
        for path in paths:
            progress.say(path, "")
            documents.append(inspection.inspect(path, rovers, wheels=wheels))
            progress.advance()
    if as_json:
        click.echo(
            json.dumps({"format": inspection.FORMAT, "inputs": documents}, ensure_ascii=False, indent=2)
        )
        return
    click.echo("\n\n".join(inspection.text(document, verbose=verbose) for document in documents))
