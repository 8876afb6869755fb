"""Small missions, and a pool that works where it stands."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq
from wheel_table import ROVER, good, text

from terrain_cli import rover as rovers
from terrain_cli.batch import batch_inputs, batch_run, worker_tasks
from terrain_cli.run.settings import Settings

#: The quickest estimator: these tests are about what surrounds it.
METHOD = "least-squares"


def drive(shift=0.0, rows=60):
    """Return the text of a short drive; another one for each shift of the torque."""
    table = [[*row[:2], f"{float(row[2]) + shift:.6g}", *row[3:]] for row in good()[:rows]]
    return text(table)


def mission(folder, inputs_=("day1/a.csv", "day2/a.csv", "b.csv")):
    """Write some drives, a copy, and a file that is none; return the folder of inputs."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "rover.toml").write_text(f'{ROVER}[estimate]\nmethod = "{METHOD}"\n')
    for number, name in enumerate(inputs_):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(drive(0.1 * number))
    (folder / "copy.csv").write_text(drive(0.0))
    (folder / "empty.csv").write_text("")
    return folder


def files(folder):
    """Return what a batch promises to be the same however it came about: name → bytes."""
    folder = Path(folder)
    names = [folder / "segments.parquet", folder / "summary.json", *sorted((folder / "results").iterdir())]
    return {str(path.relative_to(folder)): path.read_bytes() for path in names}


def manifest(folder):
    """Return the lines of a manifest."""
    lines = (Path(folder) / "manifest.jsonl").read_text().splitlines()
    return [json.loads(line) for line in lines]


def by_path(output="out"):
    """Return the last line of each path."""
    return {line["path"]: line for line in manifest(output)}


def sources(output="out"):
    """Return the sources of the mission table, in its order."""
    return list(dict.fromkeys(pq.read_table(Path(output, "segments.parquet"))["source"].to_pylist()))


class Inline:
    """A pool without processes."""

    def __init__(self, slots=2, *_):
        self._slots = slots
        self._done = []
        self.tasks = []

    @property
    def free(self):
        return self._slots - len(self._done)

    def submit(self, ticket, task):
        self.tasks.append(task)
        try:
            reply = task.run()
        except Exception as error:  # noqa: BLE001 - as a worker does
            from terrain_cli.batch.worker_tasks import Reply, failure

            reply = Reply(failure=failure(error))
        self._done.append((ticket, reply))

    def collect(self, seconds):  # noqa: ARG002 - a pool's signature
        # The last first: as workers answer, in any order.
        return [self._done.pop()] if self._done else []

    def do(self, task):
        self.submit(0, task)
        return self._done.pop()[1]

    def close(self):
        self._done.clear()


def batch(names, output, *, rover=None, settings=None, **order):
    """Run a batch in this process."""
    found = batch_inputs.discover([str(name) for name in names])
    known = rovers.load(rovers.find(rover, found[0].location if found else None))
    gathered = worker_tasks.gather(known, settings or Settings(method=METHOD), None)
    asked = worker_tasks.Order(configuration=gathered, **order)
    return batch_run.run([str(name) for name in names], found, str(output), asked)
