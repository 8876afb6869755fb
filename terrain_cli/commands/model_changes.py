"""`terrain-est model add FILE EFFECT… [--data INPUT…]`, its loop `--until-quiet`, and what remove shares."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import comparison_options, options, paths
from terrain_cli.errors import UsageError
from terrain_cli.presentation.terminal import Progress, put, say
from terrain_cli.vocabulary.choices import BASES

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from terrain_cli.diagnosis.diagnosis_outcome import UnknownEffect
    from terrain_cli.improvement import Step, Stopped
    from terrain_cli.improvement.improvement_outcome import Action
    from terrain_cli.models import Changed, ModelFile


class TakesInputs(paths.Verb):
    """A command whose --data takes all that follows, up to the next option."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat --data before each of its inputs, as click wants it."""
        spread: list[str] = []
        inside = False
        for word in args:
            option = word.startswith("-") and word != "-"
            if option:
                inside = word == "--data" or word.startswith("--data=")
            elif inside and spread[-1] != "--data":
                spread.append("--data")
            spread.append(word)
        return super().parse_args(ctx, spread)


#: Options of a change that is tried on data.
with_options = options.together(
    options.value(
        "--data inputs INPUT…",
        paths.INPUT,
        "Try it on these: files (CSV, Parquet, ROS 1 or ROS 2 bag), folders, patterns, or - for the "
        "standard input. Takes all that follows, up to the next option.",
        multiple=True,
        envvar="TERRAIN_EST_DATA",
    ),
    options.rover,
    options.wheel,
    comparison_options.cutting,
    options.as_json,
    options.quiet,
)


def load(path: str) -> ModelFile:
    """Read the model file that is to be changed, which is not the name of a base."""
    from terrain_cli import models

    if path in BASES and not Path(path).exists():
        raise UsageError(
            f"{path} is a base, not a file", hint=f"terrain-est model new model.toml --base {path}"
        )
    return models.load(path) if Path(path).exists() else models.resolve(path)


def change(context: click.Context, action: Action) -> None:
    """Change a model file as asked: tried on data where there are some, and then kept if it is worth it."""
    import formats
    from terrain_cli import models
    from terrain_cli.improvement import model_history
    from terrain_cli.presentation import change_text

    given = context.params
    before = load(given["file"])
    names = models.named_from(given["effects"], Path(given["file"]).parent)
    modulus = 0.0
    if models.ASSUMPTIONS.keys() & set(names):
        # The k of the data, or beside the model file where there are none.
        logs = formats.expand(given["inputs"]) if given["inputs"] else [given["file"]]
        modulus = options.load_rover(given["rover"], logs).soil_shear_modulus()
    changed = (models.added if action == "add" else models.removed)(before, names, modulus)
    if not given["inputs"]:
        entry = model_history.untested(action, changed.ids, changed.file)
        told = change_text.untested(entry)
        _write(given["file"], changed.file, entry)
        _tell(context, told["sentence"], told)
        return
    step = _tried(context, action, before, changed, given["inputs"])
    if given.get("confirm") and step.pays:
        chosen = changed._replace(file=step.after)
        step = replace(step, confirmation=_tried(context, action, before, chosen, given["confirm"]))
    asked_for = action == "remove" or given["keep"]
    step = replace(step, kept=(step.pays and step.confirmed) or asked_for)
    if step.kept:
        _write(given["file"], step.after, model_history.entry(step, change_text.reason(step)))
    asked = comparison_options.repeated(context, given["file"])
    _tell(context, change_text.text(step, asked), change_text.document(step, asked))


def _tried(
    context: click.Context, action: Action, before: ModelFile, changed: Changed, inputs: Sequence[str]
) -> Step:
    """Try a change on data; it is not kept."""
    from terrain_cli import improvement
    from terrain_cli.processes import cores

    given = context.params
    with Progress(len(inputs) + 1, enabled=not given["quiet"]) as progress:
        cut = comparison_options.read(context, [before, changed.file], progress, inputs)
        return improvement.tried_in_forms(
            cut,
            action,
            changed,
            before,
            seed=given["seed"],
            progress=partial(progress.say, given["file"]),
            beside=cores() > 1,
        )


