"""How time and memory grow with size: ``python -m benchmarks.growth [STAGE…] [--largest N]``.

Writes benchmarks/results/growth.txt, .json and .png. Each stage runs at sizes three decades apart;
the exponent is the slope of log time over log size in the upper half of them. Memory is the peak of
a process of its own, less that of one that does nothing but import what the stage needs.
"""

from __future__ import annotations

import argparse
import math
import sys
from functools import partial
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks import harness, model_speed, rover_bag
from benchmarks.alone import alone
from benchmarks.stages import bags, estimators, program, segments, stresses, tables

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

Make = "Callable[[int, Path], Callable[[], Any]]"


def _bag(kind: str, compression: str) -> Make:
    def make(messages: int, folder: Path) -> Callable[[], Any]:
        seconds = messages / sum(topic.rate for topic in rover_bag.TOPICS)
        path = rover_bag.write(folder / f"growth-{messages}", seconds, ((kind, compression),))[
            kind, compression
        ]
        return partial(bags.drained, path, kind)

    return make


def _estimate(messages: int, folder: Path) -> Callable[[], Any]:
    seconds = messages / sum(topic.rate for topic in rover_bag.TOPICS)
    where = folder / f"growth-{messages}"
    path = rover_bag.write(where, seconds, (("ros1", "none"),))["ros1", "none"]
    return partial(program.program, "estimate", str(path), "--rover", str(where / "rover.toml"))


def _table(kind: str) -> Make:
    def make(rows: int, folder: Path) -> Callable[[], Any]:
        return partial(tables.drained, tables.write(kind, rows, folder))

    return make


def _parquet_estimate(rows: int, folder: Path) -> Callable[[], Any]:
    path = program.drive_table(rows, folder)
    return partial(program.program, "estimate", str(path), "--rover", str(folder / "rover.toml"))


def _stresses(samples: int, _: Path) -> Callable[[], Any]:
    given = stresses.channels(samples)
    return lambda: stresses.linear.line_coordinates(*given, **stresses.GEOMETRY)


def _segments(samples: int, _: Path) -> Callable[[], Any]:
    x, y, _truth = segments.stresses(samples)
    return lambda: segments.change_points(x, y)


def _windows(*, by_ridge: bool) -> Make:
    def make(windows: int, _: Path) -> Callable[[], Any]:
        return partial(estimators.fitted, *estimators.windows(windows), by_ridge=by_ridge)

    return make


def _forward(samples: int, _: Path) -> Callable[[], Any]:
    rng = np.random.default_rng(1)
    channels = {"sinkage": rng.uniform(0.002, 0.05, samples), "slip": rng.uniform(0.05, 0.9, samples)}
    return lambda: model_speed.predict(model_speed.Model(), model_speed.WHEEL, channels, model_speed.SOIL)


#: What grows, the unit of its size, the sizes, and what runs.
GROWTH: dict[str, tuple[str, Sequence[int], Make]] = {
    "csv": ("rows", (3_000, 30_000, 300_000, 3_000_000), _table("csv")),
    "parquet": ("rows", (10_000, 100_000, 1_000_000, 10_000_000), _table("parquet")),
    "stresses x, y": ("samples", (10_000, 100_000, 1_000_000, 10_000_000), _stresses),
    "segmentation": ("samples", (1_000, 10_000, 100_000, 1_000_000, 10_000_000), _segments),
    "windows least squares": ("windows", (1_000, 10_000, 100_000, 1_000_000), _windows(by_ridge=False)),
    "windows ridge LOO": ("windows", (100, 1_000, 10_000, 100_000), _windows(by_ridge=True)),
    "model forward": ("samples", (1_000, 10_000, 100_000, 1_000_000), _forward),
    "bag ros1 none": ("messages", (1_000, 10_000, 100_000, 1_000_000), _bag("ros1", "none")),
    "bag mcap zstd": ("messages", (1_000, 10_000, 100_000, 1_000_000), _bag("mcap", "zstd")),
    "bag db3": ("messages", (1_000, 10_000, 100_000, 1_000_000), _bag("db3", "none")),
    "estimate bag": ("messages", (1_000, 10_000, 100_000, 1_000_000), _estimate),
    "estimate parquet": ("rows", (10_000, 100_000, 1_000_000, 10_000_000), _parquet_estimate),
}
PROCESSES = {"estimate bag", "estimate parquet"}


