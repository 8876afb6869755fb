"""`terrain-est inspect INPUT…`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options

if TYPE_CHECKING:
    from formats import FormatError


@click.command(
    "inspect",
    context_settings=options.CONTEXT,
    short_help="Say what a log holds, and what would be used of it.",
    epilog="""\b
Examples:
  terrain-est inspect run.bag
  terrain-est inspect day1/*.mcap --rover rover.toml --json
  terrain-est inspect --salvage downlink/*.db3
""",
)
@options.inputs
@options.rover
@options.wheel
@options.salvage
@options.as_json
@options.quiet
@options.verbose
def command(
    inputs: tuple[str, ...],
    rover: str | None,
    wheels: tuple[str, ...],
    salvage: bool,
    as_json: bool,
    quiet: bool,
    verbose: bool,
) -> int:
    """Say what is inside each INPUT, and for each channel what would be used, in which unit.

    Where something is missing it gives the lines of rover.toml that would supply it. Rates, gaps
    and the samples that would be set aside are counted by reading the file. A file that cannot be
    read is named with what is wrong with it; the others are shown.
    """
    import formats
    from terrain_cli import inspection
    from terrain_cli.commands.progress import Progress

    paths = formats.expand(inputs)
    rovers = options.load_rover(rover, paths)
    documents: list[dict[str, Any]] = []
    failed: list[FormatError] = []
    with Progress(len(paths), enabled=not quiet) as progress:
        for path in paths:
            progress.say(path, "")
            try:
                documents.append(inspection.inspect(path, rovers, wheels=wheels, salvage=salvage))
            except formats.FormatError as error:
                if len(paths) == 1:
                    raise
                failed.append(error)
            progress.advance()
    if as_json:
        content: dict[str, Any] = {"format": inspection.FORMAT, "inputs": documents}
        if failed:
            content["failed"] = [{"source": one.path, "error": str(one), "hint": one.hint} for one in failed]
        click.echo(json.dumps(content, ensure_ascii=False, indent=2))
    elif documents:
        click.echo("\n\n".join(inspection.text(document, verbose=verbose) for document in documents))
    for one in failed:
        click.echo(f"terrain-est: {one}" + f"\n  {one.hint}" * bool(one.hint), err=True)
    return failed[0].exit_code if failed else 0