def _tell(context: click.Context, text: str, content: Mapping[str, Any]) -> None:
    file = context.params["file"]
    say({**content, "file": file} if context.params["as_json"] else f"{file}: {text}")


def _write(path: str, after: ModelFile, *entries: Mapping[str, Any]) -> None:
    """Write a model file with further entries of its history, whole or not at all."""
    from terrain_cli import models

    for entry in entries:
        after = models.recorded(after, entry)
    models.save(after, path)


@options.verb(
    "add",
    "terrain-est model add model.toml slip-sinkage --data day1/*.mcap",
    "terrain-est model add model.toml cable-drag.toml --data run.bag --json > change.json",
    "terrain-est model add model.toml slip-sinkage --data monday.csv --confirm tuesday.csv",
    "terrain-est model add model.toml slip-sinkage --data run.csv --keep-aside 0.5",
    "terrain-est model add model.toml load-bias slope --data run.csv --segments none --keep",
    "terrain-est model add model.toml --until-quiet --data run.bag",
    "terrain-est model add model.toml hardpan",
    cls=TakesInputs,
    short_help="Add an effect, if it makes the held-out error fall.",
)
@click.argument("file", type=paths.CHANGED, metavar="FILE")
@click.argument("effects", nargs=-1, type=paths.EFFECT, metavar="[EFFECT…]")
@options.value(
    "--confirm INPUT",
    paths.INPUT,
    "Another drive, which did not choose the effect (repeatable): FILE gets the effect only if the "
    "held-out error falls there too.",
    multiple=True,
)
@comparison_options.keep_aside
@click.option("--keep", is_flag=True, help="Add it even if the held-out error does not fall.")
@click.option(
    "--until-quiet",
    is_flag=True,
    help="Let the data choose: diagnose and add effects in turn, until the data show no missing effect. "
    "EFFECT… are then candidates beside the catalogue.",
)
@options.value(
    "--draft FILE.toml|DIR",
    paths.DRAFTS,
    "With --until-quiet: where to write a law for what no candidate explains, to try it.  [stop there]",
)
@with_options
@click.pass_context
def add(context: click.Context, /, **_: Any) -> None:
    """Add each EFFECT to the model FILE, if that makes the error on held-out data fall.

    EFFECT is an id of the catalogue (terrain-est effects list), the TOML file of an effect of your own
    or of a draft, or an assumption of the base, which is then removed. With --data the model is fitted
    without and with it, and both are compared on stretches of the data that were left out of the fit.
    Several are added together. FILE gets the effect and an entry of its history, which says what
    judged the effect: data that may have chosen it, stretches that were kept aside (--keep-aside), or
    another drive (--confirm).

    FILE is left as it is, unless --keep is given, if the held-out error falls significantly in no
    channel, rises in one by more than it falls in others, or falls only with a parameter that is
    physically impossible (friction that drives the wheel). The reason is printed; the exit code is 0.
    Without --data the effect is added untested, which the history says too.
    """
    given = context.params
    if given["confirm"]:
        _check_confirm(given)
    if given["keep_aside"] is not None and not given["inputs"]:
        raise UsageError("--keep-aside needs --data", hint="the share is taken from the inputs of --data")
    if given["until_quiet"]:
        if not given["inputs"]:
            raise UsageError("--until-quiet needs --data", hint="add --data with one input or several")
        if given["keep"]:
            raise UsageError("--keep and --until-quiet contradict each other", hint="leave out one of them")
        _until_quiet(context)
        return
    if not given["effects"]:
        raise UsageError(
            "model add: no EFFECT is given",
            hint="terrain-est effects list shows all of them; with --until-quiet the data choose",
        )
    if given["draft"]:
        raise UsageError("--draft is for --until-quiet", hint="a draft is added by its file name")
    change(context, "add")


def _check_confirm(given: Mapping[str, Any]) -> None:
    """Refuse a proof that is none: no data to compare with, or the same data."""
    import formats

    if not given["inputs"]:
        raise UsageError(
            "--confirm needs --data", hint="give with --data the drive on which the effect was named"
        )
    if given["keep_aside"] is not None:
        raise UsageError("--confirm and --keep-aside exclude each other", hint="give one of them")
    if given["until_quiet"]:
        raise UsageError(
            "--confirm needs an EFFECT, and --until-quiet has none yet",
            hint="let --until-quiet choose first, then add what it chose to a new model with --confirm",
        )
    data = {Path(path).resolve() for path in formats.expand(given["inputs"])}
    for path in formats.expand(given["confirm"]):
        if Path(path).resolve() in data:
            raise UsageError(f"--confirm {path} is also an input of --data", hint="name another drive")


