"""`terrain-est diagnose INPUT…`."""

from dataclasses import replace
from functools import partial
from typing import Any

import click

from terrain_cli.commands import comparison_options, options, paths
from terrain_cli.presentation.terminal import Progress, put, say


@options.verb(
    "diagnose",
    "terrain-est diagnose run.bag",
    "terrain-est diagnose day1/*.mcap --model model.toml --json > diagnosis.json",
    "terrain-est diagnose run.csv --effect cable-drag.toml",
    "terrain-est diagnose run.csv --draft law.toml",
    "terrain-est diagnose run.csv --keep-aside 0.5",
    "terrain-est diagnose run.csv --plot pictures",
)
@options.inputs
@options.rover
@options.value(
    "--model FILE|linear|wong-reece",
    paths.MODEL,
    "Model that may lack something: a base, or a model file.  [wong-reece]",
    envvar="TERRAIN_EST_MODEL",
    default="wong-reece",
)
@options.value(
    "--effect further FILE.toml",
    paths.EFFECT_FILE,
    "An effect of your own that may be missing, beside those of the catalogue (repeatable).",
    multiple=True,
    envvar="TERRAIN_EST_EFFECT",
)
@options.value(
    "--draft FILE.toml",
    paths.OUTPUT,
    "Write a law here if no effect of the catalogue explains what is missing.",
)
@click.option("--force", is_flag=True, help="Replace the file of --draft if it is there.")
@options.value(
    "--smallest-share SHARE",
    options.Amount(0, 1),
    "Raise no alarm for what is less than this share of the root mean square of every channel.  [0.003]",
)
@comparison_options.keep_aside
@options.wheel
@comparison_options.cutting
@options.as_json
@options.plot("Write a picture of the candidates into this folder, as PNG and SVG (extra: plot).")
@options.quiet
@click.pass_context
def command(context: click.Context, /, **_: Any) -> None:
    """Find out which physical effect a model lacks: its name, or those that the data cannot tell apart.

    Each effect of the catalogue, and of --effect, is scored. Those that may explain the misfit are
    fitted together with the soil, and judged by their error on stretches of the data that were left out.
    diagnose names one effect only if this drive rules out all others. Otherwise it names the effects
    that remain and the drive that tells them apart, or two effects that explain the misfit only
    together. Inputs of the same wheel are joined. The first scores, before any fit, are on stderr. Exit
    code 0 whatever is found. See docs/diagnose.md.
    """
    import formats
    from terrain_cli import effects, models
    from terrain_cli.comparison import kept_aside
    from terrain_cli.diagnosis import diagnose, verdict
    from terrain_cli.presentation import diagnosis_text

    given = context.params
    if given["draft"]:
        formats.check_free(given["draft"], replace=given["force"])
    file = models.resolve(given["model"])
    own = [models.find_effect(name) for name in given["further"]]
    candidates = {**effects.catalogue(), **{effect.id: effect for effect in own}}
    with Progress(len(given["inputs"]) + 1, enabled=not given["quiet"]) as progress:
        cut = comparison_options.read(context, [file], progress)
        found = diagnose(
            kept_aside.seen(cut),
            file,
            effects=list(candidates.values()),
            seed=given["seed"],
            smallest_share=given["smallest_share"],
            progress=partial(progress.say, str(file.path or file.model.base)),
            early=lambda scored: progress.tell(diagnosis_text.early(scored)),
        )
        progress.advance()
    if given["draft"] and found.unknown is not None:
        put(found.unknown.draft, given["draft"])
        found = replace(found, sentence=verdict.with_draft(found.sentence, given["draft"]))
    asked = comparison_options.repeated(context, given["model"])
    form = diagnosis_text.document if given["as_json"] else diagnosis_text.text
    say(form(found, asked, given["draft"] or ""))
    comparison_options.draw(found, given)
    if given["draft"] and found.unknown is None:
        click.echo(f"{given['draft']}: not written, since no law was drafted", err=True)
    elif given["draft"] and not given["quiet"]:
        click.echo(f"{given['draft']}: the law is written", err=True)
