"""`terrain-est completion SHELL`."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class


@click.command(
    "completion",
    short_help="Print the completion script of a shell.",
    epilog="""\b
Examples:
  bash:  terrain-est completion bash > ~/.local/share/bash-completion/completions/terrain-est
  zsh:   terrain-est completion zsh > "${fpath[1]}/_terrain-est"
  fish:  terrain-est completion fish > ~/.config/fish/completions/terrain-est.fish
""",
)
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(shell: str) -> None:
    """Print the script that lets SHELL complete verbs, options, files and choices."""
    from terrain_cli.app import cli

    kind = get_completion_class(shell)
    if kind is None:
        raise click.UsageError(f"no completion for {shell}")
    click.echo(kind(cli, {}, "terrain-est", "_TERRAIN_EST_COMPLETE").source())
