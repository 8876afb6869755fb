"""What a shell offers for options that take names: only what can be told at once, without reading a log."""

from __future__ import annotations

from typing import TYPE_CHECKING

from click.shell_completion import CompletionItem

from terrain_cli.vocabulary.choices import BASES

if TYPE_CHECKING:
    from collections.abc import Iterable

    import click


def effects(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    """Offer the effects of the catalogue, or files."""
    from terrain_cli.effects import NAMES

    return _or_files(NAMES, begun)


def models(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    """Offer the bases, or files."""
    return _or_files(BASES, begun)


def soils(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    """Offer the published soils."""
    from terrain_cli.simulation.scenario import SOILS

    return _beginning(SOILS, begun)


def drives(_context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    """Offer the prepared drives."""
    from terrain_cli.simulation.drive_file import PRESETS

    return _beginning(PRESETS, begun)


def wheels(context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
    """Offer the wheels that rover.toml names."""
    from terrain_cli import rover
    from terrain_cli.errors import ConfigurationError

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
