"""A batch on a Dask cluster: a real scheduler and workers, on loopback."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import missions
import pytest

from terrain_cli.batch import batch_inputs
from terrain_cli.batch.worker_tasks import Estimate, Order, gather
from terrain_cli.rover import Rover
from terrain_cli.run.settings import Settings

ROOT = Path(__file__).resolve().parent.parent.parent
#: Workers tell which input they have begun, and are as slow as a file says.
SITE = """
import os, time
from pathlib import Path
from terrain_cli.run import one_log
own, here = one_log.run, Path(__file__).parent
def run(path, *args, **options):
    with (here / "begun").open("a") as file:
        file.write(f"{path} {os.getppid()}\\n")
    seconds, which = (here / "slow").read_text().split()
    time.sleep(float(seconds) if path.endswith(which) else 0.0)
    return own(path, *args, **options)
one_log.run = run
"""


class DaskCluster:
    """A scheduler with workers, each a process of its own."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "sitecustomize.py").write_text(SITE)
        self.slow(0)
        self.processes = []
        self.address = self._start(
            r"Scheduler at:\s+(tcp://\S+)", "scheduler", "--port", "0", "--host", "127.0.0.1"
        )

    def slow(self, seconds, which=".csv"):
        (self.folder / "slow").write_text(f"{seconds} {which}")
        (self.folder / "begun").write_text("")

    def begun(self):
        """Return the inputs that workers have begun, and the numbers of these."""
        return [line.split() for line in (self.folder / "begun").read_text().splitlines()]

    def worker(self, site=""):
        """Start a worker, and return its process."""
        options = (
            "--nthreads",
            "1",
            "--no-nanny",
            "--local-directory",
            str(self.folder),
            "--host",
            "127.0.0.1",
        )
        self._start(r"Registered to", "worker", self.address, *options, site=site)
        return self.processes[-1]

    def _start(self, sign, kind, *args, site=""):
        command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", *args, "--no-dashboard"]
        path = os.pathsep.join([*([site] if site else []), str(self.folder), str(ROOT)])
        log = self.folder / f"{len(self.processes)}.log"
        with log.open("w") as stream:
            process = subprocess.Popen(
                command, stderr=stream, stdout=stream, env={**os.environ, "PYTHONPATH": path}
            )
        self.processes.append(process)
        end = time.monotonic() + 60
        while not (found := re.search(sign, log.read_text())):
            assert process.poll() is None, log.read_text()
            assert time.monotonic() < end
            time.sleep(0.05)
        return found[found.re.groups]

    def close(self):
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture(scope="module")
def clusters():
    started = []
    yield started
    for cluster in started:
        cluster.close()


