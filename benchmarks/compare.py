"""Which stages one commit made slower: ``python -m benchmarks.compare OLD [NEW] [STAGE…]``.

Each commit is unpacked into a temporary folder; its program is measured by the stages of this
working tree, in processes of the same interpreter that take turns. OLD and NEW are anything git
knows; NEW is the working tree if it is ".". A stage is called slower or faster where the 95 %
interval of the median ratio of pairs, from a bootstrap, and a sign test both leave out 1, and the
median is off by more than 3 %. Exits with 1 if a stage became slower.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.stages import STAGES

#: Smaller changes are not told, however sure.
LEAST = 0.03
LEVEL = 0.05
#: Runs in one process; the first warms caches and does not count.
WITHIN = 3


def judge(old: list[float], new: list[float]) -> dict[str, Any]:
    """Compare pairs of times.

    Parameters
    ----------
    old, new : list of float, shape (n,)
        Of runs that took turns.

    Returns
    -------
    dict
        ratio (new over old, median of the pairs), low and high of its 95 % interval, p of the sign
        test, and verdict: "slower", "faster" or "".
    """
    logs = np.log(np.asarray(new) / np.asarray(old))
    rng = np.random.default_rng(1)
    medians = np.median(rng.choice(logs, (10_000, len(logs))), axis=1)
    low, high = np.quantile(medians, [LEVEL / 2.0, 1.0 - LEVEL / 2.0])
    above = int(np.sum(logs > 0.0))
    extreme = max(above, len(logs) - above)
    p = min(1.0, 2.0 * sum(math.comb(len(logs), k) for k in range(extreme, len(logs) + 1)) / 2.0 ** len(logs))
    middle = float(np.median(logs))
    sure = p <= LEVEL and (low > 0.0 or high < 0.0) and abs(math.expm1(middle)) > LEAST
    return {
        "ratio": math.exp(middle),
        "low": math.exp(low),
        "high": math.exp(high),
        "p": p,
        "verdict": ("slower" if middle > 0.0 else "faster") if sure else "",
    }


def once(name: str, size: str) -> None:
    """Print the time of our way of one stage, of the program that is on the path."""
    case = STAGES[name].make(size, harness.inputs_folder())
    times = [harness.timed(case.ours)[:2] for _ in range(WITHIN)]
    print(json.dumps([min(seconds for seconds, _ in times[1:]), min(busy for _, busy in times[1:])]))


def run(tree: Path, name: str, size: str) -> list[float] | None:
    """Time a stage of the program in one folder; None if it does not know what the stage needs."""
    # Benchmarks first, as a package of this working tree; then the program of that commit.
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tree)]), "TERRAIN_EST_TREE": str(tree)}
    code = (
        "import sys; sys.path[:] = [p for p in sys.path if p not in ('', sys.argv[1])]; sys.path.insert(0, sys.argv[1]);"
        "import terrain_cli, formats, types; b = types.ModuleType('benchmarks'); b.__path__ = [sys.argv[2]];"
        "sys.modules['benchmarks'] = b;"
        "assert terrain_cli.__file__.startswith(sys.argv[1]), terrain_cli.__file__;"
        "from benchmarks import compare; compare.once(*sys.argv[3:])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tree), str(harness.ROOT / "benchmarks"), name, size],
        cwd=tree,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        print(f"{name}: {tree.name} cannot run it: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    return json.loads(done.stdout.splitlines()[-1])


def main() -> int:
    """Compare two commits and print a table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.compare", description=__doc__)
    parser.add_argument("old")
    parser.add_argument("new", nargs="?", default=".")
    parser.add_argument("stages", nargs="*", metavar="STAGE")
    parser.add_argument("--size", choices=harness.SIZES, default="medium")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument(
        "--processor", action="store_true", help="compare the processor's time, on a busy machine"
    )
    asked = parser.parse_args()
    names = [name for name in STAGES if not asked.stages or any(name.startswith(s) for s in asked.stages)]
    results: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        trees = {commit: tree_of(commit, Path(folder)) for commit in (asked.old, asked.new)}
        try:
            print(f"{'stage':<22}{'old':>10}{'new':>10}{'new/old':>9}   95 % interval   sign test")
            for name in names:
                times: dict[str, list[list[float]]] = {commit: [] for commit in trees}
                for turn in range(asked.rounds):
                    order = list(trees) if turn % 2 else list(trees)[::-1]
                    found = {commit: run(trees[commit], name, asked.size) for commit in order}
                    if None in found.values():
                        break
                    for commit, seconds in found.items():
                        times[commit].append(seconds)
                else:
                    old, new = ([t[asked.processor] for t in times[c]] for c in (asked.old, asked.new))
                    results[name] = judge(old, new)
                    print(_line(name, old, new, results[name]), flush=True)
        finally:
            for tree in trees.values():
                discard(tree)
    slower = [name for name, result in results.items() if result["verdict"] == "slower"]
    print(f"slower beyond the noise: {', '.join(slower) or 'none'}")
    return 1 if slower else 0


def _line(name: str, old: list[float], new: list[float], result: dict[str, Any]) -> str:
    return (
        f"{name:<22}{np.median(old):>10.4g}{np.median(new):>10.4g}{result['ratio']:>9.3f}"
        f"   {result['low']:.3f} to {result['high']:.3f}  p = {result['p']:.3f}  {result['verdict']}"
    )


def tree_of(commit: str, folder: Path) -> Path:
    """Unpack a commit into a folder of its own there; "." is the working tree itself."""
    if commit == ".":
        return harness.ROOT
    tree = folder / commit.replace("/", "-")
    _git("worktree", "add", "--detach", "--quiet", str(tree), commit)
    return tree


def discard(tree: Path) -> None:
    """Remove what `tree_of` unpacked."""
    if tree != harness.ROOT:
        _git("worktree", "remove", "--force", str(tree))


def _git(*arguments: str) -> None:
    subprocess.run(["git", *arguments], cwd=harness.ROOT, check=True, stdout=subprocess.DEVNULL)


if __name__ == "__main__":
    sys.exit(main())
