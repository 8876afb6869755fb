"""Processes of this machine: their memory, and several side by side."""

from __future__ import annotations

import json
import os
import platform
import select
import signal
import subprocess
import sys
import time
from functools import partial

import pytest
from changed_models import write_all
from child_processes import alive, children

from terrain_cli import processes

CYCLES = """
import resource, sys
import numpy as np
from terrain_cli.processes import keep_freed

if sys.argv[1:] == ["kept"]:
    keep_freed()
begin = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(20):
    arrays = [np.ones(2**17) for _ in range(8)]
    del arrays
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - begin)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="other C libraries keep memory as they like")
def test_pages_are_asked_for_once():
    every, kept = (
        int(
            subprocess.run(
                [sys.executable, "-c", CYCLES, *arguments], capture_output=True, text=True, check=True
            ).stdout
        )
        for arguments in ([], ["kept"])
    )
    # In each of 20 cycles, or in the first alone.
    assert kept < every / 4


ALGEBRA = """
import sys
from terrain_cli import app
print("numpy" in sys.modules)
try:
    app.main(["--version"])
except SystemExit:
    pass
import os
import numpy as np
rows = np.ones((1000, 1000))
rows @ rows
print(len(os.listdir("/proc/self/task")))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems count threads in other ways")
@pytest.mark.parametrize("asked", ["", "2"])
def test_algebra_of_a_command_has_one_thread_or_as_many_as_asked_for(asked):
    environment = {name: value for name, value in os.environ.items() if "NUM_THREADS" not in name}
    if asked:
        environment["OPENBLAS_NUM_THREADS"] = environment["MKL_NUM_THREADS"] = asked
    done = subprocess.run(
        [sys.executable, "-c", ALGEBRA], capture_output=True, text=True, check=True, env=environment
    )
    before, *_, threads = done.stdout.split("\n")[:-1]
    assert before == "False"
    # NumPy takes no more threads than there are cores.
    assert int(threads) == (min(2, os.cpu_count()) if asked else 1)


HELD = """
import resource, sys
limit = int(sys.argv[1])
if limit:
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
from terrain_cli.processes import most_held
print(most_held())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems limit memory in other ways")
def test_what_may_be_held_follows_the_limit_of_the_shell():
    free, limited = (
        int(subprocess.run([sys.executable, "-c", HELD, limit], capture_output=True, check=True).stdout)
        for limit in ("0", str(2 << 30))
    )
    assert limited == (2 << 30) // 8
    assert free >= limited


def doubled(first: int, number: int) -> tuple[int, bool]:
    return 2 * number, os.getpid() != first


def dies_elsewhere(first: int, number: int) -> int:
    if number == 3 and os.getpid() != first:
        os._exit(9)
    return 2 * number


def refuses(number: int) -> int:
    if number == 3:
        raise ValueError("three")
    return number


def counts_inside(number: int) -> list[int]:
    return processes.each(partial(doubled, os.getpid()), range(number))


@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_results_in_the_order_of_the_items_from_other_processes(jobs):
    told = []
    with processes.jobs(jobs):
        found = processes.each(partial(doubled, os.getpid()), range(6), told.append)
    assert [number for number, _ in found] == [0, 2, 4, 6, 8, 10]
    assert [elsewhere for _, elsewhere in found] == [jobs > 1] * 6
    assert told == list(range(6))


def test_without_jobs_no_process_is_started():
    assert not any(elsewhere for _, elsewhere in processes.each(partial(doubled, os.getpid()), range(3)))
    with processes.jobs(4):
        pass
    assert not any(elsewhere for _, elsewhere in processes.each(partial(doubled, os.getpid()), range(3)))


def test_what_a_killed_process_leaves_is_done_here():
    told = []
    with processes.jobs(2):
        found = processes.each(partial(dies_elsewhere, os.getpid()), range(6), told.append)
    assert found == [0, 2, 4, 6, 8, 10]
    assert sorted(set(told)) == list(range(6))


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_is_that_of_the_function(jobs):
    with processes.jobs(jobs), pytest.raises(ValueError, match="three"):
        processes.each(refuses, range(6))


def test_processes_start_none_of_their_own():
    with processes.jobs(2):
        inside = processes.each(counts_inside, [2, 3])
    assert not any(elsewhere for some in inside for _, elsewhere in some)


def test_work_beside_is_done_elsewhere_while_this_goes_on():
    waited = processes.beside(partial(doubled, os.getpid(), 4))
    assert doubled(os.getpid(), 5) == (10, False)
    assert waited() == (8, True)


def test_work_beside_that_is_killed_is_done_here():
    assert processes.beside(partial(dies_elsewhere, os.getpid(), 3))() == 6


def test_an_error_beside_is_that_of_the_work(capfd):
    waited = processes.beside(partial(refuses, 3))
    with pytest.raises(ValueError, match="three"):
        waited()
    assert capfd.readouterr().err == ""


BESIDE = """
import time
from functools import partial
from terrain_cli import processes
if __name__ == "__main__":
    waited = processes.beside(partial(bytes, 10_000_000))
    print(flush=True)
    time.sleep(60)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems tell of processes in other ways")
def test_work_beside_ends_where_nobody_waits_for_it_any_more(tmp_path):
    """More than a pipe holds: it is not sent before somebody reads."""
    (tmp_path / "waits.py").write_text(BESIDE, "utf-8")
    with subprocess.Popen([sys.executable, tmp_path / "waits.py"], stdout=subprocess.PIPE) as waiting:
        waiting.stdout.readline()
        (other,) = children(waiting.pid)
        waiting.kill()
    until = time.monotonic() + 20.0
    while alive(other) and time.monotonic() < until:
        time.sleep(0.01)
    assert not alive(other)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs")
    write_all(path)
    return path


# A comparison shares out its wheels, a diagnosis its effects.
@pytest.mark.parametrize("command", [("compare", "sinks.csv", "clean.csv"), ("diagnose", "sinks.csv")])
def test_verbs_say_the_same(terrain_est_here, folder, command):
    arguments = (*command, "--segments", "none", "--json")
    alone = terrain_est_here(*arguments, cwd=folder)
    together = terrain_est_here(*arguments, "--jobs", "2", cwd=folder)
    assert alone.returncode == together.returncode == 0, together.stderr
    assert together.stdout == alone.stdout
    assert json.loads(alone.stdout)["channels"]


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_the_first_is_noted_and_the_second_granted(name):
    number = getattr(signal, name)
    before = signal.getsignal(number)
    heard = []
    signal.signal(number, lambda *_: heard.append(name))
    try:
        with processes.noted() as stop:
            assert not select.select([stop], [], [], 0)[0]
            os.kill(os.getpid(), number)
            assert select.select([stop], [], [], 1)[0]
            assert heard == []
            os.kill(os.getpid(), number)
            assert heard == [name]
        os.kill(os.getpid(), number)
        assert heard == [name, name]
    finally:
        signal.signal(number, before)


def test_what_was_ignored_is_ignored_still():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with processes.noted() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not select.select([stop], [], [], 0.1)[0]
    finally:
        signal.signal(signal.SIGHUP, before)
