"""Iterators read in threads, a few items ahead of the code that takes them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from queue import Empty, Queue
from threading import Event
from typing import TYPE_CHECKING, NamedTuple, TypeVar

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

Item = TypeVar("Item")


class _End(NamedTuple):
    error: Exception | None


@contextmanager
def ahead(iterators: Sequence[Iterator[Item]], items: int) -> Iterator[list[Iterator[Item]]]:
    """Run through some iterators, each in a thread of its own.

    The items are the same, and the same errors come after them; of each iterator so many may wait to be
    taken. When the context ends, threads stop at the next item.
    """
    over = Event()
    rooms: list[Queue[Item | _End]] = [Queue(items) for _ in iterators]

    def run(iterator: Iterator[Item], room: Queue[Item | _End]) -> None:
        try:
            for item in iterator:
                room.put(item)
                if over.is_set():
                    return
        except Exception as error:  # noqa: BLE001 - it is raised where items are taken
            room.put(_End(error))
        else:
            room.put(_End(None))

    with ThreadPoolExecutor(len(iterators)) as pool:
        for iterator, room in zip(iterators, rooms, strict=True):
            pool.submit(run, iterator, room)
        try:
            yield [_taken(room) for room in rooms]
        finally:
            over.set()
            # A thread may wait for room.
            for room in rooms:
                with suppress(Empty):
                    while True:
                        room.get_nowait()


def _taken(room: Queue[Item | _End]) -> Iterator[Item]:
    while not isinstance(item := room.get(), _End):
        yield item
    if item.error is not None:
        raise item.error
