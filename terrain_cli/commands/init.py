"""`terrain-est init INPUT`."""

import click

from terrain_cli.commands import options, paths
from terrain_cli.errors import UsageError
from terrain_cli.presentation.terminal import put


@options.verb(
    "init",
    "terrain-est init run.bag",
    "terrain-est init run.bag -o rover.toml",
    "terrain-est init day1/run_0.db3 --salvage -o day1/rover.toml --force",
)
@click.argument("log", type=paths.INPUT, metavar="INPUT")
@options.value("-o --output FILE", paths.RESULT, "Write the rover file here, not to stdout.")
@click.option("--force", is_flag=True, help="Replace FILE if it is there.")
@options.salvage
@options.largest
@options.quiet
def command(log: str, output: str | None, force: bool, salvage: bool, quiet: bool) -> None:
    """Write a rover.toml for INPUT: the channels found in it, and what is left to fill in.

    Each channel has a line that says where it is read and in which unit. A unit is never guessed:
    where the log does not tell it, the line is a comment that says what to write. The sizes of the
    wheel and the shear modulus of the soil are yours to fill in, and the lines ask for them by name.
    An existing rover.toml is not read.
    """
    import formats
    from terrain_cli.presentation import rover_draft

    if output:
        formats.check_free(output, replace=force)
    logs = formats.expand([log])
    if len(logs) > 1:
        raise UsageError(f"{log} stands for {len(logs)} logs", hint=f"name one of them, such as {logs[0]}")
    text, left = rover_draft.draft(formats.open_source(logs[0], salvage=salvage))
    put(text, output or "-")
    if not quiet:
        click.echo(f"still to fill in: {', '.join(left)}", err=True)
