"""The folder of a batch: one keeper at a time, every file in it whole or as it was; and what it leaves to do.

manifest.jsonl     one line for each input dealt with
segments.parquet   the mission table: the segments of all inputs
summary.json       the same for people who read that first
results/           one file for each input
configurations/    the options, rover and model files behind the hashes of the manifest
.state/            the lock, the records, and what is being written
"""

from __future__ import annotations

import fcntl
import os
import re
from contextlib import ExitStack, closing
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from formats.errors import CannotWriteError, DamagedError, shown
from formats.output.whole_files import explained
from terrain_cli.batch import manifest
from terrain_cli.batch.manifest import GrowingFile, ManifestEntry, Pointer, Records

if TYPE_CHECKING:
    from terrain_cli.batch.batch_inputs import Input
    from terrain_cli.batch.worker_tasks import Order

MANIFEST, RESULTS, CONFIGURATIONS, STATE = "manifest.jsonl", "results", "configurations", ".state"
_LOCK, _RECORDS, _NEW = "lock", "records", "new"
ASSEMBLED = f"{STATE}/assembled"  # Of what the mission table in the folder was made
#: What is written to where it lies; all else is made anew and put in its place.
GROWING = (MANIFEST, f"{STATE}/{_LOCK}", f"{STATE}/{_RECORDS}")
_STEM_BYTES = 120  # Bytes of an input's own name in that of its result, of the 255 that file systems take


class Folder:
    """The folder of a batch, as the manifest describes it; made and locked only where it is writable."""

    def __init__(self, path: str, *, writable: bool = True) -> None:
        self.path = Path(path)
        self._root = Path(os.path.realpath(path))
        self.state = self.path / STATE
        self.records: Records | None = None
        self._opened = ExitStack()
        self.close = self._opened.close
        if writable:
            self._take()
        entries, size = manifest.entries_of(self.path / MANIFEST)
        self.latest: dict[str, ManifestEntry] = {}
        self.holders: dict[tuple[str, str], str] = {}
        self.kept: dict[tuple[str, str], Pointer] = {}
        for entry in entries:
            self._note(entry)
        if writable:
            self._manifest = self._opened.enter_context(closing(GrowingFile(self.path / MANIFEST, size)))
            pointers = self.kept.values()
            end = max((offset + length for offset, length, _ in pointers), default=0)
            self.records = self._opened.enter_context(closing(Records(self.state / _RECORDS, end)))
            self.kept = {key: kept for key, kept in self.kept.items() if self.records.read(kept)}

    def _take(self) -> None:
        if shown(str(self.path)) != str(self.path):
            raise CannotWriteError(str(self.path), "the folder of a batch needs a path that is text (UTF-8)")
        with explained(str(self.path)):
            self.path.mkdir(parents=True, exist_ok=True)
            for folder in (self.state, self.path / RESULTS, self.path / CONFIGURATIONS):
                if folder.is_symlink():
                    raise CannotWriteError(str(folder), "is a link: a batch writes in its own folder")
                folder.mkdir(exist_ok=True)
            # The lock is the system's, and dies with the process; the file only shows where it is.
            flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC
            lock = os.open(self.state / _LOCK, flags, 0o666)
            self._opened.callback(os.close, lock)
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                holder = os.pread(lock, 32, 0).decode("ascii", "replace").strip()
                self.close()
                what = f"another batch is at work here (process {holder or 'unknown'})"
                hint = "wait for its end, or give another folder with -o"
                raise CannotWriteError(str(self.path), what, hint=hint) from None
            os.ftruncate(lock, 0)
            os.pwrite(lock, f"{os.getpid()}\n".encode(), 0)
            for rest in self.state.iterdir():
                # Half-written files of a process that was killed.
                if rest.name not in {_LOCK, _RECORDS, Path(ASSEMBLED).name} and not rest.is_dir():
                    rest.unlink()

    def _note(self, entry: ManifestEntry) -> None:
        # Taken out, so that the last one written stands last.
        before = self.latest.pop(entry.location, None)
        if before and before.sha256:
            key = before.sha256, before.configuration
            if self.holders.get(key) == entry.location:
                del self.holders[key]
        self.latest[entry.location] = entry
        if entry.sha256 is None:
            return
        key = entry.sha256, entry.configuration
        if entry.status != "duplicate":
            self.holders.setdefault(key, entry.location)
        if entry.record:
            self.kept[key] = entry.record

    def add(self, entry: ManifestEntry) -> None:
        self._manifest.append(entry.line())
        self._note(entry)

    def record(self, key: tuple[str, str]) -> bytes | None:
        """Return what was computed of a content under a configuration; None if there is nothing whole."""
        kept = self.kept.get(key)
        return self.records.read(kept) if kept and self.records else None

    def put(self, name: str, data: bytes) -> None:
        manifest.put(data, self.state / _NEW, self.path / name)

    def remove(self, name: str | None) -> None:
        """Remove a file that is not to be taken for a result any more."""
        # A manifest that someone has changed is not to lead out of the folder.
        if name and re.fullmatch(rf"{RESULTS}/[^/]+", name):
            with explained(str(self.path / name)):
                (self.path / name).unlink(missing_ok=True)

    def has_result(self, entry: ManifestEntry, name: str) -> bool:
        """Tell whether the result of an input is there as it was written, where it belongs."""
        if entry.result != name:
            return False
        try:
            status = (self.path / name).lstat()
        except OSError:
            return False
        return status.st_size == entry.result_bytes

    def own(self, location: str) -> bool:
        """Tell whether a file was written by a batch into this folder, and is no input."""
        return belongs(self._root, location)


