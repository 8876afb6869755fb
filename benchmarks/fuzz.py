"""Hostile input for every reader and parser: none may crash, hang or say anything but one clear line.

    python benchmarks/fuzz.py [--inputs N] [--target NAME] [--seed S] [--record]

Each target gets its share of N inputs (1,015,900 by default) in a process of its own, made from small
whole files: at random, or by Atheris (libFuzzer, guided by the coverage of this program, rosbags and
tomllib) where it is installed and worth its time. An input that takes longer than PATIENCE seconds,
more memory than MEMORY, or ends in any error but those of `formats.errors` and `terrain_cli.errors` is a
finding. With --record the counts go to benchmarks/results/fuzz.txt.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests" / "formats")]

from benchmarks.fuzz_targets import targets  # noqa: E402

if TYPE_CHECKING:
    from benchmarks.fuzz_targets import Target

RESULT = HERE / "results" / "fuzz.txt"
#: Seconds and bytes that one small input may take.
PATIENCE = 5.0
MEMORY = 4 << 30
LARGEST = 60_000
#: Share of the inputs: parsers are quick, readers open a file for each.
SHARES = {
    "ros1": 20, "mcap": 20, "db3": 20, "ros1-salvage": 20, "mcap-salvage": 20, "db3-salvage": 20,
    "csv": 20, "csv-salvage": 20, "packed": 20, "parquet": 20,
    "metadata": 3, "idl": 1, "msg": 20, "model": 8, "effect": 12, "rover": 20,
    "conditions": 100, "toml": 150, "laws": 492,
}  # fmt: skip


#: Not worth being guided: most of their work is done in C, or they are simple and many inputs say more.
AT_RANDOM = {
    *("db3-salvage", "csv", "csv-salvage", "packed", "parquet"),
    *("msg", "model", "effect", "rover", "conditions", "toml", "laws"),
}


class Run:
    """Inputs of one target, counted; what goes wrong is kept once for each place in the program."""

    def __init__(self, name: str, target: Target, wanted: int, report: Path) -> None:
        self.name, self.target, self.wanted, self.report = name, target, wanted, report
        self.engine = "at random"
        self.done = self.accepted = 0
        self.began = time.perf_counter()
        self.slowest = 0.0
        self.findings: dict[str, str] = {}
        signal.signal(signal.SIGALRM, _too_long)

    def one(self, data: bytes) -> None:
        """Try one input."""
        from formats.errors import FormatError
        from terrain_cli.errors import TerrainError

        began = time.perf_counter()
        signal.setitimer(signal.ITIMER_REAL, PATIENCE)
        try:
            self.target(data)
            self.accepted += 1
        except (FormatError, TerrainError) as error:
            if "\n" in str(error) or not str(error):
                self.find("several lines", repr(str(error))[:200], data)
        except BaseException as error:  # noqa: BLE001 - this is what is looked for
            frames = [
                f for f in traceback.extract_tb(error.__traceback__) if "/benchmarks/" not in f.filename
            ]
            place = f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "?"
            own = [f for f in frames if "/formats/" in f.filename or "/terrain_cli/" in f.filename]
            via = f" via {Path(own[-1].filename).name}:{own[-1].lineno}" if own else ""
            self.find(f"{type(error).__name__} in {place}{via}", str(error)[:120], data)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
        self.slowest = max(self.slowest, time.perf_counter() - began)
        self.done += 1
        if self.done % 500 == 0 or self.done >= self.wanted:
            self.save()

    def find(self, key: str, text: str, data: bytes) -> None:
        """Keep a finding and its input."""
        if key not in self.findings:
            file = self.report.with_name(f"{self.name}-{len(self.findings)}.bin")
            file.write_bytes(data)
            self.findings[key] = f"{text} [{file}]"

    def save(self) -> None:
        """Write how far it is."""
        content = {
            "engine": self.engine, "done": self.done, "accepted": self.accepted,
            "seconds": time.perf_counter() - self.began, "slowest": self.slowest, "findings": self.findings,
        }  # fmt: skip
        self.report.write_text(json.dumps(content))


def _too_long(*_: object) -> None:
    raise TimeoutError(f"longer than {PATIENCE} s")


def child(name: str, inputs: int, seed: int, report: Path) -> None:
    """Feed one target until it has had its inputs."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY * 4, MEMORY * 4))
    try:
        import atheris
    except ImportError:
        atheris = None
    if atheris is None or name in AT_RANDOM:
        target, seeds = targets()[name]
        at_random(Run(name, target, inputs, report), seeds, inputs, seed)
        return
    with atheris.instrument_imports(include=["formats", "terrain_cli", "rosbags", "tomllib"]):
        target, seeds = targets()[name]
    run = Run(name, target, inputs, report)
    run.engine = "Atheris"
    corpus = Path(tempfile.mkdtemp(prefix="corpus-"))
    for k, data in enumerate(seeds):
        (corpus / str(k)).write_bytes(data)
    flags = [
        f"-runs={inputs + 100}",
        f"-seed={seed}",
        f"-max_len={LARGEST}",
        "-timeout=60",
        "-rss_limit_mb=0",
    ]
    quiet = ["-verbosity=0", "-print_final_stats=0", f"-artifact_prefix={report.parent}/{name}-native-"]

    def one(data: bytes) -> None:
        if run.done >= inputs:
            run.save()
            os._exit(0)
        run.one(data)

    atheris.Setup([sys.argv[0], *flags, *quiet, str(corpus)], one)
    atheris.Fuzz()


