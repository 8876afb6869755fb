"""The mission table and its summary: a function of what the manifest holds, whatever came before.

So a batch that was killed, retried or done in another order ends with the same bytes: rows stand in
the order of the inputs' names, each content once, under the first of its names.
"""

from __future__ import annotations

import json
from collections import Counter
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from formats.input_paths import natural
from terrain_cli.batch.batch_folder import STATE
from terrain_cli.batch.worker_tasks import Reply

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from terrain_cli.batch.batch_folder import Folder
    from terrain_cli.batch.manifest import ManifestEntry, Pointer, Records
    from terrain_cli.estimation import WindowEstimates
    from terrain_cli.presentation.segment_table import Table
    from terrain_cli.run.settings import Settings

TABLE, SUMMARY = "segments", "summary.json"
#: Inputs whose rows are held at a time.
_AT_ONCE = 256
_TEXT = frozenset({"source", "wheel", "terrain", "method", "status", "WKT"})
_WHOLE = frozenset({"segment", "n_samples", "n_rejected"})


@dataclass(frozen=True)
class MissionPart:
    """One content of the mission."""

    path: str
    record: Pointer
    configuration: str  # It was computed with


def parts(folder: Folder) -> list[MissionPart]:
    """Return what the mission consists of, in the order of the names."""
    found = []
    for sha256, entries in _by_content(folder).items():
        # A content done with several options counts once, with those of its last result.
        results = [entry for entry in entries if entry.status == "ok"] or entries
        last = results[-1]
        record = folder.kept.get((sha256, last.configuration))
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


def account(folder: Folder) -> dict[str, Any]:
    """Return what the summary says of the inputs that gave no rows."""
    entries = sorted(folder.latest.values(), key=_order)
    # By name, not by who came first: that may differ from one run to the next.
    named = [sorted(same, key=_order) for same in _by_content(folder).values()]
    copies = {copy.location: same[0].path for same in named for copy in same[1:]}
    return {
        "inputs": len(entries),
        "status": dict(sorted(Counter(entry.status for entry in entries).items())),
        "failed": [
            {
                "path": entry.path,
                "error_class": entry.error_class,
                "error": entry.error,
                "exit_code": entry.exit_code,
            }
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


@dataclass(frozen=True, kw_only=True)
class Assemble:
    """Writes table and summary ready to be placed, in a process of its own: the keeper stays small."""

    folder: str
    parts: Sequence[MissionPart]
    account: Mapping[str, Any]
    settings: Settings
    crs: str | None
    kinds: Sequence[str]

    def run(self) -> Reply:
        """Write them into the folder of what is not ready."""
        import formats
        from terrain_cli.presentation import segment_files, segment_table

        state = Path(self.folder, STATE)
        document, crs = self._summary()
        for kind in self.kinds:
            path = str(state / f"{TABLE}.{kind}")
            if kind == "parquet":
                formats.write_parts(self._tables(crs), path, crs=crs)
            else:
                # These cannot be written in parts.
                segment_files.write(segment_table.join(list(self._tables(crs))), path, crs)
        with (
            formats.replacing(str(state / SUMMARY)) as temporary,
            Path(temporary).open("w", encoding="utf-8") as stream,
        ):
            json.dump(document, stream, ensure_ascii=False, indent=2, allow_nan=False)
            stream.write("\n")
        return Reply()

    def _summary(self) -> tuple[dict[str, Any], str | None]:
        """Read all records, and keep of them what the summary needs; also the reference system."""
        from terrain_cli import estimation
        from terrain_cli.presentation import segment_table, summary

        batch = {
            **self.account,
            "configurations": dict(sorted(Counter(part.configuration for part in self.parts).items())),
        }
        if not self.parts:
            return {"format": summary.FORMAT, "batch": batch, "inputs": [], "terrains": []}, None
        tables, estimates, accounts, systems = [], [], [], set()
        channels: dict[str, dict[str, str]] = {}
        for block in self._blocks():
            table = segment_table.join([rows for rows, _, _ in block])
            systems.add(segment_table.reference_system(table, self.crs))
            tables.append({name: table[name] for name in summary.COLUMNS})
            estimates.append(estimation.join([some for _, some, _ in block]))
            accounts += [_sharing(told, channels) for _, _, told in block]
        document = summary.document(
            segment_table.join(tables), estimation.join(estimates), accounts, self.settings.document()
        )
        return {"batch": batch, **document}, next(iter(systems - {None}), None)

    def _tables(self, crs: str | None) -> Iterator[Table]:
        """Read the table, some inputs at a time."""
        from terrain_cli.presentation import segment_table

        for block in self._blocks():
            table = segment_table.join([rows for rows, _, _ in block])
            if crs and segment_table.reference_system(table, crs) is None:
                # As `join` has it: one reference system for all.
                table["WKT"] = [""] * len(table["WKT"])
            yield table
        if not self.parts:
            yield _empty(segment_table.COLUMNS)

    def _blocks(self) -> Iterator[list[tuple[Table, WindowEstimates, dict[str, Any]]]]:
        from terrain_cli.batch.manifest import Records, decode

        if not self.parts:
            return
        file = Records(Path(self.folder, STATE, "records"))
        with closing(file):
            for first in range(0, len(self.parts), _AT_ONCE):
                some = self.parts[first : first + _AT_ONCE]
                yield [decode(self._record(file, part), part.path) for part in some]

    def _record(self, file: Records, part: MissionPart) -> bytes:
        from terrain_cli.errors import InputError

        record = file.read(part.record)
        if record is None:
            raise InputError(
                f"{self.folder}: what was kept of {part.path} is damaged",
                hint="run again with --force for this input",
            )
        return record


def _sharing(account: dict[str, Any], channels: dict[str, dict[str, str]]) -> dict[str, Any]:
    """Hold once what takes most of an account and is the same in nearly all: where channels are from."""
    for wheel in account["wheels"]:
        wheel["channels"] = channels.setdefault(json.dumps(wheel["channels"]), wheel["channels"])
    return account


def _empty(columns: Sequence[str]) -> Table:
    import numpy as np

    return {
        name: [] if name in _TEXT else np.zeros(0, np.int64 if name in _WHOLE else np.float64)
        for name in columns
    }
