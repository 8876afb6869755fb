"""What workers are sent: an order with the settings that decide on the numbers, and tasks for each input."""

import errno
import json
import platform
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cache, cached_property
from hashlib import sha256
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import Any, Protocol

from formats.errors import CannotWriteError, FormatError, NotFoundError, shown
from formats.limits import COPY_GB
from terrain_cli import effects, estimation, models
from terrain_cli.batch import batch_inputs, manifest
from terrain_cli.batch.batch_inputs import Input
from terrain_cli.errors import TerrainError
from terrain_cli.estimation import estimators
from terrain_cli.models import ModelFile
from terrain_cli.presentation.segment_table import Table
from terrain_cli.rover import Rover
from terrain_cli.run.settings import Settings
from terrain_cli.version import __version__
from terrain_cli.vocabulary import toml_files

FORMAT = "terrain-est/batch-configuration/1"
_LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "rosbags")
#: Asked for before each input; to read what a package says of itself takes longer than a small log.
_installed = cache(version)


@dataclass(frozen=True)
class Configuration:
    """What is the same for all inputs of a batch."""

    rover: Rover
    settings: Settings  # As they were given
    # The model that `settings` name, read once: a file that is changed during a batch changes nothing of it
    model: ModelFile | None
    crs: str | None
    document: dict[str, Any]  # All that decides on the numbers, for JSON

    @cached_property
    def hash(self) -> str:
        """Hash of `document`."""
        return _hash(self.document)

    @cached_property
    def twin(self) -> str:
        """The hash if the answer to --salvage were the other one."""
        options = self.document["options"]
        return _hash({**self.document, "options": {**options, "salvage": not options["salvage"]}})


def gather(rover: Rover, settings: Settings, crs: str | None) -> Configuration:
    """Read all that decides on the numbers."""
    file = estimators.choose(settings.method, settings.model, robust=settings.robust)
    model = None
    if file is not None:
        parts = {name: _effect(name, file) for name in file.effects}
        model = {"base": file.model.base, "text": file.text, "effects": parts}
    document = {
        "format": FORMAT,
        "terrain-est": __version__,
        # A file is told by what it says, not by where it lies.
        "options": {**asdict(replace(settings, model=None, places=None)), "crs": crs},
        "places": settings.places.digest if settings.places else None,
        "rover": toml_files.read_text(rover.path) if rover.path else None,
        "model": model,
    }
    return Configuration(rover, settings, file, crs, document)


def _effect(name: str, file: ModelFile) -> str:
    """Return what an effect is: the text of its file, or the package it comes from."""
    if models.is_path(name):
        folder = file.path.parent if file.path else Path()
        return toml_files.read_text(folder / name)
    if name in effects.NAMES:
        return f"terrain-est {__version__}"
    found = [point.dist for point in entry_points(group=effects.GROUP) if point.dist]
    packages = {dist.name: dist.version for dist in found}
    return ", ".join(f"{package} {number}" for package, number in sorted(packages.items()))


def _hash(document: dict[str, Any]) -> str:
    text = json.dumps(document, sort_keys=True, ensure_ascii=True, allow_nan=False)
    return sha256(text.encode()).hexdigest()[:16]


def versions() -> dict[str, str]:
    """Return the versions of this program and of what it computes with."""
    own = {"terrain-est": __version__, "python": platform.python_version()}
    return own | {name: _installed(name) for name in _LIBRARIES}


def differing(wanted: dict[str, str], there: dict[str, str]) -> str:
    """Say which versions are not those wanted; nothing where all are."""
    odd = [f"{name} {there.get(name)} instead of {v}" for name, v in wanted.items() if there.get(name) != v]
    return f"has {', '.join(odd)}" if odd else ""


@dataclass(frozen=True)
class Failure:
    """Why there is no result."""

    error_class: str
    error: str
    hint: str = ""
    exit_code: int = 1  # What `terrain-est estimate` would have ended with
    passing: bool = False  # It may be gone next time


@dataclass(kw_only=True)
class Reply:
    """What a worker hands back."""

    sha256: str | None = None  # Hash of the content, as far as it was read
    failure: Failure | None = None
    # result, record: the file of the result, and the record for the mission table
    result: bytes = b""
    record: bytes = b""
    told: dict[str, Any] = field(default_factory=dict)  # What a `ManifestEntry` keeps of it as it is
    seconds: float = 0.0


def _told(account: dict[str, Any]) -> dict[str, Any]:
    """Return what there is to tell of the account of an input."""
    wheels, salvage = account["wheels"], account["salvage"]
    told = {
        "samples": sum(wheel["samples"] for wheel in wheels),
        "set_aside": sum(wheel["samples"] - wheel["used"] for wheel in wheels),
        "warnings": list(dict.fromkeys(remark for wheel in wheels for remark in wheel["remarks"])),
    }
    if salvage and (salvage["damage"] or salvage["set_aside"]):
        told |= {"recovered": salvage["fraction"], "recovered_of": salvage["fraction_of"]}
    return told


class Task(Protocol):
    """Something a worker can be sent to do."""

    def run(self) -> Reply: ...  # What it raises is a failure of this task alone


