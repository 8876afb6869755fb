"""Payloads of one connection to columns: the fast way where it holds, else message by message."""

from __future__ import annotations

from typing import TYPE_CHECKING

from formats.rosbag.decoding.bulk_extraction import UnevenError, elements, gather
from formats.rosbag.decoding.plain_extraction import elements_of, extract
from formats.table import STAMP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from formats.rosbag.decoding.bulk_extraction import Elements
    from formats.rosbag.decoding.definitions import Definition, Leaf
    from formats.rosbag.decoding.plain_extraction import FieldRequest, Values
    from formats.rosbag.storage.raw_messages import Messages


class UndecodableError(Exception):
    """A message does not follow its definition; `row` is its place among the payloads."""

    def __init__(self, row: int, reason: str) -> None:
        super().__init__(reason)
        self.row = row


class Decoder:
    """Columns out of the payloads of one connection."""

    def __init__(self, definition: Definition) -> None:
        self.definition = definition

    def columns(self, messages: Messages, requests: Sequence[FieldRequest]) -> list[tuple[Values, bool]]:
        """Take one value per request from each message, and tell whether any message has it."""
        leaves = [self._leaf(request) for request in requests]
        wanted = [(leaf, request) for leaf, request in zip(leaves, requests, strict=True) if leaf is not None]
        try:
            found = iter(gather(self.definition, messages, wanted))
        except UnevenError:
            decoded = [self.message(messages.payload(row), row) for row in range(len(messages))]
            found = iter([extract(decoded, leaf, request) for leaf, request in wanted])
        return [
            (request.blank(len(messages)), False) if leaf is None else next(found)
            for leaf, request in zip(leaves, requests, strict=True)
        ]

    def elements(self, message: Messages, lists: Sequence[Leaf]) -> list[Elements]:
        """Tell how the elements of lists are called in one message; see `plain_extraction.elements_of`."""
        try:
            return elements(self.definition, message, lists)
        except UnevenError:
            decoded = self.message(message.payload(0))
            return [elements_of(decoded, leaf) for leaf in lists]

    def message(self, payload: bytes, row: int = 0) -> object:
        """Decode one message with rosbags."""
        try:
            store = self.definition.store
            if self.definition.ros1:
                return store.deserialize_ros1(payload, self.definition.type)
            return store.deserialize_cdr(payload, self.definition.type)
        except Exception as error:  # rosbags answers damaged bytes and texts with any exception there is
            raise UndecodableError(row, " ".join(str(error).split())[:160] or type(error).__name__) from error

    def _leaf(self, request: FieldRequest) -> Leaf | None:
        """Find the field in this definition, which need not be the one it was listed by."""
        if request.asked == STAMP and not self.definition.stamped:
            return None
        leaf = self.definition.leaves.get(request.field)
        plural = "" if request.key is None else "s"
        return leaf if leaf is not None and leaf.kind == request.kind + plural else None
