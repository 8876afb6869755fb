"""The coordinator: decides what is done for each input, and alone writes into the folder."""

from collections import Counter, defaultdict, deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

from formats.errors import NotFoundError
from formats.recovery import told
from terrain_cli.batch import batch_folder
from terrain_cli.batch.batch_folder import Folder, result_name
from terrain_cli.batch.batch_inputs import Input
from terrain_cli.batch.dask_cluster import Cluster
from terrain_cli.batch.manifest import ManifestEntry, uninterrupted
from terrain_cli.batch.worker_pool import LocalPool
from terrain_cli.batch.worker_tasks import Estimate, Failure, Identify, Order, Reply, Restore, Task, failure

_OVERHEAD = 1_000_000  # What an input costs beyond its bytes, in bytes: for the time that remains


@dataclass(eq=False, kw_only=True)
class _Case:
    """An input for which something is to be done."""

    item: Input
    sha256: str | None
    #: Whether its content may be that of another input: decided before anything is computed.
    shared: bool = False
    begun: bool = False
    finished: bool = False
    restored: bool = False
    configuration: str | None = None  # What it is known under, where that is not what was asked for


@dataclass(kw_only=True)
class Tally:
    """How far a batch has come."""

    total: int = 0  # Inputs for which something is to be done
    # Finished: "ok", "restored", "failed", "duplicate"; the others: "as before", and "failed before".
    counts: Counter[str] = field(default_factory=Counter)
    # bytes_total, bytes_done: with something for each input, however small
    bytes_total: int = 0
    bytes_done: int = 0
    # Those of the inputs of this run that failed, now or before and unchanged; by location
    failures: dict[str, ManifestEntry] = field(default_factory=dict)
    # Those of the damaged inputs that were read in this run
    salvaged: list[ManifestEntry] = field(default_factory=list)
    # What was remarked on inputs of this run, and on which
    remarks: dict[str, list[str]] = field(default_factory=dict)

    @property
    def done(self) -> int:
        """Inputs that something was done for."""
        return sum(self.counts[name] for name in ("ok", "restored", "failed", "duplicate"))


