"""The gallery of effects: what each does, its trace, and what `diagnose` says of it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from command_pages import cell, escaped
from trace_picture import picture

from terrain_cli.effects import catalogue
from terrain_cli.vocabulary.quantities import quantity

if TYPE_CHECKING:
    from terrain_cli.effects import Effect

#: Written by `python -m benchmarks.effect_gallery`.
TRACES = Path(__file__).resolve().parent.parent / "gallery.json"
#: Rows of the table of candidates that are shown: the model as it is, and the best.
ROWS = 4


def markdown() -> str:
    """Write the sections of all effects."""
    traces = json.loads(TRACES.read_text("utf-8"))
    effects = catalogue()
    rows = [
        f"| [{name}](#{name}) | {effect.title} | {verdict(traces[name]['diagnosis'])} |"
        for name, effect in effects.items()
    ]
    table = "\n".join(["| effect | what it is | here `diagnose` finds |", "|---|---|---|", *rows])
    return "\n\n".join([table, *(section(effect, traces[name]) for name, effect in effects.items())])


def verdict(diagnosis: str) -> str:
    """Say in a word what was found: the stars of the table are the effects that cannot be told apart."""
    stars = [line.split()[1] for line in diagnosis.splitlines() if line.startswith("* ")]
    if not stars:
        return "nothing"
    return stars[0] if len(stars) == 1 else f"one of {len(stars)}"


def section(effect: Effect, trace: dict[str, Any]) -> str:
    """Write all about an effect."""
    sentence, _, rest = trace["diagnosis"].partition("\n")
    return "\n\n".join(
        [
            f"## {effect.id}",
            f"**{effect.title}.** {escaped(effect.explanation)}",
            f"```text\n{effect.formula}\n```",
            f"*Shows as:* {escaped(effect.shows)}. *Settled by:* {escaped(effect.settled_by)}.",
            f'<div class="traces">{"".join(pictures(trace))}</div>',
            f"```sh\n{command(effect.id, trace['drive'])}\nterrain-est diagnose {effect.id}.csv\n```",
            f"> {escaped(sentence)}",
            f"```text\n{shortened(rest)}\n```",
            parameters(effect),
            f"*Source:* {escaped(effect.reference)}",
        ]
    )


def pictures(trace: dict[str, Any]) -> list[str]:
    """Draw the residual of each channel, in the units that people read."""
    along = quantity(trace["driver"], trace["unit"])
    drawn = []
    for name, one in trace["channels"].items():
        shown = quantity(name, one["unit"])
        points = [(x * along.factor, y * shown.factor, bar * shown.factor) for x, y, bar in one["bins"]]
        drawn.append(picture(shown.label, along.label, points, one["noise"] * shown.factor))
    return drawn


def command(effect: str, drive: dict[str, Any]) -> str:
    """Return the command that makes the log."""
    options = " ".join(
        f"--{name} {value:g}" if isinstance(value, float) else f"--{name} {value}"
        for name, value in drive.items()
    )
    return f"terrain-est simulate -o {effect}.csv --effect {effect} {options}"


def shortened(diagnosis: str) -> str:
    """Leave out all but the alarm, the best candidates, and what to drive next."""
    kept, rows, left_out = [], 0, False
    for line in diagnosis.splitlines():
        if line.startswith("not testable"):
            break
        in_table = line.startswith(("  ", "* "))
        rows = rows + 1 if in_table else 0
        if in_table and rows > ROWS:
            left_out = True
            continue
        if left_out:
            kept.append("…")
            left_out = False
        kept.append(line)
    return "\n".join([*kept, *["…"] * left_out]).strip()


def parameters(effect: Effect) -> str:
    """Write a table of what has to be known of an effect."""
    rows = [
        f"| `{one.name}` | {one.unit if one.unit != '1' else ''} | {one.null:g} | {one.scale:g}"
        f" | {cell(escaped(one.meaning))} |"
        for one in effect.parameters
    ]
    head = "| parameter | unit | absent at | typical size | meaning |"
    return "\n".join([head, "|---|---|---|---|---|", *rows])
