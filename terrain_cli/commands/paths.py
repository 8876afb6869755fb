"""Types of options that name files, and the checks that no output overwrites an input, or a file of another.

Every option that names a file has one of the types below. `Verb` compares what they name before the
work begins: by what the files are, not by their names, so that a link to an input is that input.
"""

import os
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from importlib import import_module
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import click
from click.shell_completion import CompletionItem

from terrain_cli.commands import named_files
from terrain_cli.commands.named_files import Sign, content, identity, logs_of, resolved, text
from terrain_cli.errors import UsageError
from terrain_cli.vocabulary.choices import BASES

#: Names of the standard output, of which there is one for all that is written.
_STANDARD_OUTPUT = frozenset({"-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"})
_STREAM = "standard output"
_INPUT, _EFFECT_FILE = "the input", "the effect file"


class Read(NamedTuple):
    """A file that a command reads."""

    what: str
    path: str

    def __str__(self) -> str:
        return "standard input" if self.path == "-" else f"{self.what} {text(self.path)}"


class Named(click.Path):
    """The name of a file or folder. What is wrong with one is told by whoever opens it."""

    def __init__(
        self,
        reads: Callable[[str], Iterable[Read]] = lambda _: (),
        known: Callable[[], Iterable[str]] = tuple,
    ) -> None:
        super().__init__(readable=False, allow_dash=True)
        #: The files that are read because of a name; and names that stand for no file.
        self.reads, self.known = reads, known

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[Any]:
        # bash forgets what comes before a file.
        return super().shell_complete(ctx, param, incomplete) + [
            CompletionItem(name) for name in self.known() if name.startswith(incomplete)
        ]


def _logs(what: str) -> Callable[[str], Iterable[Read]]:
    """Return what reads logs, or a table that is read as one: files, folders and patterns."""

    def reads(name: str) -> Iterable[Read]:
        from formats.source import parts

        return (Read(what, part) for log in logs_of(name) for part in parts(log))

    return reads


def names_in(module: str, table: str) -> Callable[..., Iterable[str]]:
    """Return what finds the names in a table of a module, which is imported only then."""
    return lambda *_: getattr(import_module(f"terrain_cli.{module}"), table)


def _effect(name: str) -> Iterator[Read]:
    from terrain_cli import models

    names = dict.fromkeys((name, name.rpartition(":")[0]))
    yield from (Read(_EFFECT_FILE, one) for one in names if models.is_path(one))


def _effects(name: str) -> Iterator[Read]:
    """Yield the effect files that a model, or a drive, names."""
    from terrain_cli import models

    for effect in content(name).get("effects") or ():
        if isinstance(effect, str) and models.is_path(effect):
            yield Read(_EFFECT_FILE, str(Path(name).parent / effect))


def _model(name: str) -> Iterator[Read]:
    """Yield a model file, which a base is not, and the effect files that it names."""
    if name not in BASES:
        yield Read("the model file", name)
        yield from _effects(name)


def _drive(name: str) -> Iterator[Read]:
    """Yield the file of a drive to simulate, with the model and the effects that it names."""
    yield Read("the file of the drive", name)
    yield from _effects(name)
    model = content(name).get("model")
    if isinstance(model, str):
        yield from _model(model if model in BASES else str(Path(name).parent / model))


class Writes(Named):
    """A file that is written.

    A result takes what else goes to the standard output, a layer may share a file with another layer, and a
    model file that is changed is read and written back where it lies. A file that is there and lacks the
    `sign` is of others; of an output without one, the command itself checks what it would replace.
    """

    def __init__(
        self,
        sign: Sign | None = None,
        *,
        result: bool = False,
        layer: bool = False,
        changed: bool = False,
        drafts: bool = False,  # Without the ending of an effect file it is a folder for several
    ) -> None:
        super().__init__(_effects if changed else lambda _: ())
        self.sign, self.result, self.layer, self.changed, self.drafts = sign, result, layer, changed, drafts

    def replaced(self, name: str) -> Iterator[str]:
        """Yield the files that are there no more, or are others, once it is written."""
        yield name

    def signed(self, name: str) -> Iterator[tuple[str, Sign]]:
        """Yield the names under which results are written, and what shows that a file there is one."""
        if self.sign:
            yield name, self.sign

    def holds(self, name: str, file: str) -> bool:  # noqa: ARG002 - a file holds no other
        """Tell whether another file has a name that may be written."""
        return False


class _Folder(Writes):
    """A folder in which files are written under names that nobody gives."""


