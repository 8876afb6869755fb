"""Pictures of a drive that goes on: c and φ against the samples, drawn anew as rows come."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from terrain_cli.views import plots

if TYPE_CHECKING:
    from terrain_cli.presentation.segment_table import Table

#: Column of the table, and its name in what is drawn.
_DRAWN = {
    **{name: name for name in ("source", "wheel", "segment", "c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg")},
    "n_samples": "sample",
}
#: Rows of a wheel that are held at the most: beyond that every second one goes.
_MOST = 2000
#: After a drawing, so many times what it took are left to the rows that arrive. Judged.
_REST = 4.0


class LivePictures:
    """The pictures of `--plot` with `--follow`, in a folder."""

    def __init__(self, folder: str) -> None:
        self._folder = folder
        self._rows: dict[str, list[dict[str, Any]]] = {}
        self._next = 0.0

    def add(self, row: Table) -> None:
        """Take a row of the table, of an open segment or of a closed one."""
        rows = self._rows.setdefault(row["wheel"][0], [])
        new = {_DRAWN[name]: row[name][0] for name in _DRAWN}
        last = rows[-1] if rows else {"segment": None, "before": 0, "sample": 0}
        # A segment begins when the row of the one before, which has closed, was the last.
        begins = last["segment"] != new["segment"]
        rows.append({**new, "before": last["before"] + last["sample"] * begins})
        if len(rows) > _MOST:
            del rows[1:-1:2]

    def draw(self, *, last: bool = False) -> None:
        """Draw what is there, if the last drawing is long enough ago or nothing more comes."""
        began = time.monotonic()
        if not self._rows or (began < self._next and not last):
            return
        traces = [
            {name: [row[name] for row in rows] for name in (*_DRAWN.values(), "before")}
            for rows in self._rows.values()
        ]
        plots.write_convergence(traces, self._folder)
        now = time.monotonic()
        self._next = now + _REST * (now - began)
