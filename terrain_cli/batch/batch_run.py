"""A batch from its inputs to the mission table and its summary.

The table is a function of what the manifest holds: a batch that was killed, retried or done in another order
ends with the same bytes. Rows stand in the order of the inputs' names, each content once, under its first.
"""

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import astuple, dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from formats.source import natural
from terrain_cli.batch import batch_folder, batch_inputs, manifest
from terrain_cli.batch.batch_folder import ASSEMBLED, CONFIGURATIONS, STATE, Folder
from terrain_cli.batch.batch_inputs import Arrivals, Input
from terrain_cli.batch.coordinator import Keeper, Tally
from terrain_cli.batch.dask_cluster import Cluster
from terrain_cli.batch.manifest import ManifestEntry, Pointer, Records, decode
from terrain_cli.batch.worker_pool import LocalPool
from terrain_cli.batch.worker_tasks import Configuration, Order, Reply
from terrain_cli.errors import InputError, TerrainError, UnfinishedError
from terrain_cli.estimation import WindowEstimates
from terrain_cli.presentation.segment_table import Table
from terrain_cli.presentation.terminal import as_json

Report = Callable[[Tally], None]
TABLE, SUMMARY = "segments", "summary.json"
#: Inputs whose rows are held at a time.
_AT_ONCE = 256
_TEXT = frozenset({"source", "wheel", "terrain", "method", "status", "WKT"})
_WHOLE = frozenset({"segment", "n_samples", "n_rejected"})
_TICK, _LOOK = 0.2, 1.0  # Seconds between two looks at what workers have done, and at what has arrived
_PAUSE = 10  # And at least so many times as long as such a look takes


@dataclass(frozen=True)
class MissionPart:
    path: str
    record: Pointer
    configuration: str  # It was computed with


def mission_parts(folder: Folder) -> list[MissionPart]:
    """Return what the mission consists of, in the order of the names."""
    found = []
    for content, entries in _by_content(folder).items():
        # A content done with several options counts once, with those of its last result.
        results = [entry for entry in entries if entry.status == "ok"] or entries
        last = results[-1]
        record = folder.kept.get((content, last.configuration))
        first = min(entries, key=_order)
        if record:
            found.append((_order(first), MissionPart(first.path, record, last.configuration)))
    return [part for _, part in sorted(found, key=lambda pair: pair[0])]


def _by_content(folder: Folder) -> dict[str, list[ManifestEntry]]:
    names: dict[str, list[ManifestEntry]] = {}
    for entry in folder.latest.values():
        if entry.sha256 and entry.status != "failed":
            names.setdefault(entry.sha256, []).append(entry)
    return names


def mission_account(folder: Folder) -> dict[str, Any]:
    """Return what the summary says of the inputs that gave no rows."""
    entries = sorted(folder.latest.values(), key=_order)
    # By name, not by who came first: that may differ from one run to the next.
    named = [sorted(same, key=_order) for same in _by_content(folder).values()]
    copies = {copy.location: same[0].path for same in named for copy in same[1:]}
    return {
        "inputs": len(entries),
        "status": dict(sorted(Counter(entry.status for entry in entries).items())),
        "failed": [
            {key: getattr(entry, key) for key in ("path", "error_class", "error", "exit_code")}
            for entry in entries
            if entry.status == "failed"
        ],
        "duplicates": [
            {"path": entry.path, "of": copies[entry.location]}
            for entry in entries
            if entry.location in copies
        ],
    }


def _order(entry: ManifestEntry) -> tuple[list[tuple[int, int | str]], str]:
    return natural(entry.path), entry.location


@dataclass(frozen=True)
class Assemble:
    """Writes table and summary ready to be placed, in a process of its own: the keeper stays small."""

    folder: str
    parts: Sequence[MissionPart]
    account: Mapping[str, Any]
    configuration: Configuration
    kinds: Sequence[str]

    def run(self) -> Reply:
        import formats
        from terrain_cli.presentation import segment_files, segment_table

        state = Path(self.folder, STATE)
        document, crs, stress = self._summary()
        for kind in self.kinds:
            path = str(state / f"{TABLE}.{kind}")
            if kind == "parquet":
                formats.write_parts(self._tables(crs, stress), path, crs=crs)
            else:
                # These cannot be written in parts.
                segment_files.write(segment_table.join(list(self._tables(crs, stress))), path, crs)
        with formats.replacing(str(state / SUMMARY)) as temporary:
            Path(temporary).write_text(as_json(document) + "\n", encoding="utf-8")
        return Reply()

    def _summary(self) -> tuple[dict[str, Any], str | None, float]:
        """Read all records, and keep of them what the summary needs.

        Also return the reference system, and the stress in Pa at which all strengths are compared.
        """
        from terrain_cli import estimation
        from terrain_cli.estimation.strength import stress_of_all
        from terrain_cli.presentation import segment_table, summary

        counts = Counter(part.configuration for part in self.parts)
        batch = {**self.account, "configurations": dict(sorted(counts.items()))}
        if not self.parts:
            return {"format": summary.FORMAT, "batch": batch, "inputs": [], "terrains": []}, None, math.nan
        tables, estimates, accounts, systems = [], [], [], set()
        channels: dict[str, dict[str, str]] = {}
        for block in self._blocks():
            table = segment_table.join([rows for rows, _, _ in block])
            systems.add(segment_table.reference_system(table, self.configuration.crs))
            tables.append({name: table[name] for name in summary.COLUMNS})
            estimates.append(estimation.join([some for _, some, _ in block]))
            for _, _, told in block:
                for wheel in told["wheels"]:
                    # Held once is what takes most of an account and is the same in nearly all.
                    wheel["channels"] = channels.setdefault(json.dumps(wheel["channels"]), wheel["channels"])
                accounts.append(told)
        every = estimation.join(estimates)
        settings = self.configuration.settings.document()
        document = summary.document(segment_table.join(tables), every, accounts, settings)
        return {"batch": batch, **document}, next(iter(systems - {None}), None), stress_of_all(every)

    def _tables(self, crs: str | None, stress: float) -> Iterator[Table]:
        """Read the table, some inputs at a time, with all strengths at one stress in Pa."""
        import numpy as np

        from terrain_cli.presentation import segment_table

        for block in self._blocks():
            each = [segment_table.at_one_stress(rows, own, stress) for rows, own, _ in block]
            table = segment_table.join(each)
            if crs and segment_table.reference_system(table, crs) is None:
                # As `join` has it: one reference system for all.
                table["WKT"] = [""] * len(table["WKT"])
            yield table
        if not self.parts:
            types = {name: np.int64 if name in _WHOLE else np.float64 for name in segment_table.COLUMNS}
            yield {name: [] if name in _TEXT else np.zeros(0, kind) for name, kind in types.items()}

    def _blocks(self) -> Iterator[list[tuple[Table, WindowEstimates, dict[str, Any]]]]:
        if not self.parts:
            return
        with closing(Records(Path(self.folder, STATE, "records"))) as file:
            for first in range(0, len(self.parts), _AT_ONCE):
                some = self.parts[first : first + _AT_ONCE]
                yield [decode(self._record(file, part), part.path) for part in some]

    def _record(self, file: Records, part: MissionPart) -> bytes:
        record = file.read(part.record)
        if record is None:
            what = f"{self.folder}: what was kept of {part.path} is damaged"
            raise InputError(what, hint="run again with --force for this input")
        return record


