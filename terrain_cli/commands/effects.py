"""`terrain-est effects list|show|check`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options, paths
from terrain_cli.errors import TerrainError
from terrain_cli.mechanics.effect import KINDS, Effect
from terrain_cli.presentation.terminal import complain, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from terrain_cli.models import Assumption


@options.group(
    "effects",
    "terrain-est effects list --kind sensor",
    "terrain-est effects show slip-sinkage",
    "terrain-est effects check cable-drag.toml",
)
def command() -> None:
    """Show the physical effects that can be added to a model, and check effects of your own.

    An effect of your own is a file in TOML: a law, its parameters with their units, and the
    channels that it needs. docs/effects.md says how to write one.
    """


@options.verb(
    "list",
    "terrain-est effects list",
    "terrain-est effects list --kind contact --json",
    short_help="List the effects of the catalogue.",
)
@click.option(
    "--kind",
    type=click.Choice(KINDS),
    help="Only effects on the soil, a stress, the contact, a force, or what a sensor shows.",
)
@options.as_json
def list_effects(kind: str | None, as_json: bool) -> None:
    """List the effects of the catalogue: what each changes, and the channels that it needs.

    Effects of other Python packages follow those of the program. Last come the assumptions of the
    bases: `terrain-est model add` removes one as it adds an effect.
    """
    from terrain_cli import effects
    from terrain_cli.models import ASSUMPTIONS
    from terrain_cli.presentation import effect_text

    chosen = [effect for effect in effects.catalogue().values() if kind in {None, effect.kind}]
    assumptions = list(ASSUMPTIONS.values()) if kind is None else []
    if as_json:
        say(_listed(chosen, assumptions))
        return
    say(effect_text.overview(chosen))
    if assumptions:
        say(f"\n{effect_text.overview_of_assumptions(assumptions)}")


@options.verb(
    "show",
    "terrain-est effects show slip-sinkage",
    "terrain-est effects show max-stress-angle cable-drag.toml --json",
    short_help="Show all about effects: law, parameters, signature in the errors, source.",
)
@click.argument("names", nargs=-1, required=True, type=paths.EFFECT, metavar="EFFECT…")
@options.as_json
def show(names: tuple[str, ...], as_json: bool) -> None:
    """Show all about each EFFECT: an id of the catalogue, a file of your own, or an assumption of a base.

    That is its law, its parameters with unit, null value (at which the effect is absent), typical
    size and bounds, what happens in the ground or the drive, which residuals it leaves, which
    manoeuvre tells it from similar effects, and the source.
    """
    from terrain_cli.models import ASSUMPTIONS
    from terrain_cli.presentation import effect_text

    effects = {name: _effect(name) for name in names if name not in ASSUMPTIONS}
    if as_json:
        assumptions = [ASSUMPTIONS[name] for name in names if name in ASSUMPTIONS]
        say(_listed(list(effects.values()), assumptions))
        return
    told = {name: effect_text.text(effect) for name, effect in effects.items()}
    say("\n\n".join(told.get(name) or effect_text.text_of_assumption(ASSUMPTIONS[name]) for name in names))


@options.verb(
    "check",
    "terrain-est effects check cable-drag.toml",
    "terrain-est effects check my-effects/*.toml --json",
    short_help="Check effects of your own.",
)
@click.argument("files", nargs=-1, required=True, type=paths.EFFECT_FILE, metavar="FILE…")
@options.as_json
@options.quiet
@click.pass_context
def check(context: click.Context, files: tuple[str, ...], as_json: bool, quiet: bool) -> None:
    """Check each FILE, and say what was understood of it.

    The law may hold arithmetic and the usual functions, and nothing else. Its units must match, it
    may read only what is known where it is used, and with every parameter at its null value it must
    give back what it changes. Errors come with line and column.
    """
    from formats import FormatError
    from terrain_cli import effects
    from terrain_cli.effects.laws import effect_file
    from terrain_cli.presentation import effect_text

    documents: list[dict[str, Any]] = []
    codes = []
    for file in files:
        try:
            understood = effect_file.read(file)
        except (TerrainError, FormatError) as error:
            codes.append(error.exit_code)
            complain(str(error), error.hint)
            documents.append({"file": file, "ok": False, "error": str(error), "hint": error.hint})
            continue
        if understood.effect.id in effects.catalogue():
            understood.warnings.append(
                f"the catalogue has an effect {understood.effect.id} too; no model can hold both"
            )
        documents.append(effect_text.checked(file, understood))
        for warning in [] if quiet else understood.warnings:
            click.echo(f"{file}: warning: {warning}", err=True)
        if not as_json:
            say("\n" * (len(documents) > 1) + effect_text.checked_text(file, understood))
    if as_json:
        say({"format": effect_text.CHECK_FORMAT, "files": documents})
    # A file that is wrong outweighs one that is not there.
    context.exit(max(codes, default=0))


def _listed(effects: Sequence[Effect], assumptions: Sequence[Assumption]) -> dict[str, Any]:
    from terrain_cli.presentation import effect_text

    return {
        "format": effect_text.LIST_FORMAT,
        "effects": [effect_text.document(effect) for effect in effects],
        "assumptions": [asdict(one) for one in assumptions],
    }


def _effect(name: str) -> Effect:
    from terrain_cli import effects, models
    from terrain_cli.effects.laws import effect_file

    is_file = models.is_path(name) or (name not in effects.NAMES and Path(name).is_file())
    return effect_file.load(name) if is_file else effects.find(name)


for verb in (list_effects, show, check):
    command.add_command(verb)