class Keeper:
    """Has done what is to be done, in its order, and writes down what became of it.

    Of inputs with the same content the first is done, and the others are marked as its duplicates: a
    candidate waits until the contents of all earlier ones of its size are known.
    """

    def __init__(self, folder: Folder, pool: LocalPool | Cluster, order: Order) -> None:
        self._folder, self._pool, self._order = folder, pool, order
        self.tally = Tally()
        self._queue: deque[_Case] = deque()
        self._ready: deque[tuple[_Case, Task]] = deque()
        self._running: dict[int, tuple[_Case, Task]] = {}
        self._tickets = 0
        #: Cases that are not decided on yet, by size, in their order.
        self._open: defaultdict[int | None, deque[_Case]] = defaultdict(deque)
        #: Duplicates that were left as they are; what they copy may change yet.
        self._copies: list[Input] = []
        self._paths = {location: entry.path for location, entry in folder.latest.items()}
        self._sizes = Counter(entry.size for entry in folder.latest.values() if entry.sha256)

    def add(self, items: Iterable[Input]) -> None:
        cases = []
        for item in items:
            entry = self._folder.latest.get(item.location)
            if batch_folder.reason(item, self._folder, self._order) is None and entry:
                self._leave(item, entry)
            elif item.problem:
                self._unreadable(item, entry)
            else:
                known = entry.sha256 if entry and batch_folder.same(item, entry) else None
                cases.append(_Case(item=item, sha256=known))
        self._sizes.update(case.item.size for case in cases)
        for case in cases:
            size = case.item.size
            case.shared = size is None or self._sizes[size] > 1
            self._open[size].append(case)
            self._paths[case.item.location] = case.item.path
            self.tally.total += 1
            self.tally.bytes_total += (size or 0) + _OVERHEAD
        self._queue.extend(cases)

    @property
    def idle(self) -> bool:
        return not (self._queue or self._ready or self._running)

    def step(self, seconds: float) -> None:
        """Send out what can be done, wait some seconds at the most, and write down what was done."""
        self._send()
        for ticket, reply in self._pool.collect(seconds):
            self._answered(*self._running.pop(ticket), reply)
        if self.idle and self._copies:
            copies = [item for item in self._copies if batch_folder.reason(item, self._folder, self._order)]
            self._copies.clear()
            self.tally.counts["as before"] -= len(copies)
            self.add(copies)

    def _send(self) -> None:
        while self._pool.free > 0 and (self._ready or self._queue):
            if self._ready:
                case, task = self._ready.popleft()
                self._submit(case, task)
                continue
            case = self._queue.popleft()
            case.begun = True
            if case.sha256 is not None:
                self._decide(case.item.size)
            elif case.shared:
                self._submit(case, Identify(case.item, self._order))
            else:
                # Nothing else has its size: it is read once, to hash and to estimate.
                self._submit(case, Estimate(case.item, self._order))

    def _submit(self, case: _Case, task: Task) -> None:
        self._tickets += 1
        self._running[self._tickets] = case, task
        self._pool.submit(self._tickets, task)

    def _answered(self, case: _Case, task: Task, reply: Reply) -> None:
        case.sha256 = case.sha256 or reply.sha256
        if reply.failure or not isinstance(task, Identify):
            holder = self._holder(case)
            if holder != case.item.location and not reply.failure:
                # Nobody said how large it was, and another had the same content.
                self._duplicate(case, holder)
            else:
                self._finish(case, reply)
        self._decide(case.item.size)

    def _key(self, case: _Case) -> tuple[str, str]:
        return batch_folder.key(str(case.sha256), self._folder, self._order)

    def _holder(self, case: _Case) -> str:
        return self._folder.holders.get(self._key(case), case.item.location)

    def _decide(self, size: int | None) -> None:
        """Say what is to be done for the first cases of one size, as far as their content is known."""
        waiting = self._open[size]
        while waiting and waiting[0].begun and (waiting[0].finished or waiting[0].sha256):
            case = waiting.popleft()
            if case.finished or case.sha256 is None:
                continue
            holder = self._holder(case)
            if holder != case.item.location:
                self._duplicate(case, holder)
                continue
            key = self._key(case)
            record = None if self._order.force else self._folder.record(key)
            task: Task = Estimate(case.item, self._order, case.sha256)
            if record is not None:
                case.restored, case.configuration = True, key[1]
                task = Restore(case.item, self._order, case.sha256, record)
            self._folder.holders[case.sha256, self._configuration(case)] = case.item.location
            self._ready.append((case, task))

    def _leave(self, item: Input, entry: ManifestEntry) -> None:
        if entry.status == "duplicate":
            self._copies.append(item)
        if entry.status == "failed":
            self.tally.counts["failed before"] += 1
            self.tally.failures[entry.location] = entry
        else:
            self.tally.counts["as before"] += 1

    def _unreadable(self, item: Input, before: ManifestEntry | None) -> None:
        self.tally.total += 1
        self.tally.bytes_total += _OVERHEAD
        case = _Case(item=item, sha256=None)
        why = failure(item.problem) if item.problem else Failure("FormatError", "cannot be read")
        reply = Reply(failure=why)
        if isinstance(item.problem, NotFoundError):
            # No input, but a name. What was made of it before it was taken away stays.
            self._count(case, self._failed(case, reply, why))
        elif before and before.status == "failed" and before.error == why.error:
            # Said already; a manifest does not grow by looking.
            self._count(case, before)
        else:
            self._finish(case, reply)

    def _duplicate(self, case: _Case, holder: str) -> None:
        told: dict[str, Any] = {"configuration": self._key(case)[1], "status": "duplicate", "exit_code": None}
        entry = replace(self._entry(case, Reply()), **told, duplicate_of=self._paths[holder])
        before = self._folder.latest.get(case.item.location)
        self._folder.remove(before.result if before else None)
        self._write(case, entry)

    def _finish(self, case: _Case, reply: Reply) -> None:
        before = self._folder.latest.get(case.item.location)
        if reply.failure:
            # No result may lie there for which the manifest does not speak.
            self._folder.remove(before.result if before else None)
            entry = self._failed(case, reply, reply.failure)
        else:
            # Record and result are there before the manifest speaks of them.
            kept = self._folder.kept.get((str(case.sha256), self._configuration(case)))
            if reply.record and self._folder.records:
                kept = self._folder.records.add(reply.record)
            name = result_name(case.item.location, self._order.kind)
            self._folder.put(name, reply.result)
            size = len(reply.result)
            entry = replace(self._entry(case, reply), record=kept, result=name, result_bytes=size)
            if before and before.result != entry.result:
                self._folder.remove(before.result)
        self._write(case, entry)

    def _failed(self, case: _Case, reply: Reply, why: Failure) -> ManifestEntry:
        error = why.error if case.item.path in why.error else f"{case.item.path}: {why.error}"
        told = {**vars(why), "error": error, "hint": why.hint or None}
        return replace(self._entry(case, reply), status="failed", **told)

    def _configuration(self, case: _Case) -> str:
        return case.configuration or self._order.configuration.hash

    def _entry(self, case: _Case, reply: Reply) -> ManifestEntry:
        return ManifestEntry(
            **{name: getattr(case.item, name) for name in ("path", "location", "size", "stamp")},
            sha256=case.sha256,
            configuration=self._configuration(case),
            versions=self._order.versions,
            status="ok",
            exit_code=0,
            **reply.told,
            seconds=round(reply.seconds, 3),
            finished=datetime.now(UTC).isoformat(timespec="milliseconds"),
        )

    def _write(self, case: _Case, entry: ManifestEntry) -> None:
        before = self._folder.latest.get(entry.location)
        # An interruption between the two would be told of one input fewer than is kept.
        with uninterrupted():
            if entry.status != "duplicate" or before is None or _told(entry) != _told(before):
                self._folder.add(entry)
            self._count(case, entry)

    def lost(self) -> None:
        """Write down what was kept before, is damaged now, and was not among the inputs."""
        for entry in list(self._folder.latest.values()):
            if entry.status == "ok" and (str(entry.sha256), entry.configuration) not in self._folder.kept:
                why = Failure(
                    "DamagedError",
                    f"{entry.path}: what was kept of it is damaged",
                    "give it as an input again",
                    65,
                    passing=True,
                )
                failed = replace(entry, status="failed", record=None, **vars(why))
                self._folder.add(failed)
                self.tally.failures[entry.location] = failed

    def _count(self, case: _Case, entry: ManifestEntry) -> None:
        case.finished = True
        self.tally.counts["restored" if case.restored and entry.status == "ok" else entry.status] += 1
        self.tally.bytes_done += (case.item.size or 0) + _OVERHEAD
        if entry.status == "failed":
            self.tally.failures[entry.location] = entry
        elif entry.recovered_of:
            self.tally.salvaged.append(entry)
        # What was salvaged is told for itself.
        for remark in (text for text in entry.warnings if not told([text])):
            self.tally.remarks.setdefault(remark, []).append(entry.path)


def _told(entry: ManifestEntry) -> tuple[object, ...]:
    return entry.status, entry.size, entry.stamp, entry.sha256, entry.configuration, entry.duplicate_of