class _Pictures(_Folder):
    _ENDINGS = (".png", ".svg")

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name, if what draws is installed: before the work, not after it."""
        from terrain_cli.views import chart_style

        chart_style.need("plot")
        return super().convert(value, param, ctx)

    def replaced(self, name: str) -> Iterator[str]:
        """Yield the folder, and the pictures in it: any of them may be drawn again."""
        yield from (name, *(str(path) for path in named_files.files(name) if path.suffix in self._ENDINGS))

    def holds(self, name: str, file: str) -> bool:
        """Tell whether a file has the name of a picture in the folder."""
        path = resolved(file)
        return path.suffix in self._ENDINGS and identity(str(path.parent)) == identity(name)

    def signed(self, name: str) -> Iterator[tuple[str, Sign]]:
        own = (path for path in named_files.files(name) if named_files.PICTURES.fullmatch(path.name))
        yield from ((str(path), named_files.PICTURE) for path in own)


class _Batch(_Folder):
    def replaced(self, name: str) -> Iterator[str]:
        """Yield the folder, and what a batch adds to: all else it replaces by name, links and all."""
        from terrain_cli.batch.batch_folder import GROWING

        yield from (name, *(str(Path(name, file)) for file in GROWING))

    def holds(self, name: str, file: str) -> bool:
        from terrain_cli.batch.batch_folder import belongs

        return belongs(resolved(name), file)

    def signed(self, name: str) -> Iterator[tuple[str, Sign]]:
        from terrain_cli.batch.batch_folder import MANIFEST, is_batch
        from terrain_cli.batch.batch_run import SUMMARY, TABLE

        signs = {SUMMARY: named_files.SUMMARY, MANIFEST: named_files.MANIFEST}
        for path in () if is_batch(name) else named_files.files(name):
            sign = named_files.SEGMENTS if path.stem == TABLE else signs.get(path.name)
            if sign:
                yield str(path), sign


class _Write(NamedTuple):
    """An output of a command: the option, its type, and what it names."""

    option: str
    kind: Writes
    path: str

    def __str__(self) -> str:
        return _STREAM if self.path == "-" else f"{self.option} {text(self.path)}"

    @property
    def standard(self) -> bool:
        """Whether it is the standard output."""
        return self.path in _STANDARD_OUTPUT and not isinstance(self.kind, _Folder)

    @property
    def identities(self) -> set[Hashable]:
        """The files that are replaced, each as the file system tells it from others."""
        names = ["/dev/fd/1"] if self.standard else self.kind.replaced(self.path)
        return {identity(name) for name in names} - {None}

    @property
    def stream(self) -> bool:
        """Whether it is what this process has open already."""
        from formats.output.whole_files import is_stream

        return self.standard or is_stream(self.path)

    @property
    def places(self) -> set[Hashable]:
        """Where no other output may go; other streams than this one may well be one."""
        if self.standard:
            return {_STREAM, *self.identities}
        return set() if self.stream else self.identities


INPUT = Named(_logs(_INPUT))
ROVER = Named(lambda name: (Read("the rover file", name),))
PLACES = Named(_logs("the localisation table"))
MODEL = Named(_model, lambda: BASES)
# An id, or a file; `simulate` lets values follow.
EFFECT = Named(_effect, names_in("effects", "NAMES"))
# In the environment a space stands between two: there may be a colon in one.
EFFECT.envvar_list_splitter = None  # type: ignore[misc,assignment]
EFFECT_FILE = Named(lambda name: (Read(_EFFECT_FILE, name),))
DRIVE = Named(_drive)
OUTPUT = Writes()
RESULT = Writes(result=True)
SEGMENTS = Writes(named_files.SEGMENTS, result=True, layer=True)
SAMPLES = Writes(named_files.SAMPLES, layer=True)
REJECTS = Writes(named_files.REJECTS)
TRACE = Writes(named_files.TRACE)
POSTERIOR = Writes(named_files.POSTERIOR)
SUMMARY = Writes(named_files.SUMMARY)
PAGE = Writes(named_files.PAGE, result=True)
CHANGED = Writes(changed=True)
DRAFTS = Writes(drafts=True)
PICTURES = _Pictures()
BATCH = _Batch(result=True)


class Verb(click.Command):
    """A command that does not begin where an output is one of its inputs, or another output."""

    def invoke(self, ctx: click.Context) -> Any:
        check(ctx)
        if not _takes_rover(ctx):
            check_others(ctx)
        return super().invoke(ctx)


def check(context: click.Context) -> None:
    """Refuse to write onto what is read, and to write two outputs into one file."""
    writes = list(_writes(context))
    # No file has a NUL in its name; what a model file names may.
    reads = [(read, identity(read.path)) for read in _reads(context) if "\0" not in read.path]
    several = [n for _, kind, n in _named(context) if kind in {INPUT, PLACES} and not os.path.isfile(n)]  # noqa: PTH113
    for write in writes:
        _check_reads(write, reads)
        if not write.standard and not write.kind.changed:
            _check_folders(write, several)
    for first, second in combinations(writes, 2):
        _check_pair(first, second)


def check_others(context: click.Context) -> None:
    """Refuse what cannot be written, and without --force to replace what is no earlier result of the kind.

    A command that takes a rover file calls this once it knows what that names: an input is told first.
    """
    from formats import CannotWriteError, check_free

    for write in _writes(context):
        if write.stream:
            continue
        folder = isinstance(write.kind, _Folder)
        made = folder or (write.kind.drafts and not write.path.endswith(".toml"))
        check_free(write.path, replace=True, folder=made)
        if context.params.get("force") and not folder:
            continue
        for name, sign in write.kind.signed(write.path):
            file = str(resolved(name))
            if os.path.isfile(file) and not sign.on(file):  # noqa: PTH113 - Path may raise
                hint = "name another folder, or move it away" if folder else "--force replaces it"
                raise CannotWriteError(
                    name, "is there already, and is no earlier result of this kind", hint=hint
                )


def _named(context: click.Context) -> Iterator[tuple[str, Any, str]]:
    """Yield each name of a file that a command was given, with its option and the type of that."""
    for parameter in context.command.params:
        if isinstance(parameter.type, Named):
            value = context.params.get(parameter.name or "")
            option = parameter.opts[0] if isinstance(parameter, click.Option) else parameter.metavar
            for name in value if isinstance(value, tuple) else (value,):
                if name:
                    yield option or "", parameter.type, name


def _reads(context: click.Context) -> Iterator[Read]:
    named = list(_named(context))
    for _, kind, name in named:
        yield from kind.reads(name)
    if _takes_rover(context) and not any(kind is ROVER for _, kind, _ in named):
        from terrain_cli import rover

        first = next((log for _, kind, name in named if kind is INPUT for log in logs_of(name)), None)
        if found := rover.find(None, first):
            yield from ROVER.reads(str(found))


def _takes_rover(context: click.Context) -> bool:
    return any(parameter.type is ROVER for parameter in context.command.params)


def _writes(context: click.Context) -> Iterator[_Write]:
    given = [_Write(*named) for named in _named(context) if isinstance(named[1], Writes)]
    if not any(write.kind.result for write in given):
        yield _Write("the result", RESULT, "-")
    yield from given


def _check_reads(write: _Write, reads: Sequence[tuple[Read, Hashable]]) -> None:
    replaced, kind = write.identities, write.kind
    for read, known in reads:
        onto = known in replaced or kind.holds(write.path, read.path)
        if onto and not (read.what == _INPUT and _skips(write, read.path)):
            raise UsageError(
                f"{write} would be written onto {read}",
                hint="a command never writes onto what it reads: name another file",
            )


def _check_folders(write: _Write, names: Sequence[str]) -> None:
    """Refuse what would become part of a log, or a log of its own when the command is run again."""
    from formats.source import parts, takes

    place = resolved(write.path)
    above = {identity(str(folder)) for folder in (place, *place.parents)}
    for name in names:
        logs = logs_of(name)
        for log in filter(os.path.isdir, logs):
            folders = {log, *map(os.path.dirname, parts(log))}
            if not above.isdisjoint(map(identity, folders)) and not _skips(write, log):
                raise UsageError(
                    f"{write} lies in {text(log)}, a folder that is one log",
                    hint="nothing is written into a log: name a place outside",
                )
        if logs and not isinstance(write.kind, _Folder) and takes(name, write.path):
            raise UsageError(
                f"{write} would be read as an input in the next run: {text(name)} includes it",
                hint="name a file in another folder",
            )


def _skips(write: _Write, file: str) -> bool:
    """Tell whether an input is not read, as it is a result of an earlier run into the folder of a batch."""
    from terrain_cli.batch.batch_folder import is_batch

    return isinstance(write.kind, _Batch) and is_batch(write.path) and write.kind.holds(write.path, file)


def _check_pair(first: _Write, second: _Write) -> None:
    from terrain_cli.presentation import segment_files

    one = first.places & second.places
    if not (one or first.kind.holds(first.path, second.path) or second.kind.holds(second.path, first.path)):
        return
    layers = first.kind.layer and second.kind.layer
    if layers and segment_files.together(first.path, second.path):
        return
    where = "standard output" if _STREAM in one else text(second.path)
    raise UsageError(
        f"{first.option} and {second.option} both go to {where}",
        hint="only a .gpkg holds both, as two layers" if layers else "give each a file of its own",
    )