def measure(name: str, rounds: int, largest: int) -> dict[str, Any]:
    """Measure one stage at all its sizes up to the largest."""
    unit, sizes, make = GROWTH[name]
    rows = []
    for size in sizes:
        if size > largest:
            continue
        run = make(size, harness.inputs_folder())
        run()
        times = [harness.timed(run)[:2] for _ in range(rounds)]
        rows.append(
            {
                "size": size,
                "seconds": median(seconds for seconds, _ in times),
                "processor_seconds": median(busy for _, busy in times),
                "peak_MB": _peak(name, size),
            }
        )
    return {"stage": name, "unit": unit, "sizes": rows, "exponent": _exponent(rows)}


def _exponent(rows: Sequence[dict[str, Any]]) -> float:
    """Return the slope of log time over log size, where the time is not that of beginning."""
    upper = rows[len(rows) // 2 - (len(rows) == 2) :] if len(rows) > 1 else rows
    if len(upper) < 2:
        return math.nan
    x, y = (np.log([row[key] for row in upper]) for key in ("size", "processor_seconds"))
    return float(np.polyfit(x, y, 1)[0])


def _peak(name: str, size: int) -> float:
    return float(
        alone(["-m", "benchmarks.growth", "--peak", name, str(size)], harness.ROOT).output.split()[-1]
    )


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return the results as people read them."""
    lines = ["stage                  unit         size      time  processor   peak MB  exponent"]
    for result in results:
        for j, row in enumerate(result["sizes"]):
            name, unit = (result["stage"], result["unit"]) if j == 0 else ("", "")
            exponent = f"{result['exponent']:.2f}" if j == len(result["sizes"]) - 1 else ""
            lines.append(
                f"{name:<22} {unit:<9}{row['size']:>8.0e} {row['seconds']:>9.3g} {row['processor_seconds']:>10.3g}"
                f" {row['peak_MB']:>9.0f} {exponent:>9}"
            )
    return "\n".join(lines) + "\n"


def draw(results: Sequence[dict[str, Any]], path: Path) -> None:
    """Draw time and memory over size."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 6), sharex=True, layout="constrained")
    colours = plt.get_cmap("tab20").colors
    for result, colour in zip(results, colours, strict=False):
        sizes = [row["size"] for row in result["sizes"]]
        label = f"{result['stage']} ({result['unit']}): {result['exponent']:.2f}"
        for axis, key in zip(axes, ("processor_seconds", "peak_MB"), strict=True):
            axis.loglog(
                sizes, [row[key] for row in result["sizes"]], "o-", ms=3, lw=1.2, color=colour, label=label
            )
    low, high = axes[0].get_xlim()
    line = np.array([max(low, 1e3), high])
    axes[0].loglog(line, 1e-6 * line, "--", color="0.6", lw=1, label="1 µs each")
    axes[0].set(xlabel="size", ylabel="processor time in s", title="Time, and exponent of its growth")
    axes[1].set(xlabel="size", ylabel="peak memory in MB, inputs included", title="Memory")
    lines = axes[0].get_legend_handles_labels()
    figure.legend(*lines, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    for axis in axes:
        axis.grid(visible=True, which="major", color="0.9", lw=0.6)
        axis.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=90)
    plt.close(figure)


def peak(name: str, size: int) -> None:
    """Run one stage once and print what the operating system says of its memory in MB."""
    import resource

    GROWTH[name][2](size, harness.inputs_folder())()
    who = resource.RUSAGE_CHILDREN if name in PROCESSES else resource.RUSAGE_SELF
    print(resource.getrusage(who).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e6 / 1024))


def main() -> None:
    """Measure, print, write and draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument("stages", nargs="*", metavar="STAGE", help=f"all if none: {', '.join(GROWTH)}")
    parser.add_argument("--largest", type=int, default=10**9, help="leave out larger sizes")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--peak", nargs=2, help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.peak:
        peak(asked.peak[0], int(asked.peak[1]))
        return
    results = []
    for name in GROWTH:
        if not asked.stages or any(name.startswith(start) for start in asked.stages):
            results.append(measure(name, asked.rounds, asked.largest))
            print(table(results[-1:]).partition("\n")[2], end="", flush=True)
            harness.write("growth", table(results), {"machine": harness.machine(), "stages": results})
            draw(results, harness.RESULTS / "growth.png")


if __name__ == "__main__":
    main()
