"""`terrain-est report INPUT… -o FILE.html`."""

from functools import partial
from typing import Any

import click

from terrain_cli.commands import comparison_options, options, paths
from terrain_cli.presentation.terminal import Progress, put


@options.verb(
    "report",
    "terrain-est report run.bag -o run.html",
    "terrain-est report day1/*.mcap --model model.toml -o day1.html",
    'terrain-est report bench.csv --segments none --where "slip_angle_deg == 0" -o bench.html',
)
@options.inputs
@options.value(
    "-o --output FILE.html", paths.PAGE, "Write the page here; - is the standard output.", required=True
)
@options.rover
@options.value(
    "--model FILE|linear|wong-reece",
    paths.MODEL,
    "Model of wheel and soil: a base, or a model file that adds effects to one.",
    default="wong-reece",
    show_default=True,
)
@options.wheel
@options.value(
    "--candidates N",
    click.IntRange(0, 10),
    "Where the model lacks an effect, also fit the N likeliest ones, to choose from on the page.",
    default=3,
    show_default=True,
)
@comparison_options.cutting
@comparison_options.soils
@options.force
@options.quiet
@click.pass_context
def command(context: click.Context, /, **_: Any) -> None:
    """Write one page of HTML: errors, the soil on a map, the misfit, and where the model fails.

    INPUT is a file (CSV, Parquet, ROS 1 or ROS 2 bag), a folder, a pattern, or - for the standard
    input. On the page, a reader can switch between the model, its earlier steps and the likeliest
    further effects. The page needs no network and no other file, and can be printed. It needs the extra
    "report"; where that is missing, the command says how to add it.
    """
    from terrain_cli import models
    from terrain_cli.estimation.estimate_request import estimate_beside
    from terrain_cli.improvement import compared
    from terrain_cli.improvement.change_trial import alternatives
    from terrain_cli.processes import cores, jobs
    from terrain_cli.views import report

    given = context.params
    file = models.resolve(given["model"])
    with Progress(len(given["inputs"]) + 2, enabled=not given["quiet"]) as progress:
        cut = comparison_options.read(context, [file], progress, noted=False)
        tell = partial(progress.say, str(file.path or file.model.base))
        soils = comparison_options.asked(given, cut, file)
        answer = estimate_beside([soils]) if cores() > 1 else lambda: None
        comparison = compared(cut, file, soils=soils, seed=given["seed"], progress=tell)
        with jobs(cores()):
            choices = alternatives(
                cut, file, comparison, candidates=given["candidates"], seed=given["seed"], progress=tell
            )
        progress.advance()
        answer()
        say = partial(progress.say, given["output"])
        parts: dict[str, Any] = {"models": choices, "further": [report.history(file.history)]}
        parts |= {"asked": comparison_options.repeated(context, given["model"]), "progress": say}
        text = report.page(comparison, **parts)
    put(text, given["output"])
