"""What is suggested: by a shell for options that take names, by a command for a verb that it does not know.

Only what can be told at once, without reading a log.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
from click.shell_completion import CompletionItem

from terrain_cli.errors import ConfigurationError
from terrain_cli.vocabulary.choices import BASES

if TYPE_CHECKING:
    from collections.abc import Iterable


class Group(click.Group):
    """Verbs, of which the nearest is named where there is none of the name given."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a verb, or name the nearest; a shell that asks what may follow is told nothing."""
        verbs = self.list_commands(ctx)
        if args and args[0] not in verbs and not args[0].startswith("-") and not ctx.resilient_parsing:
            import difflib

            near = difflib.get_close_matches(args[0], verbs, n=1)
            ctx.fail(f"no such command: {args[0]}" + (f"; did you mean {near[0]}?" if near else ""))
        return super().resolve_command(ctx, args)


def effects(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    from terrain_cli.effects import NAMES

    return _or_files(NAMES, begun)


def models(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    return _or_files(BASES, begun)


def soils(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    from terrain_cli.simulation.scenario import SOILS

    return _beginning(SOILS, begun)


def drives(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    from terrain_cli.simulation.drive_file import PRESETS

    return _beginning(PRESETS, begun)


def wheels(context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    from terrain_cli import rover

    # An option without its value ends the reading of the line, and the inputs are then only words.
    inputs = context.params.get("inputs") or context.args or (None,)
    try:
        return _beginning(rover.load(rover.find(context.params.get("rover"), inputs[0])).wheels, begun)
    except ConfigurationError:
        # The command itself will say what is wrong with it.
        return []


def _beginning(names: Iterable[str], begun: str) -> list[CompletionItem]:
    return [CompletionItem(name) for name in names if name.startswith(begun)]


def _or_files(names: Iterable[str], begun: str) -> list[CompletionItem]:
    # bash forgets what comes before a file.
    return [CompletionItem(begun, type="file"), *_beginning(names, begun)]
