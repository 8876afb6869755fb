"""Salvaged messages that follow their definition; the others are set aside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from formats.rosbag.decoding.bulk_extraction import UnevenError, gather
from formats.rosbag.decoding.decoder import UndecodableError
from formats.rosbag.decoding.plain_extraction import FieldRequest, elements_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from formats.recovery import Recovery
    from formats.rosbag.decoding.decoder import Decoder
    from formats.rosbag.decoding.definitions import Leaf
    from formats.rosbag.storage.chunks import Run
    from formats.rosbag.storage.raw_messages import Messages


class Decodable:
    """Sets aside the messages of a damaged bag that cannot be decoded, and counts them in its recovery.

    The remarks begin with what the recovery has to say, and are kept up to date.
    """

    def __init__(self, recovery: Recovery, remarks: list[str]) -> None:
        self._recovery = recovery
        self._remarks = remarks
        self._told = recovery.sentences()
        self._known: set[tuple[int, int]] = set()
        remarks[:0] = self._told

    def only(self, runs: Iterable[Run], decoders: Mapping[int, Decoder]) -> Iterator[Run]:
        """Leave out of each run what cannot be decoded."""
        for run in runs:
            kept = {place: self._kept(place, messages, decoders[place]) for place, messages in run.items()}
            yield {place: messages for place, messages in kept.items() if len(messages)}

    def _kept(self, place: int, messages: Messages, decoder: Decoder) -> Messages:
        if not len(messages):
            return messages
        try:
            gather(decoder.definition, messages, _texts(decoder, messages))
        except (UnevenError, UndecodableError):
            right = np.array([_decodes(decoder, messages, row) for row in range(len(messages))])
            self._note(place, messages.order[~right].tolist())
            return messages.take(right)
        return messages

    def _note(self, place: int, orders: list[int]) -> None:
        new = {(place, order) for order in orders} - self._known
        if not new:
            return
        self._known |= new
        self._recovery.aside += len(new)
        self._recovery.read -= len(new)
        for sentence in self._told:
            self._remarks.remove(sentence)
        self._told = self._recovery.sentences()
        self._remarks[:0] = self._told


def _texts(decoder: Decoder, messages: Messages) -> list[tuple[Leaf, FieldRequest]]:
    """Ask for every text of the messages: numbers are right in any bytes, texts are not."""
    leaves = decoder.definition.leaves.values()
    wanted = [(leaf, FieldRequest(leaf.name, leaf.name, "text")) for leaf in leaves if leaf.kind == "text"]
    if lists := [leaf for leaf in leaves if leaf.kind == "texts"]:
        first = decoder.message(messages.payload(0))
        for leaf in lists:
            places = range(len(elements_of(first, leaf)[0]))
            wanted += [
                (leaf, FieldRequest(f"{leaf.name}[{place}]", leaf.name, "text", place)) for place in places
            ]
    return wanted


def _decodes(decoder: Decoder, messages: Messages, row: int) -> bool:
    try:
        decoder.message(messages.payload(row))
    except UndecodableError:
        return False
    return True
