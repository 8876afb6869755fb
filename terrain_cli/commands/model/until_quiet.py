"""`terrain-est model add FILE --until-quiet --data INPUT…`."""

from __future__ import annotations

import os
import tomllib
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from terrain_cli.commands import comparison_options
from terrain_cli.commands.model import change_options
from terrain_cli.presentation.terminal import say

if TYPE_CHECKING:
    from collections.abc import Iterator

    import click

    from terrain_cli.diagnosis.diagnosis_outcome import UnknownEffect
    from terrain_cli.improvement import Step, Stopped


def run(context: click.Context) -> None:
    """Run the loop on the data of the command line, tell each step, and write the model file at its end."""
    from terrain_cli.improvement import Stopped, model_history
    from terrain_cli.presentation import change_sentences, change_text

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
                say(f"{len(steps)}. {change_sentences.tried(event)}")
    finally:
        if drafts:
            drafts.tidy(end.file.effects if end else ())
    assert end is not None  # noqa: S101 - the last that the loop yields
    kept = [step for step in steps if step.kept]
    if kept:
        entries = [
            model_history.entry(
                step, "; ".join(["--until-quiet", change_sentences.found(step), *_doubt(step)])
            )
            for step in kept
        ]
        change_options.write(given["file"], end.file, *entries)
    if steps and not given["as_json"]:
        say()
    asked = comparison_options.repeated(context, given["file"])
    change_options.tell(
        context, change_text.loop_text(steps, end, asked), change_text.loop(steps, end, asked)
    )


def _doubt(step: Step) -> list[str]:
    from terrain_cli.presentation import change_sentences

    return [change_sentences.doubt(step)] if step.rivals else []


def _events(context: click.Context, drafts: _Drafts | None) -> Iterator[Step | Stopped]:
    """Yield what the loop does, with the progress shown only while it works."""
    from terrain_cli import effects, models
    from terrain_cli.commands.progress import Progress
    from terrain_cli.diagnosis import diagnose
    from terrain_cli.improvement import until_quiet

    given = context.params
    file = change_options.load(given["file"])
    folder = Path(given["file"]).parent
    names = models.named_from(given["effects"], folder)
    own = {models.find_effect(name, folder).id: name for name in names}
    candidates = effects.catalogue() | {key: models.find_effect(name, folder) for key, name in own.items()}
    bar = Progress(1, enabled=False)

    def say(step: str) -> None:
        bar.say(given["file"], step)

    with Progress(len(given["inputs"]), enabled=not given["quiet"]) as reading:
        cut = comparison_options.read(context, [file], reading)
    loop = until_quiet(
        cut,
        file,
        diagnose=partial(diagnose, effects=list(candidates.values()), seed=given["seed"], progress=say),
        draft=drafts.write if drafts else None,
        paths=own,
        seed=given["seed"],
        progress=say,
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
        import formats
        from formats.output.whole_files import explained

        name = self.where
        if name.suffix != ".toml":
            with explained(str(name)):
                name.mkdir(parents=True, exist_ok=True)
            name = name / f"{tomllib.loads(unknown.draft)['id']}.toml"
        free = next(path for path in _numbered(name) if not path.exists())
        with formats.replacing(str(free)) as temporary:
            Path(temporary).write_text(unknown.draft, encoding="utf-8")
        self.written.append(free)
        return os.path.relpath(free, self.folder)

    def tidy(self, kept: tuple[str, ...]) -> None:
        """Remove the drafts that did not pay."""
        for path in self.written:
            if os.path.relpath(path, self.folder) not in kept:
                path.unlink(missing_ok=True)


def _numbered(path: Path) -> Iterator[Path]:
    yield path
    for number in range(2, 10_000):
        yield path.with_stem(f"{path.stem}-{number}")
