"""Measuring: interleaved runs of ours and a peer, and peak memory in processes of their own."""

from __future__ import annotations

import gc
import json
import os
import platform
import resource
import tempfile
import time
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from benchmarks.alone import alone

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

ROOT = Path(__file__).resolve().parent.parent
RESULTS = ROOT / "benchmarks" / "results"
#: Seconds of runs from which on a median is taken as it is.
SETTLED = 3.0
SIZES = ("small", "medium", "full")
PACKAGES = ("numpy", "pandas", "pyarrow", "rosbags", "ruptures", "scikit-learn", "scipy")


@dataclass(frozen=True)
class Case:
    """One stage with its inputs made.

    Parameters
    ----------
    ours, peer, floor : callable
        Without arguments. The floor is what no program could do without: reading, decompressing.
    check : callable
        Takes what `ours` and `peer` returned; says in words how far they agree, or fails.
    ours_work, peer_work : float
        How much each does, where a slow peer is given less; times are compared for equal work.
    unit : str
        Of the work.
    processes : bool
        Both are processes: their memory is that of children.
    """

    ours: Callable[[], Any]
    peer: Callable[[], Any] | None
    check: Callable[[Any, Any], str]
    floor: Callable[[], Any] | None = None
    ours_work: float = 1.0
    peer_work: float = 1.0
    unit: str = ""
    processes: bool = False


@dataclass(frozen=True)
class Stage:
    """One row of the table.

    Parameters
    ----------
    name : str
    peer : str
        What it is measured against.
    make : callable
        Takes a size and a folder for inputs, and returns the case.
    least, aim : float or None
        Targets: how many times as fast as the peer; with `within` at most how many times as slow.
    within : bool
    rounds : int
        Largest number of rounds: peers are slow.
    at : str
        The only size of which the targets speak; empty if of all.
    """

    name: str
    peer: str
    make: Callable[[str, Path], Case]
    least: float | None
    aim: float | None
    within: bool = False
    rounds: int = 99
    at: str = ""


def inputs_folder() -> Path:
    """Return where generated inputs are kept from run to run."""
    folder = Path(os.environ.get("TERRAIN_EST_BENCH", Path(tempfile.gettempdir()) / "terrain-est-benchmarks"))
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def timed(run: Callable[[], Any]) -> tuple[float, float, Any]:
    """Run once without the garbage collector; return seconds, seconds of the processor, and the result."""
    gc.collect()
    gc.disable()
    try:
        busy, start = _busy(), time.perf_counter()
        result = run()
        return time.perf_counter() - start, _busy() - busy, result
    finally:
        gc.enable()


