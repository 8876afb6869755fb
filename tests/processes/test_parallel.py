"""Work in several processes: the same results, in the same order, whatever becomes of the processes."""

from __future__ import annotations

import json
import os
from functools import partial

import pytest
from changed_models import write_all

from terrain_cli.processes import parallel


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
    return parallel.each(partial(doubled, os.getpid()), range(number))


@pytest.mark.parametrize("jobs", [1, 2, 8])
def test_results_in_the_order_of_the_items_from_other_processes(jobs):
    told = []
    with parallel.jobs(jobs):
        found = parallel.each(partial(doubled, os.getpid()), range(6), told.append)
    assert [number for number, _ in found] == [0, 2, 4, 6, 8, 10]
    assert [elsewhere for _, elsewhere in found] == [jobs > 1] * 6
    assert told == list(range(6))


def test_without_jobs_no_process_is_started():
    assert not any(elsewhere for _, elsewhere in parallel.each(partial(doubled, os.getpid()), range(3)))
    with parallel.jobs(4):
        pass
    assert not any(elsewhere for _, elsewhere in parallel.each(partial(doubled, os.getpid()), range(3)))


def test_what_a_killed_process_leaves_is_done_here():
    told = []
    with parallel.jobs(2):
        found = parallel.each(partial(dies_elsewhere, os.getpid()), range(6), told.append)
    assert found == [0, 2, 4, 6, 8, 10]
    assert sorted(set(told)) == list(range(6))


@pytest.mark.parametrize("jobs", [1, 2])
def test_an_error_is_that_of_the_function(jobs):
    with parallel.jobs(jobs), pytest.raises(ValueError, match="three"):
        parallel.each(refuses, range(6))


def test_processes_start_none_of_their_own():
    with parallel.jobs(2):
        inside = parallel.each(counts_inside, [2, 3])
    assert not any(elsewhere for some in inside for _, elsewhere in some)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs")
    write_all(path)
    return path


# A comparison shares out its wheels, a diagnosis its effects.
@pytest.mark.parametrize("command", [("compare", "sinks.csv", "clean.csv"), ("diagnose", "sinks.csv")])
def test_verbs_say_the_same(terrain_est, terrain_est_here, folder, command):
    arguments = (*command, "--segments", "none", "--json")
    alone = terrain_est_here(*arguments, cwd=folder)
    together = terrain_est(*arguments, "--jobs", "2", cwd=folder)
    assert alone.returncode == together.returncode == 0, together.stderr
    assert together.stdout == alone.stdout
    assert json.loads(alone.stdout)["channels"]
