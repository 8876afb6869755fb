"""`terrain-est completion SHELL`."""

import click
from click.shell_completion import BashComplete, FishComplete, ZshComplete

from terrain_cli.commands import paths

_SHELLS = {"bash": BashComplete, "zsh": ZshComplete, "fish": FishComplete}


@click.command(
    "completion",
    cls=paths.Verb,
    epilog="""\b
Examples:
  bash:  terrain-est completion bash > ~/.local/share/bash-completion/completions/terrain-est
  zsh:   terrain-est completion zsh > "${fpath[1]}/_terrain-est"
  fish:  terrain-est completion fish > ~/.config/fish/completions/terrain-est.fish
""",
)
@click.argument("shell", type=click.Choice(list(_SHELLS)))
@click.pass_context
def command(context: click.Context, /, shell: str) -> None:
    """Print the script that lets SHELL complete commands, options, files and choices."""
    program = context.find_root().command
    click.echo(_SHELLS[shell](program, {}, "terrain-est", "_TERRAIN_EST_COMPLETE").source())
