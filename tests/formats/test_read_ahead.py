"""Threads that run ahead: the same items and errors, never too far ahead, and none left behind."""

from __future__ import annotations

import itertools
import threading
import time

import pytest

from formats.parquet_source import ahead


def test_items_come_in_their_order():
    with ahead([iter(range(100)), iter("abc"), iter(())], 2) as (numbers, letters, nothing):
        assert list(nothing) == []
        assert list(itertools.islice(numbers, 50)) == list(range(50))
        assert list(letters) == ["a", "b", "c"]
        assert list(numbers) == list(range(50, 100))


def test_an_error_comes_after_what_came_before_it():
    def damaged():
        yield 1
        yield 2
        raise OSError("cut off")

    with ahead([damaged()], 4) as (items,):
        # The thread has long met it.
        time.sleep(0.05)
        assert [next(items), next(items)] == [1, 2]
        with pytest.raises(OSError, match="cut off"):
            next(items)


def test_no_thread_is_further_ahead_than_it_may_be():
    given = []

    def counted():
        for number in itertools.count():
            given.append(number)
            yield number

    with ahead([counted()], 3) as (items,):
        for taken in range(1, 20):
            next(items)
            time.sleep(0.005)
            # Those waiting, and the one in the hand of the thread.
            assert len(given) <= taken + 3 + 1


@pytest.mark.parametrize("taken", [0, 1, 5])
@pytest.mark.parametrize("failing", [False, True])
def test_no_thread_is_left_of_iterators_without_end(taken, failing):
    before = threading.active_count()
    try:
        with ahead([itertools.count(), itertools.count()], 1) as columns:
            for column in columns:
                assert list(itertools.islice(column, taken)) == list(range(taken))
            if failing:
                raise KeyboardInterrupt
    except KeyboardInterrupt:
        assert failing
    assert threading.active_count() == before