@dataclass(frozen=True, kw_only=True)
class Order:
    """How a batch is to be run: what is the same for all its inputs."""

    configuration: Configuration
    kind: str = "parquet"  # "parquet" or "csv": of the results
    also: tuple[str, ...] = ()  # Further kinds of the mission table
    jobs: int = 1
    scheduler: str | None = None
    timeout: float | None = None  # Seconds that one input may take
    memory: int | None = None  # Bytes that one worker may take
    largest: int = int(COPY_GB * 1e9)  # Bytes that are copied from a store at the most
    force: bool = False  # Do again what is done
    retry_failed: bool = False  # Do again what failed, although nothing has changed
    fail_fast: bool = False
    # To go on taking what arrives: seconds for which an input must have stayed as it is
    settle: float | None = None
    versions: dict[str, str] = field(default_factory=versions)  # Of the keeper


@dataclass(frozen=True)
class Identify:
    """Hash an input whose content may be known already."""

    item: Input
    order: Order

    def run(self) -> Reply:
        started = time.monotonic()
        with opened(self.item, self.order.largest) as path:
            reply = Reply(sha256=batch_inputs.content_hash(path))
        reply.seconds = time.monotonic() - started
        return reply


@dataclass(frozen=True)
class Estimate:
    """Do what `terrain-est estimate` does for one input."""

    item: Input
    order: Order
    sha256: str | None = None

    def run(self) -> Reply:
        """Return its result, or why there is none."""
        reply, started, path = Reply(sha256=self.sha256), time.monotonic(), ""
        try:
            _check_versions(self.order.versions)
            with opened(self.item, self.order.largest) as path:
                reply.sha256 = self.sha256 or batch_inputs.content_hash(path)
                self._estimate(path, reply)
        except Exception as error:  # noqa: BLE001 - one input must not stop the rest
            reply.failure = failure(error, path, self.item.path)
            reply.result = reply.record = b""
        reply.seconds = time.monotonic() - started
        return reply

    def _estimate(self, path: str, reply: Reply) -> None:
        from terrain_cli.run import one_log

        given = self.order.configuration
        # The model itself stands in place of its path.
        settings = given.settings if given.model is None else replace(given.settings, model=given.model)
        outcome = one_log.run(path, given.rover, settings)
        reply.told = _told(outcome.account)
        if outcome.error:
            raise outcome.error
        table = {**outcome.table, "source": [self.item.path] * len(outcome.table["source"])}
        reply.told["segments"] = len(table["source"])
        reply.result = as_file(table, self.order)
        reply.record = manifest.encode(table, estimation.join(outcome.estimates), outcome.account)


@dataclass(frozen=True)
class Restore:
    """Write a result again whose record is there."""

    item: Input
    order: Order
    sha256: str
    record: bytes

    def run(self) -> Reply:
        table, _, account = manifest.decode(self.record, self.item.path)
        told = {**_told(account), "segments": len(table["source"])}
        return Reply(sha256=self.sha256, result=as_file(table, self.order), told=told)


def as_file(table: Table, order: Order) -> bytes:
    """Return the bytes of the file that `terrain-est estimate -o` would write."""
    import formats
    from terrain_cli.presentation import segment_table

    with tempfile.TemporaryDirectory(prefix="terrain-est-") as folder:
        file = Path(folder, f"result.{order.kind}")
        crs = segment_table.reference_system(table, order.configuration.crs)
        formats.write_table(table, str(file), crs=crs)
        return file.read_bytes()


@contextmanager
def opened(item: Input, largest: int) -> Iterator[str]:
    """Give the path of an input, or of a copy of it; it must be what it was when it was found."""
    if batch_inputs.is_address(item.location):
        with batch_inputs.copied(item, largest) as copy:
            yield copy
        return
    batch_inputs.check_unchanged(item)
    yield item.location
    batch_inputs.check_unchanged(item)


def _check_versions(keeper: dict[str, str]) -> None:
    if differ := differing(keeper, versions()):
        raise WorkerDiffersError(f"a worker {differ}", hint="install the same versions everywhere")


class WorkerDiffersError(TerrainError):
    """A worker that joined later runs other versions than the keeper."""


def failure(error: BaseException, path: str = "", label: str = "") -> Failure:
    """Say why a task failed, and name the input not by `path` but by its `label`."""
    name = type(error).__name__
    if _memory_was_short(error):
        what = f"{label}: out of memory" if label else "out of memory"
        hint = "run again with fewer --jobs or more --memory, or cut the input into smaller files"
        return Failure("MemoryError", what, hint, 1, passing=True)
    path = shown(path)
    text = str(error).replace(path, label) if path else str(error)
    if isinstance(error, TerrainError | FormatError):
        hint = error.hint.replace(path, label) if path else error.hint
        passing = isinstance(error, NotFoundError | CannotWriteError | WorkerDiffersError)
        return Failure(name, text, hint, error.exit_code, passing=passing)
    prefix = f"{label}: " if label else ""
    passing = isinstance(error, OSError)
    return Failure(name, f"{prefix}unexpected {name}: {text}", "", 1, passing=passing)


def _memory_was_short(error: BaseException | None) -> bool:
    """Tell whether memory is behind an error, whatever it was turned into on its way."""
    while error is not None:
        if isinstance(error, MemoryError) or (isinstance(error, OSError) and error.errno == errno.ENOMEM):
            return True
        if isinstance(error, RuntimeError) and "can't start new thread" in str(error):
            return True
        error = error.__cause__ or error.__context__
    return False
