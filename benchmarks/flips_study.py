"""Which changed bits are seen: one bit changed at a time, anywhere in a small file of every kind.

    python benchmarks/flips_study.py --record

prints the table of docs/damage.md. Each file is read without --salvage and with it. A change is *refused*
where the file is; *told* where what was read comes with a word of damage or a remark that the whole file has
not. Nothing tells where it is *renamed*, all values and times as they were, but a topic or field of another
name, and where it is *wrong*, a value or time another or not there. Else it is *harmless*.
"""

from __future__ import annotations

import argparse
import bz2
import gzip
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "formats")]
RESULT = ROOT / "benchmarks" / "results" / "flips.txt"
MESSAGES, ROWS = 25, 40
KINDS = {"ros1": "ROS 1", "mcap": "MCAP", "db3": "SQLite (db3)"}
FATES = ("refused", "told", "wrong", "renamed", "harmless")


def files(folder: Path) -> dict[str, Path]:
    """Write a small whole file of every kind; return them by what they are called in the table."""
    import pyarrow as pa
    import pyarrow.parquet as pq
    from salvage_cases import CASES, write

    from formats.rosbag.storage.raw_messages import zstd

    found = {}
    for kind, packing in CASES:
        (own := folder / f"{kind}-{packing}").mkdir()
        words = {"none": "", "crc": ", checksums"}.get(packing, f", {packing}")
        found[f"{KINDS[kind]}{words}"] = write(own, kind, packing, MESSAGES)
    text = ("time,load\n" + "".join(f"{k / 10},{80 + k % 7 / 8}\n" for k in range(ROWS))).encode()
    summed = {zstd.CompressionParameter.checksum_flag: 1}
    packed = {
        "": text,
        ", gzip": gzip.compress(text, mtime=0),
        ", bzip2": bz2.compress(text),
        ", zstd": zstd.compress(text),
        ", zstd, checksum": zstd.compress(text, options=summed),
    }
    for words, data in packed.items():
        found[f"CSV{words}"] = folder / f"a{len(found)}.csv"
        found[f"CSV{words}"].write_bytes(data)
    table = pa.table({"time": [k / 10 for k in range(ROWS)], "load": [80 + k % 7 / 8 for k in range(ROWS)]})
    for checksums in (False, True):
        found[f"Parquet{', checksums' * checksums}"] = path = folder / f"{checksums}.parquet"
        pq.write_table(table, path, write_page_checksum=checksums)
    return found


def contents(path: Path, *, salvage: bool) -> tuple[Any, tuple[str, ...]] | None:
    """Return every value, and all that is said of the file; None where it is refused."""
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
        return None
    damage = source.recovery.damage if source.recovery else ()
    return values, (*source.remarks, *damage)


def study(path: Path, flips: list[tuple[int, int]], *, salvage: bool) -> Counter[str]:
    """Return how many of these changed bits, each a place and a bit, met which fate."""
    data = path.read_bytes()
    whole = contents(path, salvage=salvage)
    if whole is None:
        raise RuntimeError(f"{path} is refused as it is")
    fates: Counter[str] = Counter()
    for at, bit in flips:
        path.write_bytes(data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :])
        found = contents(path, salvage=salvage)
        if found is None:
            fates["refused"] += 1
        elif found[1] != whole[1]:
            fates["told"] += 1
        elif found[0] == whole[0]:
            fates["harmless"] += 1
        else:
            same = sorted(map(str, found[0].values())) == sorted(map(str, whole[0].values()))
            fates["renamed" if same else "wrong"] += 1
    path.write_bytes(data)
    return fates


def row(cells: list[Any]) -> str:
    """Return a row of a table in Markdown."""
    return f"| {' | '.join(map(str, cells))} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flips", type=int, default=1_000, help="bits changed in each file, one at a time")
    parser.add_argument("--seed", type=int, default=1, help="of the places and bits")
    parser.add_argument("--record", action="store_true", help="keep the table under benchmarks/results")
    given = parser.parse_args()
    rng = np.random.default_rng(given.seed)
    lines: list[str] = []

    def say(line: str) -> None:
        print(line, flush=True)
        lines.append(line)

    say(f"{given.flips:,} bits changed in each file, one at a time; seed {given.seed}\n")
    say(row(["file", "bytes", *FATES, *(f"`--salvage`: {FATES[0]}", *FATES[1:])]))
    say(row(["---"] * (2 + 2 * len(FATES))))
    with tempfile.TemporaryDirectory() as folder:
        for name, path in files(Path(folder)).items():
            size = path.stat().st_size
            flips = [
                *zip(
                    rng.integers(size, size=given.flips).tolist(),
                    rng.integers(8, size=given.flips).tolist(),
                    strict=True,
                )
            ]
            counts = [study(path, flips, salvage=salvage) for salvage in (False, True)]
            say(row([name, f"{size:,}", *(count[fate] for count in counts for fate in FATES)]))
    if given.record:
        RESULT.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