def at_random(run: Run, seeds: list[bytes], inputs: int, seed: int) -> None:
    """Change whole inputs at random."""
    chance = random.Random(seed)  # noqa: S311 - not for secrets
    pool = list(seeds)
    for _ in range(inputs):
        data = bytearray(chance.choice(pool))
        for _ in range(chance.choice((1, 1, 2, 4, 8))):
            mutate(data, chance, pool)
        before = run.accepted
        run.one(bytes(data[:LARGEST]))
        if run.accepted > before and len(pool) < 200 and chance.random() < 0.05:
            pool.append(bytes(data[:LARGEST]))


def mutate(data: bytearray, chance: random.Random, pool: list[bytes]) -> None:
    """Change some bytes."""
    at = chance.randrange(len(data) + 1)
    size = min(chance.choice((1, 2, 4, 8, 16, 64)), len(data) - at)
    match chance.randrange(8):
        case 0 if data:
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
        case 1:
            data[at : at + size] = chance.randbytes(size)
        case 2:
            del data[at : at + size]
        case 3:
            data[at:at] = data[at : at + size] * chance.choice((1, 2, 50))
        case 4:
            edge = chance.choice((0, 1, -1, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1, 10**9))
            data[at : at + 8] = (edge % 2**64).to_bytes(8, "little")[: chance.choice((1, 2, 4, 8))]
        case 5:
            del data[at:]
        case 6:
            other = chance.choice(pool)
            begin = chance.randrange(len(other) + 1)
            data[at : at + size] = other[begin : begin + chance.choice((4, 16, 64, 256))]
        case _:
            data[at:at] = chance.choice(
                (b"(", b"[", b"{", b'"', b"\n", b"\0", b".", b"=", b"9" * 30, b"a" * 80, b"-", b"e")
            )


def main() -> int:
    """Run every target and tell what came of it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--inputs", type=int, default=1_015_900)
    parser.add_argument("--target", action="append", choices=SHARES)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--reports", type=Path, help="folder of an earlier run that is to go on")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--report", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(given.child, given.inputs, given.seed, given.report)
        return 0
    folder = given.reports or Path(tempfile.mkdtemp(prefix="fuzz-reports-"))
    print(f"reports in {folder}", flush=True)
    whole = sum(SHARES.values())
    outcomes = []
    for name in given.target or SHARES:
        outcomes.append(one_target(name, -(-given.inputs * SHARES[name] // whole), given.seed, folder))
        print(outcomes[-1], flush=True)
    if given.record:
        write(outcomes, given)
    return int(any(outcome.findings for outcome in outcomes))


@dataclass
class Outcome:
    """What came of one target."""

    name: str
    engines: set[str] = field(default_factory=set)
    done: int = 0
    accepted: int = 0
    seconds: float = 0.0
    slowest: float = 0.0
    findings: dict[str, str] = field(default_factory=dict)

    def add(self, report: dict[str, Any]) -> None:
        """Take in what one process reported."""
        self.engines |= {report["engine"]} if report["done"] else set()
        self.done += report["done"]
        self.accepted += report["accepted"]
        self.seconds += report["seconds"]
        self.slowest = max(self.slowest, report["slowest"])
        self.findings |= report["findings"]

    def __str__(self) -> str:
        line = (
            f"{self.name:13} {' + '.join(sorted(self.engines)):9} {self.done:>9,} {self.accepted:>9,}"
            f" {self.seconds:7.0f} s {self.slowest:7.2f} s   {len(self.findings)}"
        )
        return "\n".join([line, *(f"    {key}: {text}" for key, text in self.findings.items())])


def one_target(name: str, wanted: int, seed: int, folder: Path) -> Outcome:
    """Feed one target in processes of its own; one that dies is a finding, and another goes on."""
    outcome = Outcome(name)
    for attempt in range(20):
        report = folder / f"{name}-{attempt}.json"
        if not report.exists():
            command = [sys.executable, __file__, "--child", name, "--report", str(report)]
            command += ["--inputs", str(wanted - outcome.done), "--seed", str(seed + attempt)]
            ended = subprocess.run(command, capture_output=True, text=True, check=False)
            if ended.returncode:
                outcome.findings[f"a process ended with {ended.returncode}"] = " | ".join(
                    ended.stderr.splitlines()[-4:]
                )
        if report.exists():
            outcome.add(json.loads(report.read_text()))
        if outcome.done >= wanted:
            break
    return outcome


def write(outcomes: list[Outcome], given: argparse.Namespace) -> None:
    """Record a run."""
    total = sum(outcome.done for outcome in outcomes)
    found = sum(len(outcome.findings) for outcome in outcomes)
    head = [
        f"python benchmarks/fuzz.py --inputs {given.inputs} --seed {given.seed} --record",
        f"Python {sys.version.split()[0]}; {total:,} inputs in all, {found} findings.",
        f"Allowed: {PATIENCE:g} s for an input, and the errors of formats.errors and terrain_cli.errors.",
        "Times are of a machine that was busy with other work; accepted: inputs that were read as whole ones.",
        "",
        f"{'target':13} {'engine':9} {'inputs':>9} {'accepted':>9} {'time':>9} {'slowest':>9}   findings",
    ]
    RESULT.write_text("\n".join([*head, *map(str, outcomes)]) + "\n")


if __name__ == "__main__":
    sys.exit(main())
