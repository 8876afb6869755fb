"""Which changed bits are seen: one bit changed at a time, all over a small file of every kind.

Prints the table of docs/damage.md. Each file is read with --salvage and without. A change is *found* where
the file is refused, or is told as damaged; *harmless* where every value and time is as it was; and else
*wrong*: a value, a time or a name is another, and nothing tells.
"""

from __future__ import annotations

import argparse
import bz2
import gzip
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "formats")]
RESULT = ROOT / "benchmarks" / "results" / "flips.txt"
ROWS = 40


def files(folder: Path) -> dict[str, Path]:
    """Write a small whole file of every kind; return them by what they are called in the table."""
    import pyarrow as pa
    import pyarrow.parquet as pq
    from salvage_cases import CASES, write

    from formats.rosbag.unpacking import zstd

    found = {}
    for kind, packing in CASES:
        (own := folder / f"{kind}-{packing}").mkdir()
        found[f"{kind} {packing}"] = write(own, kind, packing, 25)
    text = ("time,load\n" + "".join(f"{k / 10},{80 + k % 7 / 8}\n" for k in range(ROWS))).encode()
    packers = {"": bytes, ".gz": gzip.compress, ".bz2": bz2.compress, ".zst": zstd.compress}
    for ending, pack in packers.items():
        found[f"csv{ending}"] = folder / f"a.csv{ending}"
        found[f"csv{ending}"].write_bytes(pack(text))
    table = pa.table({"time": [k / 10 for k in range(ROWS)], "load": [80 + k % 7 / 8 for k in range(ROWS)]})
    for checksums in (False, True):
        found[f"parquet{' crc' * checksums}"] = path = folder / f"{checksums}.parquet"
        pq.write_table(table, path, write_page_checksum=checksums)
    return found


def outcome(path: Path, *, salvage: bool) -> tuple[bool, Any]:
    """Return whether damage is told, and every value; the latter None where the file is refused."""
    from salvage_cases import column_bits

    from formats import FormatError, open_source

    values = {}
    try:
        source = open_source(str(path), salvage=salvage)
        for stream in source.streams():
            asked = [
                f"{field.name}[{element}]" if field.elements else field.name
                for field in stream.fields
                for element in (field.elements or [""])
                if field.elements or field.kind in {"number", "text", "time"}
            ]
            for number, batch in enumerate(source.read(stream.topic, asked)):
                for name, column in batch.items():
                    values[stream.topic, name, number] = column_bits(column)
    except FormatError:
        return True, None
    # Without salvage a remark is all that tells.
    return bool(source.recovery.damaged if source.recovery else False), (values, tuple(source.remarks))


def study(path: Path, places: int, *, salvage: bool) -> tuple[int, int, int]:
    """Return how many changed bits are found, harmless and wrong."""
    data = path.read_bytes()
    _, whole = outcome(path, salvage=salvage)
    counts = [0, 0, 0]
    for k in range(places):
        at = k * len(data) // places
        path.write_bytes(data[:at] + bytes([data[at] ^ 1 << k * 5 % 8]) + data[at + 1 :])
        told, found = outcome(path, salvage=salvage)
        if told or (found[0] != whole[0] and found[1] != whole[1]):
            counts[0] += 1
        else:
            counts[1 if found[0] == whole[0] else 2] += 1
    path.write_bytes(data)
    return counts[0], counts[1], counts[2]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--places", type=int, default=300, help="bits changed in each file")
    parser.add_argument("--record", action="store_true")
    given = parser.parse_args()
    lines = [f"{given.places} bits in each file", f"{'':14} {'without salvage':>25} {'with salvage':>25}"]
    lines.append(f"{'file':14}" + f" {'found':>9}{'harmless':>9}{'wrong':>7}" * 2)
    with tempfile.TemporaryDirectory() as folder:
        for name, path in files(Path(folder)).items():
            counts = (study(path, given.places, salvage=salvage) for salvage in (False, True))
            lines.append(f"{name:14}" + "".join(f" {f:>9}{h:>9}{w:>7}" for f, h, w in counts))
            print(lines[-1], flush=True)
    if given.record:
        RESULT.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
