"""`terrain-est compare INPUT…`."""

from functools import partial
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import comparison_options, options, paths
from terrain_cli.errors import UsageError
from terrain_cli.presentation.terminal import Progress, say

if TYPE_CHECKING:
    from terrain_cli.comparison import Comparison


@options.verb(
    "compare",
    "terrain-est compare run.bag",
    "terrain-est compare day1/*.mcap --model model.toml --json > misfit.json",
    "terrain-est compare run.bag --model wong-reece --model model.toml",
    'terrain-est compare bench.csv --segments none --where "slip_angle_deg == 0"',
    "terrain-est compare run.bag --plot pictures",
)
@options.inputs
@options.rover
@options.value(
    "--model models FILE|linear|wong-reece",
    paths.MODEL,
    "Model of wheel and soil: a base, or a model file that adds effects to one. "
    "Given twice, two models side by side on the same blocks.  [wong-reece]",
    multiple=True,
    envvar="TERRAIN_EST_MODEL",
    default=("wong-reece",),
)
@options.wheel
@comparison_options.cutting
@comparison_options.soils
@options.as_json
@options.plot("Write pictures into this folder, as PNG and SVG, of the last model (extra: plot).")
@options.quiet
@click.pass_context
def command(context: click.Context, /, **_: Any) -> None:
    """Compare what a model predicts with what was measured, and say where it fails.

    Torque, drawbar pull and sinkage are compared, whichever are there; torque is not required. The
    model is fitted to each segment; the held-out error is the error on stretches of the data
    that were left out of the fit. The last line says what to do next.
    """
    from terrain_cli import models
    from terrain_cli.comparison import against
    from terrain_cli.improvement import compared
    from terrain_cli.presentation import comparison_text

    given = context.params
    names = given["models"]
    if len(names) > 2:
        raise UsageError(
            f"--model is given {len(names)} times", hint="give it once, or twice to compare two models"
        )
    files = [models.resolve(name) for name in names]
    with Progress(len(given["inputs"]) + len(files), enabled=not given["quiet"]) as progress:
        cut = comparison_options.read(context, files, progress)
        outcomes: list[Comparison] = []
        for file in files:
            like = outcomes[0] if outcomes else None
            tell = partial(progress.say, str(file.path or file.model.base))
            soils = comparison_options.asked(given, cut, file)
            outcomes.append(compared(cut, file, like=like, soils=soils, seed=given["seed"], progress=tell))
            progress.advance()
    first, second = outcomes[0], outcomes[1] if len(outcomes) > 1 else None
    differences = against(first, second) if second else []
    asked = [comparison_options.repeated(context, name) for name in names]
    form = comparison_text.document if given["as_json"] else comparison_text.text
    say(form(first, second, differences, asked))
    if given["plot"]:
        comparison_options.draw(outcomes[-1], given)
