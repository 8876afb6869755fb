"""`terrain-est model new|show|add|remove|history`."""

from __future__ import annotations

import click

from terrain_cli.commands import options
from terrain_cli.commands.group import Group
from terrain_cli.commands.model.add import add
from terrain_cli.commands.model.history import history
from terrain_cli.commands.model.new import new
from terrain_cli.commands.model.remove import remove
from terrain_cli.commands.model.show import show


@click.group(
    "model",
    cls=Group,
    context_settings=options.CONTEXT,
    epilog="""\b
Examples:
  terrain-est model new model.toml
  terrain-est model add model.toml slip-sinkage --data day1/*.mcap
  terrain-est model add model.toml --until-quiet --data run.bag
  terrain-est model history model.toml
""",
)
def command() -> None:
    """Write model files, show them, and improve them step by step.

    A model file names a base (wong-reece or linear) and the physical effects added to it, holds those
    of their parameters that are not to be estimated, and remembers what each change did to the error
    on data that were not fitted. `terrain-est estimate --model FILE` fits it.
    """


for verb in (new, show, add, remove, history):
    command.add_command(verb)
