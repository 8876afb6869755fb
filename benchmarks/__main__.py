"""``python -m benchmarks``: see the package."""

from __future__ import annotations

import argparse
import json
from typing import Any

from benchmarks import harness
from benchmarks.stages import MISSING, STAGES


def main() -> None:
    """Measure the stages asked for, print the table and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("stages", nargs="*", metavar="STAGE", help=f"all if none: {', '.join(STAGES)}")
    parser.add_argument("--size", choices=harness.SIZES, default="medium")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--name", help="of the files in benchmarks/results; '' for none  [benchmarks, _SIZE if not medium]"
    )
    parser.add_argument("--no-memory", action="store_true")
    asked = parser.parse_args()
    for module, error in MISSING.items():
        parser.error(f"the stages {module} cannot be measured: {error}")
    chosen = [
        name for name in STAGES if not asked.stages or any(name.startswith(start) for start in asked.stages)
    ]
    if not chosen:
        parser.error(f"no such stage; there are {', '.join(STAGES)}")
    about = harness.machine()
    if asked.name is None:
        asked.name = "benchmarks" if asked.size == "medium" else f"benchmarks_{asked.size}"
    rows = kept(asked.name, asked.size) if asked.name else {}
    for name in chosen:
        rows[name] = harness.measure(STAGES[name], asked.size, asked.rounds, memory=not asked.no_memory)
        print(harness.table([rows[name]]).splitlines()[1], flush=True)
        if asked.name:
            ordered = [rows[stage] for stage in STAGES if stage in rows]
            content = {"size": asked.size, "machine": about, "rows": ordered}
            harness.write(asked.name, heading(asked.size, about) + harness.table(ordered), content)
    print("\n" + heading(asked.size, about) + harness.table([rows[name] for name in chosen]), end="")


def heading(size: str, about: dict[str, Any]) -> str:
    """Return what the figures depend on."""
    packages = ", ".join(f"{package} {version}" for package, version in about["packages"].items())
    return f"Size {size}; medians of interleaved runs; Python {about['python']}, {about['cores']} cores, {packages}\n\n"


def kept(name: str, size: str) -> dict[str, Any]:
    """Return the rows that earlier runs have written of the same size: a stage can be measured alone."""
    path = harness.RESULTS / f"{name}.json"
    if not path.exists():
        return {}
    written = json.loads(path.read_text(encoding="utf-8"))
    return {row["stage"]: row for row in written["rows"]} if written["size"] == size else {}


if __name__ == "__main__":
    main()
