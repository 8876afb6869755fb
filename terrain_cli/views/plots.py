"""Pictures as files: what `--plot DIR` writes."""

import re
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias, cast

import numpy as np

import formats
from formats.output.whole_files import explained
from terrain_cli.comparison import Comparison
from terrain_cli.comparison.comparison_outcome import as_estimated
from terrain_cli.diagnosis.diagnosis_outcome import Diagnosis
from terrain_cli.errors import UsageError, nearest
from terrain_cli.improvement.model_history import Rung
from terrain_cli.presentation import segment_table
from terrain_cli.presentation.segment_table import Table
from terrain_cli.run.one_log import Outcome
from terrain_cli.simulation import SimulatedLog
from terrain_cli.views import chart_style, shown_samples, shown_segments
from terrain_cli.windows.cut_windows import Windows

# Before matplotlib is imported: it says which extra brings it.
chart_style.need("plot")

from matplotlib import style  # noqa: E402
from matplotlib.figure import Figure  # noqa: E402

from terrain_cli.views.figures import drive_figures, model_figures, soil_figures  # noqa: E402

Drawn: TypeAlias = Comparison | Diagnosis | SimulatedLog | Sequence[Rung] | Sequence[Outcome]
Drawing = tuple[str, Callable[[], Figure | None]]

ENDINGS = (".png", ".svg")
MOST_TRACES = 8  # Wheels whose joint posterior, or recursive estimate, is drawn
MOST_TRACED = 200_000  # Samples of each, where the picture is of a comparison
#: Column of the table, and its name in what is drawn.
_DRAWN = {
    **{name: name for name in ("source", "wheel", "segment", "c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg")},
    "n_samples": "sample",
}
_MOST_ROWS = 2000  # Rows of a wheel that are held at the most: beyond that every second one goes
_REST = 4.0  # After a drawing, so many times what it took are left to the rows that arrive. Judged.


def write(found: Drawn, folder: str | Path) -> list[Path]:
    """Draw every picture that the results allow, each as PNG and SVG, in place of those of the same name."""
    return _write(_drawings(found), folder)


def draw(found: Drawn, name: str) -> Figure:
    """Draw one of the pictures of `write` by its name."""
    names = []
    with _style():
        for known, drawn in _drawings(found):
            figure = drawn() if known == name else None
            if figure is not None:
                return figure
            names.append(known)
    if name in names:
        raise UsageError(f"picture {name}: these data have nothing that it could show")
    raise UsageError(
        f"there is no picture {name}{nearest(name, names)}", hint=f"there are {', '.join(names)}"
    )


class LivePictures:
    """The pictures of `--plot` with `--follow`, in a folder: c and φ, drawn anew as rows come."""

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
        if len(rows) > _MOST_ROWS:
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
        _write(_convergence(traces[:MOST_TRACES]), self._folder)
        now = time.monotonic()
        self._next = now + _REST * (now - began)


@contextmanager
def _style() -> Iterator[None]:
    chart_style.need("plot")
    with style.context(chart_style.STYLE), warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes, which is all that can be done.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        yield


def _write(drawings: Iterable[Drawing], folder: str | Path) -> list[Path]:
    folder = Path(folder)
    written = []
    with _style():
        with explained(str(folder)):
            folder.mkdir(parents=True, exist_ok=True)
        for name, drawn in drawings:
            figure = drawn()
            if figure is None:
                continue
            for ending in ENDINGS:
                path = folder / f"{name}{ending}"
                with formats.replacing(str(path)) as temporary:
                    figure.savefig(temporary, metadata={"Date": None} if ending == ".svg" else None)
                written.append(path)
    return written


def _drawings(found: Drawn) -> Iterator[Drawing]:
    if isinstance(found, Comparison):
        yield from _of_comparison(found)
    elif isinstance(found, Diagnosis):
        yield "candidates", partial(model_figures.candidates, found)
    elif isinstance(found, SimulatedLog):
        yield "measured", partial(drive_figures.measured, found)
    elif outcomes := [one for one in found if isinstance(one, Outcome)]:
        yield from _of_outcomes(outcomes)
    else:
        yield "ladder", partial(model_figures.errors, cast("Sequence[Rung]", found))


def _of_comparison(comparison: Comparison) -> Iterator[Drawing]:
    comparison = as_estimated(comparison)
    shown = shown_samples.channels(comparison)
    yield "predicted-measured", partial(model_figures.predicted_measured, comparison)
    for name in shown:
        yield f"residual-{name.replace('_', '-')}", partial(model_figures.residuals, comparison, name)
    table = shown_segments.soil_table(comparison)
    yield "strength", partial(soil_figures.strength, table)
    for name, what in shown.items():
        label = f"rms error of {what.words}{what.in_unit}"
        misfit = shown_samples.misfit(comparison, name)
        yield f"track-{name.replace('_', '-')}", partial(soil_figures.track, table, {label: misfit})
    moments = shown_segments.moments(comparison)
    yield "rim-stress", partial(soil_figures.rim_stress, moments) if moments else lambda: None
    driven = [wheel.segments for wheel in comparison.wheels if wheel.segments.lined]
    yield from _convergence([segment_table.trace(_begun(windows)) for windows in driven[:MOST_TRACES]])


def _begun(windows: Windows) -> Windows:
    """Keep the first samples of a wheel: later ones do not show how an estimate converges."""
    n = min(len(windows.rows), MOST_TRACED)
    return windows.taken(slice(n), np.append(windows.bounds[windows.bounds < n], n))


def _of_outcomes(outcomes: Sequence[Outcome]) -> Iterator[Drawing]:
    table = segment_table.join([outcome.table for outcome in outcomes if outcome.table])
    yield "strength", partial(soil_figures.strength, table)
    misfit = {"rms error of torque (N m)": table["torque_rmse_Nm"]}
    yield "track", partial(soil_figures.track, table, misfit)
    yield from _valleys(table, [part for outcome in outcomes for part in outcome.posterior][:MOST_TRACES])
    yield from _convergence([trace for outcome in outcomes for trace in outcome.trace][:MOST_TRACES])


def _valleys(table: Mapping[str, Any], posteriors: Sequence[Mapping[str, Any]]) -> Iterator[Drawing]:
    for number, posterior in enumerate(posteriors, 1):
        if not len(posterior["kind"]):
            continue
        of = tuple(posterior[key][0] for key in ("source", "wheel"))
        rows = [j for j, one in enumerate(zip(table["source"], table["wheel"], strict=True)) if one == of]
        own = {name: [values[j] for j in rows] for name, values in table.items()}
        name = _numbered("valley", number, of[1], several=len(posteriors) > 1)
        yield name, partial(soil_figures.valleys, posterior, own)


def _numbered(name: str, number: int, wheel: str, *, several: bool) -> str:
    plain = re.sub(r"[^\w-]+", "_", str(wheel))[:40]
    return f"{name}-{number}-{plain}" if several else name


def _convergence(traces: Sequence[Mapping[str, Any]]) -> Iterator[Drawing]:
    several = len(traces) > 1
    drawn = []
    for number, trace in enumerate(traces, 1):
        if len(trace["segment"]) and np.isfinite(trace["c_kPa"]).any():
            name = _numbered("convergence", number, trace["wheel"][0], several=several)
            yield name, partial(drive_figures.convergence, trace)
            drawn.append(trace)
    yield "convergence-of-all", partial(drive_figures.convergence_of_all, drawn)