def _until_quiet(context: click.Context) -> None:
    """Run the loop on the data of the command line, tell each step, and write the model file at its end."""
    from terrain_cli.improvement import Stopped, model_history
    from terrain_cli.presentation import change_text, comparison_text

    given = context.params
    drafts = _Drafts(given["draft"], given["file"]) if given["draft"] else None
    steps: list[Step] = []
    end: Stopped | None = None
    try:
        for event in _events(context, drafts):
            if isinstance(event, Stopped):
                end = event
                continue
            steps.append(event)
            if not given["as_json"]:
                say(f"{len(steps)}. {change_text.tried(event)}")
    finally:
        if drafts:
            drafts.tidy(end.file.effects if end else ())
    assert end is not None  # noqa: S101 - the last that the loop yields
    entries = [
        model_history.entry(step, f"--until-quiet; {change_text.found(step)}{doubt}")
        for step in steps
        if step.kept
        for doubt in [f"; {change_text.doubt(step)}" if step.rivals else ""]
    ]
    asked = comparison_options.repeated(context, given["file"])
    ended = comparison_text.conclusion_of(end.evidence, end.comparison, asked).state == "unexplained"
    if ended:
        # What no verb has to propose again for these data.
        entries += [
            model_history.refusal(step, f"--until-quiet; {change_text.found(step)}")
            for step in steps
            if step.action == "add" and not step.kept and step.before.effects == end.file.effects
        ]
        entries.append(model_history.end(end.file, end.comparison, f"--until-quiet; {end.because}"))
    if entries:
        _write(given["file"], end.file, *entries)
    if steps and not given["as_json"]:
        say()
    _tell(context, change_text.loop_text(steps, end, asked), change_text.loop(steps, end, asked))


def _events(context: click.Context, drafts: _Drafts | None) -> Iterator[Step | Stopped]:
    """Yield what the loop does, with the progress shown only while it works."""
    from terrain_cli import effects, models
    from terrain_cli.diagnosis import diagnose
    from terrain_cli.improvement import until_quiet
    from terrain_cli.processes import cores

    given = context.params
    file = load(given["file"])
    folder = Path(given["file"]).parent
    names = models.named_from(given["effects"], folder)
    own = {models.find_effect(name, folder).id: name for name in names}
    candidates = effects.catalogue() | {key: models.find_effect(name, folder) for key, name in own.items()}
    bar = Progress(1, enabled=False)

    def say(step: str) -> None:
        bar.say(given["file"], step)

    with Progress(len(given["inputs"]), enabled=not given["quiet"]) as reading:
        cut = comparison_options.read(context, [file], reading, noted=False)
    loop = until_quiet(
        cut,
        file,
        diagnose=partial(diagnose, effects=list(candidates.values()), seed=given["seed"], progress=say),
        draft=drafts.write if drafts else None,
        paths=own,
        seed=given["seed"],
        progress=say,
        beside=cores() > 1,
    )
    while True:
        bar = Progress(1, enabled=not given["quiet"])
        with bar:
            event = next(loop, None)
        if event is None:
            return
        yield event


class _Drafts:
    """Effect files written on the way."""

    def __init__(self, where: str, model: str) -> None:
        self.where, self.folder = Path(where), Path(model).parent
        self.written: list[Path] = []

    def write(self, unknown: UnknownEffect) -> str:
        """Write a draft under a name that is free, and return its path as the model file has it."""
        from formats.output.whole_files import explained

        name = self.where
        if name.suffix != ".toml":
            with explained(str(name)):
                name.mkdir(parents=True, exist_ok=True)
            name = name / f"{tomllib.loads(unknown.draft)['id']}.toml"
        name = comparison_options.free(name)
        put(unknown.draft, str(name))
        self.written.append(name)
        return os.path.relpath(name, self.folder)

    def tidy(self, kept: tuple[str, ...]) -> None:
        for path in self.written:
            if os.path.relpath(path, self.folder) not in kept:
                path.unlink(missing_ok=True)