@pytest.fixture
def cluster(clusters, tmp_path_factory):
    """Return a cluster of one worker: that of the other tests, unless its scheduler has gone."""
    if not clusters or clusters[-1].processes[0].poll() is not None:
        clusters.append(DaskCluster(tmp_path_factory.mktemp("cluster")))
        clusters[-1].worker()
    return clusters[-1]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder with inputs; each test writes into another one of its own."""
    path = tmp_path_factory.mktemp("mission")
    missions.mission(path / "in")
    return path


@pytest.fixture(scope="module")
def here(folder):
    """Do the inputs on this machine, once for all tests."""
    assert batch(folder, "here")[0] == 75
    return missions.files(folder / "here")


def start(folder, output, *args, site=ROOT):
    command = [sys.executable, "-m", "terrain_cli", "batch", "in", "in/day1", "in/day2", "-o", output, *args]
    env = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), str(ROOT)])}
    return subprocess.Popen(command, cwd=folder, env=env, stderr=subprocess.PIPE, text=True)


def batch(folder, output, *args, **options):
    with start(folder, output, *args, **options) as process:
        err = process.communicate(timeout=120)[1]
    assert "Traceback" not in err
    return process.returncode, err


def test_the_same_as_on_one_machine_though_a_worker_is_killed(cluster, folder, here):
    doomed = cluster.worker()
    cluster.slow(0.7)
    with start(folder, "there", "--scheduler", cluster.address) as process:
        end = time.monotonic() + 60
        while str(doomed.pid) not in [worker for _, worker in cluster.begun()]:
            assert time.monotonic() < end
            time.sleep(0.02)
        doomed.kill()
        err = process.communicate(timeout=120)[1]
    assert process.returncode == 75, err
    assert missions.files(folder / "there") == here
    lines = missions.manifest(folder / "there")
    assert len(lines) == len({line["location"] for line in lines}) == 5
    # The task of the killed worker was begun again by the other.
    begun = [path for path, _ in cluster.begun()]
    assert len(begun) > len(set(begun))
    cluster.slow(0)
    assert "4 as before" in batch(folder, "there", "--scheduler", cluster.address)[1]


def test_an_input_that_hangs(cluster, folder, here):
    cluster.slow(600, "b.csv")
    code, err = batch(folder, "hangs", "--scheduler", cluster.address, "--timeout", "3")
    assert code == 75
    assert "failed (1): in/b.csv: took longer than 3 s" in err
    assert "2 done" in err
    cluster.slow(0)
    code, err = batch(folder, "hangs", "--scheduler", cluster.address)
    assert (code, "1 done" in err) == (75, True)
    assert missions.files(folder / "hangs")["segments.parquet"] == here["segments.parquet"]


#: Another version of everything that is compared.
ODD = """
import platform
from importlib import metadata
import terrain_cli.version
own = metadata.version
metadata.version = lambda name: "0.0.7" if name in ("pyarrow", "dask") else own(name)
platform.python_version = lambda: "3.0.7"
terrain_cli.version.__version__ = "0.0.7"
"""


def test_other_versions_are_refused(cluster, folder, tmp_path):
    site = tmp_path / "site"
    site.mkdir()
    (site / "sitecustomize.py").write_text(ODD)
    odd = cluster.worker(site=str(site))
    try:
        code, err = batch(folder, "odd", "--scheduler", cluster.address)
    finally:
        # It says goodbye, so that the next batch does not meet it.
        odd.send_signal(signal.SIGTERM)
        odd.wait()
    assert code == 66
    assert re.search(r"worker tcp://\S+ has terrain-est 0\.0\.7 instead of \d", err)
    for name in ("python 3.0.7", "pyarrow 0.0.7", "dask 0.0.7"):
        assert f", {name} instead of " in err
    assert "  install terrain-est" in err
    assert (folder / "odd/manifest.jsonl").read_text() == ""


def test_inputs_that_workers_cannot_see(folder, tmp_path):
    """Workers elsewhere, played by a file that is gone when the task begins."""
    path = Path(shutil.copy(folder / "in/b.csv", tmp_path))
    item = batch_inputs.local(str(path))
    path.unlink()
    order = Order(configuration=gather(Rover(), Settings(), None), kind="csv", largest=0)
    reply = Estimate(item, order).run()
    assert (reply.failure.exit_code, reply.failure.passing) == (66, True)


def test_no_scheduler(folder, tmp_path):
    # Users give it time to come up.
    impatient = "from terrain_cli.batch import dask_cluster\ndask_cluster._PATIENCE = 0.5\n"
    (tmp_path / "sitecustomize.py").write_text(impatient)
    code, err = batch(folder, "none", "--scheduler", "nonsense://127.0.0.1:1")
    assert code == 2
    assert "nonsense://127.0.0.1:1: no address of a scheduler" in err
    with socket.socket() as deaf:
        deaf.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{deaf.getsockname()[1]}"
        code, err = batch(folder, "none", "--scheduler", address, site=tmp_path)
    assert code == 66
    assert "no scheduler answers" in err


def test_a_scheduler_that_goes(cluster, folder, here):
    cluster.slow(600)
    with start(folder, "left", "--scheduler", cluster.address) as process:
        end = time.monotonic() + 60
        while not cluster.begun():
            assert time.monotonic() < end
            time.sleep(0.02)
        cluster.processes[0].kill()
        err = process.communicate(timeout=120)[1]
    assert process.returncode == 66, err
    assert f"{cluster.address}: the scheduler has gone" in err
    # What is done is kept, and the rest can be done here.
    assert batch(folder, "left")[0] == 75
    assert missions.files(folder / "left") == here
