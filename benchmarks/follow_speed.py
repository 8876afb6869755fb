"""How fast `estimate --follow` is: a row until its estimate is there, times real time, and memory.

    python benchmarks/follow_speed.py [SECONDS]

writes benchmarks/results/follow_speed.txt: SECONDS of driving, 300 by default, of 6 wheels at 50 Hz. All times are
of the processor. Beside it stands recursive least squares written in NumPy, which is given x and y. A bag with a
topic for each sensor, of the same wheels and rates, is followed as it is recorded, a tenth of a second at a time.
"""

from __future__ import annotations

import os

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from simulator import CLAYEY_SOIL, DRY_SAND, base_contact, one_wheel, simulate, undulation, wave  # noqa: E402

import formats  # noqa: E402
from benchmarks.published import publish  # noqa: E402 - found through the path above
from formats.text.arriving_rows import ArrivingRows  # noqa: E402
from terrain_cli.estimation import estimators  # noqa: E402
from terrain_cli.rover import rover_file  # noqa: E402
from terrain_cli.run.settings import Settings  # noqa: E402
from terrain_cli.stream.arriving_samples import RowSamples  # noqa: E402
from terrain_cli.stream.follow import Follow  # noqa: E402
from terrain_cli.stream.followed_wheel import CommonStress, FollowedWheel  # noqa: E402

RESULT = HERE / "results" / "follow_speed.txt"
ROVER = rover_file.of_text("[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n")
WHEELS, RATE = 6, 50.0
#: Seconds of one soil.
SOIL = 100.0
BLOCK = 1 << 16


class Silent:
    """Who is told, and keeps nothing."""

    rows = 0

    def closed(self, row):
        self.rows += len(row["wheel"])

    def open(self, rows):
        del rows

    def now(self, text):
        del text

    def remark(self, text):
        del text


def stream(seconds):
    """Return the lines of a drive over sand and clay in turn."""
    soils = [base_contact(soil) for soil in (DRY_SAND, CLAYEY_SOIL)]
    tables = []
    for seed in range(WHEELS):
        drive = one_wheel(
            [(soils[k % 2], min(SOIL, seconds)) for k in range(max(int(seconds / SOIL), 1))],
            load=undulation(80.0, 0.25, 7.0, seed=seed),
            slip=wave(0.3, 0.4, 11.0),
            noise=0.03,
            rate=RATE,
            seed=seed,
        )
        tables.append(simulate(drive).columns())
    names = [name for name in tables[0] if name != "wheel"]
    rows = [",".join(["wheel", *names])]
    columns = [[np.asarray(table[name]).tolist() for name in names] for table in tables]
    for k in range(min(len(table[0]) for table in columns)):
        rows += [
            ",".join([f"wheel-{w}", *(repr(column[k]) for column in table)])
            for w, table in enumerate(columns)
        ]
    return rows


def blocks(lines):
    data = ("\n".join(lines) + "\n").encode()
    return (data[first : first + BLOCK] for first in range(0, len(data), BLOCK))


def throughput(lines, **settings):
    """Return processor seconds, and the segments."""
    told, began = Silent(), time.process_time()
    Follow(ROVER, Settings(**settings), told, every=None).run(blocks(lines), "-")
    return time.process_time() - began, told.rows


