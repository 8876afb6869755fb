"""The columns of one topic on their way from raw messages to batches."""

from __future__ import annotations

from difflib import get_close_matches
from typing import TYPE_CHECKING

import numpy as np

from formats.errors import DamagedError, FormatError
from formats.rosbag.decoding.decoder import UndecodableError
from formats.rosbag.decoding.definitions import STAMP as HEADER_STAMP
from formats.rosbag.decoding.plain_extraction import NAT, FieldRequest, labels
from formats.table import LOG_TIME, STAMP

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from formats.rosbag.decoding.decoder import Decoder
    from formats.rosbag.decoding.plain_extraction import Values
    from formats.rosbag.storage.chunks import Run
    from formats.rosbag.storage.raw_messages import Messages
    from formats.table import Batch, Stream

_ZERO = np.datetime64(0, "ns")


class Reading:
    """The columns of one topic, collected until they fill a batch; decoders are by connection."""

    def __init__(
        self,
        path: str,
        stream: Stream,
        decoders: Mapping[int, Decoder],
        requests: Sequence[FieldRequest],
        batch_rows: int,
    ) -> None:
        self.topic = stream.topic
        self._path = path
        self._stream = stream
        self.decoders = decoders
        self._requests = [*requests, FieldRequest(STAMP, HEADER_STAMP, "time")]
        self._absent = {request.asked: request for request in requests if request.key is not None}
        self._batch_rows = batch_rows
        #: Which of two messages logged at one time comes first is for rosbags a matter of their
        #: connections in ROS 1, of their place in the file in ROS 2.
        self._ties_by_connection = any(decoder.definition.ros1 for decoder in decoders.values())
        self._done = 0
        #: Log times and columns that are not in a batch yet.
        self._waiting: list[list[Values]] = []
        self._rows = 0

    def pieces(self, run: Run) -> Iterator[Run]:
        """Part messages so that those of the batches before a damaged one are read."""
        if len(run) > 1:
            yield run
            return
        for place, messages in run.items():
            for begin in range(0, len(messages), self._batch_rows):
                yield {place: messages.take(slice(begin, begin + self._batch_rows))}

    def add(self, run: Run) -> None:
        """Decode messages of each connection, and put them in the order of their log times."""
        times = np.concatenate([messages.times for messages in run.values()])
        order = np.concatenate([messages.order for messages in run.values()])
        if self._ties_by_connection:
            order = np.arange(len(times))
        sequence = np.lexsort((order, times)) if len(run) > 1 else np.arange(len(times))
        numbers = self._done + 1 + np.argsort(sequence, kind="stable")
        columns: list[list[Values]] = []
        first = 0
        for place, messages in run.items():
            rows = slice(first, first := first + len(messages))
            columns.append(self._decode(place, messages, numbers[rows]))
        whole = [
            np.concatenate(parts) if len(parts) > 1 else parts[0] for parts in zip(*columns, strict=True)
        ]
        whole.insert(0, times.view("datetime64[ns]"))
        self._waiting.append(whole if len(run) == 1 else [column[sequence] for column in whole])
        self._done += len(times)
        self._rows += len(times)

    def batches(self, *, last: bool = False) -> Iterator[Batch]:
        """Yield the batches that are full; the `last` time also the rest."""
        if self._rows >= self._batch_rows or (last and self._rows):
            columns = [
                np.concatenate(parts) if len(parts) > 1 else parts[0]
                for parts in zip(*self._waiting, strict=True)
            ]
            full = self._rows if last else self._rows - self._rows % self._batch_rows
            for begin in range(0, full, self._batch_rows):
                yield self._batch([column[begin : min(begin + self._batch_rows, full)] for column in columns])
            self._rows -= full
            self._waiting = [[column[full:].copy() for column in columns]] if self._rows else []
        if last and self._done:
            for request in self._absent.values():
                elements = next(
                    field.elements for field in self._stream.fields if field.name == request.field
                )
                raise FormatError(
                    self._path,
                    f"{self.topic}: no message has the element {request.key!r} of {request.field}",
                    hint=nearest(str(request.key), elements, "elements"),
                )

    def _batch(self, columns: list[Values]) -> Batch:
        clock, *values, stamps = columns
        batch: Batch = {
            request.asked: labels(column) if request.kind == "text" else column
            for request, column in zip(self._requests[:-1], values, strict=True)
        }
        return batch | {LOG_TIME: clock, STAMP: np.where(stamps == _ZERO, NAT, stamps)}

    def _decode(self, place: int, messages: Messages, numbers: NDArray[np.int64]) -> list[Values]:
        try:
            found = self.decoders[place].columns(messages, self._requests)
        except UndecodableError as error:
            raise DamagedError(
                self._path,
                f"{self.topic}: message {numbers[error.row]} does not fit its definition ({error})",
                hint="the recording is damaged there, or its definition is not the one it was written with",
            ) from error
        for request, (_, present) in zip(self._requests, found, strict=True):
            if present:
                self._absent.pop(request.asked, None)
        return [values for values, _ in found]


def nearest(name: str, choices: Iterable[str], what: str) -> str:
    """Say which name may have been meant, of topics, fields or whatever they are."""
    choices = list(choices)
    close = get_close_matches(name, choices, n=3, cutoff=0.5)
    return (
        f"did you mean {' or '.join(close)}?" if close else f"its {what}: {', '.join(choices[:20]) or 'none'}"
    )
