"""Time and memory of long drives: ``python -m benchmarks.long_runs [MINUTES…]``.

Writes a ROS 1 bag of a six-wheel rover for each length, runs ``terrain-est estimate`` on it in a
process of its own, and prints what the operating system says of that. The bags are deleted.

    python -m benchmarks.long_runs > benchmarks/results/long_runs.txt
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from benchmarks import rover_bag
from benchmarks.alone import alone

MINUTES = (6, 20, 60)
CONTAINER = ("ros1", "none")


def main() -> None:
    """Measure each length."""
    lengths = [float(text) for text in sys.argv[1:]] or MINUTES
    print("terrain-est estimate on a ROS 1 bag: six wheels, fifteen topics")
    print("minutes   size MB    time s   processor s   s per minute   peak MB   segments")
    for minutes in lengths:
        with tempfile.TemporaryDirectory() as folder:
            bag = rover_bag.write(Path(folder), 60.0 * minutes, (CONTAINER,))[CONTAINER]
            table = Path(folder, "soil.csv")
            used = alone(["-m", "terrain_cli", "estimate", "-q", str(bag), "-o", str(table)])
            size, segments = bag.stat().st_size / 1e6, len(table.read_text().splitlines()) - 1
        print(
            f"{minutes:>7g} {size:>9.0f} {used.seconds:>9.2f} {used.busy:>13.2f} {used.busy / minutes:>14.3f}"
            f" {used.peak:>9.0f} {segments:>10}",
            flush=True,
        )


if __name__ == "__main__":
    main()