def _busy() -> float:
    """Return the time of the processor that this process and its children have taken so far."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def measure(stage: Stage, size: str, rounds: int, *, memory: bool = True) -> dict[str, Any]:
    """Measure one stage.

    The first run of each way warms the caches and is checked; the others take turns, for some seconds
    where the rounds asked for are sooner over.
    """
    case = stage.make(size, inputs_folder())
    ways = {"ours": case.ours, "peer": case.peer, "floor": case.floor}
    work = {"ours": case.ours_work, "peer": case.peer_work, "floor": case.ours_work}
    present = {name: run for name, run in ways.items() if run is not None}
    results = {name: timed(run)[-1] for name, run in present.items()}
    agreement = case.check(results["ours"], results.get("peer"))
    del results
    times: dict[str, list[float]] = {name: [] for name in present}
    busy: dict[str, list[float]] = {name: [] for name in present}
    begun = time.perf_counter()
    while (done := len(times["ours"])) < stage.rounds and (
        done < rounds or time.perf_counter() - begun < SETTLED
    ):
        for name, run in present.items():
            # No way runs while the answer of another takes memory.
            seconds, of_processor = timed(run)[:2]
            times[name].append(seconds / work[name])
            busy[name].append(of_processor / work[name])
    medians = {name: median(of) for name, of in times.items()}
    row: dict[str, Any] = {
        "stage": stage.name,
        "peer": stage.peer,
        "unit": case.unit,
        "work": case.ours_work,
        "seconds": {name: value * case.ours_work for name, value in medians.items()},
        "ratio": _compared(times, within=stage.within),
        "processor_ratio": _compared(busy, within=stage.within),
        "over_floor": medians["ours"] / medians["floor"] if "floor" in medians else None,
        "within": stage.within,
        "least": stage.least,
        "aim": stage.aim,
        "judged": stage.at in ("", size),
        "agreement": agreement,
        "rounds": len(times["ours"]),
        "each": {name: [value * case.ours_work for value in of] for name, of in times.items()},
    }
    if memory:
        row["peak_MB"] = {
            way: peak_memory(stage.name, size, way) for way in ("inputs", *present) if way != "floor"
        }
    return row


def _compared(times: dict[str, list[float]], *, within: bool) -> float | None:
    """Return how many times the median of the peer is that of ours; with `within` the reverse."""
    if "peer" not in times or not median(times["ours"]):
        return None
    ratio = median(times["peer"]) / median(times["ours"])
    return 1.0 / ratio if within else ratio


def peak_memory(stage: str, size: str, way: str) -> float:
    """Return the peak memory of one way in MB, inputs included, from a process of its own."""
    return float(alone(["-m", "benchmarks.peak", stage, size, way], ROOT).output.split()[-1])


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the rows as people read them."""
    lines = [
        f"{'stage':<22}{'ours':>10}{'peer':>10}{'ratio':>9}{'target':>9}{'aim':>8}  {'':<5}{'processor':>9}{'floor':>10}{'ours/floor':>11}{'peak MB':>9}{'peer MB':>9}"
    ]
    for row in rows:
        seconds, peaks = row["seconds"], row.get("peak_MB", {})
        lines.append(
            f"{row['stage']:<22}{_time(seconds['ours']):>10}{_time(seconds.get('peer')):>10}"
            f"{_ratio(row['ratio']):>9}{_target(row['least'], row['within']):>9}{_target(row['aim'], row['within']):>8}"
            f"  {verdict(row):<5}{_ratio(row['processor_ratio']):>9}{_time(seconds.get('floor')):>10}{_ratio(row['over_floor']):>11}"
            f"{peaks.get('ours', float('nan')):>9.0f}{peaks.get('peer', float('nan')):>9.0f}"
        )
    notes = [f"{row['stage']}: {row['peer']}; {row['agreement']}" for row in rows]
    return "\n".join([*lines, "", *notes]) + "\n"


def verdict(row: dict[str, Any]) -> str:
    """Say which target a row reaches, if one speaks of its size."""
    if row["ratio"] is None or row["least"] is None or not row.get("judged", True):
        return ""

    def reached(target: float | None) -> bool:
        if target is None:
            return False
        return row["ratio"] <= target if row["within"] else row["ratio"] >= target

    return "aim" if reached(row["aim"]) else "yes" if reached(row["least"]) else "NO"


def _time(seconds: float | None) -> str:
    if seconds is None:
        return "–"
    unit, scale = next(
        ((unit, scale) for unit, scale in (("s", 1.0), ("ms", 1e3)) if seconds * scale >= 1.0), ("µs", 1e6)
    )
    value = seconds * scale
    return f"{value:,.0f} {unit}" if value >= 100.0 else f"{value:.3g} {unit}"


def _ratio(value: float | None) -> str:
    return "–" if value is None else f"{value:,.2f}×" if value < 10 else f"{value:,.0f}×"


def _target(value: float | None, within: bool) -> str:
    return "" if value is None else f"{'≤' if within else '≥'}{value:,g}"


def write(name: str, text: str, content: Any) -> None:
    """Write a result as text and as JSON."""
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / f"{name}.txt").write_text(text, encoding="utf-8")
    (RESULTS / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def machine() -> dict[str, Any]:
    """Return what the figures depend on."""
    versions = {}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return {
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "packages": versions,
    }