def preview(items: Sequence[Input], directory: str, order: Order) -> list[tuple[str, Input]]:
    """Return what would be done, and why; the folder need not be there."""
    with closing(Folder(directory, writable=False)) as folder:
        inputs = [item for item in items if not folder.own(item.location)]
        reasons = ((batch_folder.reason(item, folder, order), item) for item in inputs)
        return [(why, item) for why, item in reasons if why is not None]


def run(
    names: Sequence[str],
    found: Sequence[Input],
    directory: str,
    order: Order,
    report: Report = lambda _: None,
) -> Tally:
    """Do what is new or changed among inputs found under some names, and assemble the mission table."""
    # `report` is called several times a second. Whatever ends a batch, what it has finished is kept.
    if order.settle is None and found and all(item.problem for item in found):
        raise next(item.problem for item in found if item.problem)
    with closing(Folder(directory)) as folder:
        name = f"{CONFIGURATIONS}/{order.configuration.hash}.json"
        if not (folder.path / name).exists():
            folder.put(name, as_json(order.configuration.document).encode() + b"\n")
        limits = order.timeout, order.memory
        workers: LocalPool | Cluster = LocalPool(order.jobs, *limits)
        if order.scheduler is not None:
            workers = Cluster(order.scheduler, *limits)
        with closing(workers) as pool:
            keeper = Keeper(folder, pool, order)
            if order.settle is None:
                keeper.add(item for item in found if not folder.own(item.location))
                while not keeper.idle and not (order.fail_fast and keeper.tally.failures):
                    keeper.step(_TICK)
                    report(keeper.tally)
                keeper.lost()
            else:
                _watch(keeper, names, folder, order, report)
        _assemble(folder, order)
    return keeper.tally


def _watch(keeper: Keeper, names: Sequence[str], folder: Folder, order: Order, report: Report) -> None:
    arrivals = Arrivals(order.settle or 0.0)
    assembled = -1
    next_look = 0.0
    while not (order.fail_fast and keeper.tally.failures):
        if (began := time.monotonic()) >= next_look:
            here = [item for item in batch_inputs.discover(names) if not folder.own(item.location)]
            keeper.add(arrivals.rested(here))
            # A folder of very many files is not looked at all the time.
            now = time.monotonic()
            next_look = now + max(_LOOK, _PAUSE * (now - began))
        if not keeper.idle:
            keeper.step(_TICK)
        elif keeper.tally.done != assembled:
            _assemble(folder, order)
            assembled = keeper.tally.done
        else:
            time.sleep(_TICK)
        report(keeper.tally)


def _assemble(folder: Folder, order: Order) -> None:
    """Bring the mission table up to what the manifest says, if it is not."""
    if not folder.latest:
        return
    kinds = tuple(dict.fromkeys(("parquet", *order.also)))
    names = [*(f"{TABLE}.{kind}" for kind in kinds), SUMMARY]
    parts, account = mission_parts(folder), mission_account(folder)
    told = [[astuple(part) for part in parts], account, order.configuration.hash, kinds]
    digest = sha256(json.dumps(told, default=str).encode()).hexdigest()

    def note() -> bytes:
        here = (folder.path / name for name in names)
        sizes = [path.lstat().st_size if path.exists() else None for path in here]
        return f"{digest} {sizes}\n".encode()

    if b"".join(manifest.lines(folder.path / ASSEMBLED)) == note():
        return
    with closing(LocalPool(1)) as desk:
        made = desk.do(Assemble(str(folder.path), parts, account, order.configuration, kinds))
    if why := made.failure:
        text = f"the table of all inputs: {why.error}"
        if why.error_class == "WorkerLostError":
            # Nothing is lost: the same command makes the table of what it has.
            raise UnfinishedError(text, hint=why.hint)
        error = TerrainError(text, hint=why.hint)
        error.exit_code = why.exit_code
        raise error
    for name in names:
        manifest.place(folder.state / name, folder.path / name)
    folder.put(ASSEMBLED, note())