def latencies(lines, count):
    """Return ms from each row to the estimate that has it, row by row; half of the rows come before."""
    rows = ArrivingRows("-")
    rows.prepare(("\n".join(lines[:100]) + "\n").encode(), hurry=True)
    settings, stress = Settings(method="recursive"), CommonStress(None)
    samples, wheels, took = RowSamples(rows, ROVER, settings, None), {}, []
    for part in samples.take(rows.take()):
        wheels[part.wheel] = FollowedWheel(settings, None, stress)
        list(wheels[part.wheel].take(part))
    for line in lines[100 : 100 + count]:
        data = f"{line}\n".encode()
        began = time.process_time()
        for part in samples.take(rows.take(data)):
            list(wheels[part.wheel].take(part))
            estimate = wheels[part.wheel].soil
        took.append(1e3 * (time.process_time() - began))
        if not np.isfinite(estimate[0]):
            raise SystemExit("there is no estimate")
    return np.array(took[count // 2 :])


def recorded(folder, seconds):
    """Write a bag without chunks; return its path, and where each tenth of a second of it ends."""
    whole, path = folder / "whole.mcap", folder / "run.mcap"
    command = [sys.executable, "-m", "terrain_cli", "simulate", "-q", "-o", whole, "--wheels", str(WHEELS)]
    command += ["--rate", f"{RATE:g}", "--duration", f"{seconds:g}", "--rover", folder / "rover.toml"]
    subprocess.run(command, cwd=HERE.parent, check=True)
    ends, channels = [], {}
    with whole.open("rb") as source, path.open("wb") as target:
        writer = Writer(target, use_chunking=False)
        writer.start("ros2")
        for schema, channel, message in make_reader(source).iter_messages():
            if channel.topic not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.topic] = writer.register_channel(channel.topic, "cdr", number)
            if not ends or message.log_time >= ends[-1][1] + 100_000_000:
                ends.append((target.tell(), message.log_time))
            writer.add_message(channels[channel.topic], message.log_time, message.data, message.log_time)
        writer.finish()
    return path, [*(end for end, _ in ends), path.stat().st_size]


def of_bag(seconds):
    """Return the share of a processor that following a bag takes, and its topics."""
    with tempfile.TemporaryDirectory() as folder:
        path, ends = recorded(Path(folder), seconds)
        data, growing = path.read_bytes(), path.with_name("growing.mcap")

        def pieces():
            with growing.open("wb") as file:
                for begin, end in zip([0, *ends], ends, strict=False):
                    file.write(data[begin:end])
                    file.flush()
                    yield data[begin:end]

        rover = rover_file.of_text((path.parent / "rover.toml").read_text("utf-8"))
        began = time.process_time()
        Follow(rover, Settings(method="recursive"), Silent(), every=None).run(pieces(), str(growing))
        return (time.process_time() - began) / seconds, len(formats.open_source(str(path)).streams())


def opened(lines):
    """Return ms of each open row by the full model, one after each second of one wheel."""
    settings, stress = Settings(), CommonStress(None)
    wheel = FollowedWheel(settings, estimators.choose(settings.method), stress)
    own = [line for line in lines[1:] if line.startswith("wheel-0,")]
    rows = ArrivingRows("-")
    rows.prepare(("\n".join([lines[0], *own[:100]]) + "\n").encode(), hurry=True)
    samples, took = RowSamples(rows, ROVER, settings, None), []
    for first in range(100, len(own), int(RATE)):
        for part in samples.take(rows.take(("\n".join(own[first : first + int(RATE)]) + "\n").encode())):
            list(wheel.take(part))
        began = time.process_time()
        row = wheel.open_row()
        if row["method"] == ["wong-reece"]:
            took.append(1e3 * (time.process_time() - began))
    return np.array(took)


def plain(count):
    """Return ms of each step of recursive least squares of (c, tan φ), in NumPy."""
    rng = np.random.default_rng(0)
    x = 1e4 * (1.0 + 0.1 * rng.standard_normal(count))
    y = 1e3 + 0.6 * x + 100.0 * rng.standard_normal(count)
    state, covariance, took = np.zeros(2), np.diag([1e12, 1e4]), []
    for stress, strength in zip(x, y, strict=True):
        began = time.process_time()
        row = np.array([1.0, stress])
        gain = covariance @ row / (row @ covariance @ row + 1e4)
        state = state + gain * (strength - row @ state)
        covariance = covariance - np.outer(gain, row @ covariance)
        took.append(1e3 * (time.process_time() - began))
    return np.array(took)


def report(seconds):
    lines = stream(seconds)
    size = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    yield from (
        "estimate --follow: speed and memory, in times of the processor",
        "",
        f"{WHEELS} wheels at {RATE:g} Hz, {seconds:g} s, {len(lines) - 1} rows; a soil lasts {SOIL:g} s",
        "",
        f"{'a row until its estimate is there, ms':<44}{'median':>8}{'95 %':>8}",
    )
    for what, took in (
        ("row by row, from its bytes on", latencies(lines, 3000)),
        ("recursive least squares alone, plain NumPy", plain(3000)),
    ):
        yield f"  {what:<42}{np.median(took):8.3f}{np.percentile(took, 95):8.3f}"
    yield f"  {'the aim':<42}{1.0:8.3f}"
    took = opened(lines)
    yield from (
        "",
        f"{'an open row by the full model, ms':<44}{'median':>8}{'95 %':>8}",
        f"  {'one wheel, every second':<42}{np.median(took):8.0f}{np.percentile(took, 95):8.0f}",
    )
    yield from ("", f"{'all at once':<44}{'s':>8}{'segments':>10}{'× real time':>14}")
    for name, settings in (
        ("--method recursive", {"method": "recursive"}),
        ("--method least-squares", {"method": "least-squares"}),
        ("the default, the full model at each close", {}),
    ):
        took, rows = throughput(lines, **settings)
        yield f"  {name:<42}{took:8.2f}{rows:10d}{seconds / took:14.1f}"
    more = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024 - size
    share, topics = of_bag(seconds)
    yield from ("", f"a bag of {topics} topics as it is recorded: {100 * share:.1f} % of the processor")
    yield from ("", f"memory beyond that of the lines themselves at most: {more:.0f} MB")


def main():
    publish(report(float(sys.argv[1]) if len(sys.argv) > 1 else 300.0), RESULT)


if __name__ == "__main__":
    main()
