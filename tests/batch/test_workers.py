"""Worker processes that die, hang, eat and pour: each costs its own task, and nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

import pytest
import work

from terrain_cli.batch.worker_pool import LocalPool

HERE = Path(__file__).resolve().parent
GIGA = 1_000_000_000


def run(pool, tasks, seconds=60.0):
    """Have tasks done, and return the replies in their order."""
    waiting, replies, end = list(enumerate(tasks)), {}, time.monotonic() + seconds
    while len(replies) < len(tasks):
        while waiting and pool.free:
            pool.submit(*waiting.pop(0))
        replies.update(pool.collect(0.2))
        assert time.monotonic() < end
    return [replies[number] for number in range(len(tasks))]


def processes(pool):
    return [child._process.pid for child in (*pool._idle, *pool._busy)]


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def test_one_bad_task_among_good_ones():
    tasks = [work.Say("a"), work.Die(), work.Say("b"), work.Raise(), work.Leave(), work.Die(signal.SIGSEGV)]
    with closing(LocalPool(2)) as pool:
        a, killed, b, raised, left, crashed = run(pool, [*tasks])
        (last,) = run(pool, [work.Say("c")])
    assert [a.sha256, b.sha256, last.sha256] == ["a", "b", "c"]
    assert killed.failure.error == (
        "its worker was killed (SIGKILL; out of memory?): these were its last words"
    )
    assert (killed.failure.error_class, killed.failure.passing) == ("WorkerLostError", True)
    assert raised.failure.error == "unexpected ZeroDivisionError: a fault of the program"
    assert not raised.failure.passing
    assert left.failure.error == "its worker ended with exit code 3"
    assert "SIGSEGV" in crashed.failure.error


def test_a_task_that_hangs():
    with closing(LocalPool(2, timeout=1.0)) as pool:
        started = time.monotonic()
        replies = run(pool, [work.Hang(), work.Say("a"), work.Hang(0.2), work.Hang()])
        assert time.monotonic() - started < 30
    assert [bool(reply.failure) for reply in replies] == [True, False, False, True]
    assert replies[0].failure.error == "took longer than 1 s"
    assert replies[0].failure.passing


def test_a_worker_that_is_stopped_counts_as_hanging():
    with closing(LocalPool(1, timeout=1.0)) as pool:
        run(pool, [work.Say("a")])
        pool.submit(0, work.Pour(1 << 26))
        os.kill(processes(pool)[0], signal.SIGSTOP)
        done = []
        while not done:
            done = pool.collect(0.2)
        assert done[0][1].failure.error_class == "TimeoutError"
        assert run(pool, [work.Say("b")])[0].sha256 == "b"


def test_an_idle_worker_that_is_killed_costs_nothing():
    with closing(LocalPool(1)) as pool:
        run(pool, [work.Say("a")])
        (pid,) = processes(pool)
        os.kill(pid, signal.SIGKILL)
        while alive(pid):
            time.sleep(0.01)
        assert run(pool, [work.Say("b")])[0].sha256 == "b"


def test_memory_has_an_end():
    with closing(LocalPool(1, memory=3 * GIGA)) as pool:
        fits, large, next_one = run(pool, [work.Eat(GIGA // 10), work.Eat(4 * GIGA), work.Say("a")])
    assert fits.sha256 == str(GIGA // 10)
    assert (large.failure.error_class, large.failure.passing) == ("MemoryError", True)
    assert next_one.sha256 == "a"


def test_too_little_memory_to_begin_with():
    with closing(LocalPool(1, memory=GIGA // 10)) as pool:
        (reply,) = run(pool, [work.Say("a")])
    assert reply.failure.error_class == "MemoryError"


@pytest.mark.parametrize("task", [work.Copy(), work.Copy(hang=True)], ids=["killed", "hangs"])
def test_nothing_is_left_of_what_a_lost_worker_copied(task, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with closing(LocalPool(1, timeout=2.0)) as pool:
        (reply,) = run(pool, [task])
        assert reply.failure.passing
    assert list(tmp_path.iterdir()) == []


def test_large_answers():
    with closing(LocalPool(2)) as pool:
        assert [len(reply.result) for reply in run(pool, [work.Pour(1 << 25)] * 3)] == [1 << 25] * 3


KEEPER = """
import time
from terrain_cli.batch.worker_pool import LocalPool
import work
pool = LocalPool(2)
pool.submit(0, work.Hang())
pool.submit(1, work.Hang())
while any(task for _, task in pool._busy.values()):
    pool.collect(0.1)
print(*(child._process.pid for child in pool._busy), flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="asks the system of Linux")
def test_workers_die_with_their_keeper():
    path = os.pathsep.join([str(HERE.parent.parent), str(HERE)])
    command = [sys.executable, "-c", KEEPER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": path}) as keeper:
        pids = [int(pid) for pid in keeper.stdout.readline().split()]
        before = [alive(pid) for pid in pids]
        keeper.kill()
    assert before == [True, True]
    end = time.monotonic() + 5
    while any(alive(pid) for pid in pids):
        assert time.monotonic() < end
        time.sleep(0.05)
