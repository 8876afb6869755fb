"""Memory and speed of `estimate --follow` over a day of driving, through a pipe, as fast as it goes.

    python benchmarks/follow_day.py [HOURS]

writes benchmarks/results/follow_day.txt: HOURS, 24 by default, of 6 wheels at 50 Hz, by the recursive estimator. A
day takes some 25 minutes of one core.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent)]

from benchmarks.follow_speed import RATE, SOIL, WHEELS, stream  # noqa: E402 - found through the path above
from benchmarks.published import publish  # noqa: E402 - found through the path above

RESULT = HERE / "results" / "follow_day.txt"
#: Seconds of the drive that goes round and round.
LAP = 300.0
ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"


def laps(lines):
    """Return a function that gives the lines of a lap, by its number."""
    place = lines[0].split(",").index("time")
    cells = [line.split(",") for line in lines[1:]]
    parts = [(",".join(row[:place]), float(row[place]), ",".join(row[place + 1 :])) for row in cells]
    first = min(when for _, when, _ in parts)
    return lambda lap: "".join(
        f"{before},{when - first + lap * LAP:.2f},{after}\n" for before, when, after in parts
    )


def memory(process):
    """Return the MB that a process holds."""
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
    return int(status.partition("VmRSS:")[2].split()[0]) / 1024


def report(hours):
    lines = stream(LAP)
    lap_of = laps(lines)
    yield from (
        "estimate --follow over a day, as fast as it goes: memory, speed and closed segments after each hour of driving",
        "",
        f"{WHEELS} wheels at {RATE:g} Hz, a new soil every {SOIL:g} s, --method recursive, through a pipe",
        "",
        f"{'hour':>6}{'rows':>14}{'segments':>10}{'MB':>8}{'× real time':>14}",
    )
    with tempfile.TemporaryDirectory() as folder:
        rover, table = Path(folder, "rover.toml"), Path(folder, "soil.csv")
        rover.write_text(ROVER, encoding="utf-8")
        command = [sys.executable, "-m", "terrain_cli", "estimate", "--follow", "-", "--rover", str(rover)]
        with subprocess.Popen(
            [*command, "--method", "recursive", "-o", str(table)], stdin=subprocess.PIPE, text=True
        ) as process:
            process.stdin.write(lines[0] + "\n")
            began = time.monotonic()
            for lap in range(round(hours * 3600.0 / LAP)):
                process.stdin.write(lap_of(lap))
                if (lap + 1) * LAP % 3600.0 == 0.0:
                    now = time.monotonic()
                    process.stdin.flush()
                    with table.open(encoding="utf-8") as rows:
                        closed = sum(1 for _ in rows) - 1
                    yield (
                        f"{(lap + 1) * LAP / 3600.0:6.0f}{(lap + 1) * (len(lines) - 1):14,d}{closed:10d}"
                        f"{memory(process):8.0f}{3600.0 / (now - began):14.0f}"
                    )
                    began = now
            process.stdin.close()


def main():
    publish(report(float(sys.argv[1]) if len(sys.argv) > 1 else 24.0), RESULT)


if __name__ == "__main__":
    main()