def belongs(root: Path, file: str) -> bool:
    """Tell whether a file, or what its links lead to, has a name that a batch into a folder writes."""
    above, own = os.path.split(file)
    itself = Path(os.path.realpath(above), own)
    for place in (itself, Path(os.path.realpath(itself))) if itself.is_symlink() else (itself,):
        if not place.is_relative_to(root):
            continue
        parts = place.relative_to(root).parts
        if parts[:1] and parts[0] in {RESULTS, CONFIGURATIONS, STATE}:
            return True
        if len(parts) == 1 and parts[0].startswith(("segments.", "manifest.", "summary.")):
            return True
    return False


def is_batch(path: str) -> bool:
    return os.path.isfile(Path(path, STATE, _RECORDS))  # noqa: PTH113 - Path may raise


def result_name(location: str, kind: str) -> str:
    """Return where the result of an input belongs, below the folder."""
    # Its own name for people, and a hash of all of its location: none has that of another, or leads out.
    own = location.rstrip("/").rpartition("/")[2]
    readable = re.sub(r"[^\w.+=-]", "_", own, flags=re.ASCII).lstrip(".")[:_STEM_BYTES] or "input"
    digest = sha256(location.encode("utf-8", "surrogateescape")).hexdigest()[:16]
    return f"{RESULTS}/{readable}-{digest}.{kind}"


def reason(item: Input, folder: Folder, order: Order) -> str | None:
    """Say why something is to be done for an input; None if what the manifest says of it still holds."""
    entry = folder.latest.get(item.location)
    if entry is None:
        return "new"
    key = str(entry.sha256), entry.configuration
    failed = entry.status == "failed"
    duplicate = entry.status == "duplicate"
    whole = key in folder.kept and folder.has_result(entry, result_name(item.location, order.kind))
    reasons = (
        ("forced", order.force),
        ("cannot be read", item.problem is not None),
        ("changed", not same(item, entry)),
        ("other options", not _holds(entry, folder, order)),
        ("failed temporarily", failed and entry.passing),
        ("failed before", failed and order.retry_failed),
        ("its copy has changed", duplicate and folder.holders.get(key, item.location) == item.location),
        ("result missing", entry.status == "ok" and not whole),
    )
    return next((why for why, holds in reasons if holds), None)


def key(sha256: str, folder: Folder, order: Order) -> tuple[str, str]:
    """Return under which configuration a content is known, or else will be: the key of `Folder.holders`."""
    own, other = (sha256, order.configuration.hash), (sha256, order.configuration.twin)
    holder = folder.latest.get(folder.holders.get(other, ""))
    return other if own not in folder.holders and holder and _regardless(holder, order) else own


def _holds(entry: ManifestEntry, folder: Folder, order: Order) -> bool:
    """Tell whether the options of an entry give what those of now would give."""
    if entry.configuration != order.configuration.twin:
        return entry.configuration == order.configuration.hash
    holder = folder.holders.get((str(entry.sha256), order.configuration.twin), entry.location)
    return _regardless(folder.latest[holder], order)


def _regardless(entry: ManifestEntry, order: Order) -> bool:
    """Tell whether an input is one to which --salvage makes no difference."""
    if entry.status == "failed":
        return order.configuration.settings.salvage and entry.error_class != DamagedError.__name__
    return entry.recovered_of is None


def same(item: Input, entry: ManifestEntry) -> bool:
    """Tell whether an input is what it was, without reading it."""
    return item.stamp is not None and (item.size, item.stamp) == (entry.size, entry.stamp)
