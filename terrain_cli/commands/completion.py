"""`terrain-est completion SHELL`."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from terrain_cli.commands import paths


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
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@click.pass_context
def command(context: click.Context, /, shell: str) -> None:
    """Print the script that lets SHELL complete verbs, options, files and choices."""
    click.echo(script(context.find_root().command, shell), nl=False)


def script(program: click.Command, shell: str) -> str:
    kind = get_completion_class(shell)
    if kind is None:
        raise click.UsageError(f"no completion for {shell}")
    return kind(program, {}, "terrain-est", "_TERRAIN_EST_COMPLETE").source() + "\n"
