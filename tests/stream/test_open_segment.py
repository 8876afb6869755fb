"""What is held of the open segment: its samples, however they came."""

from __future__ import annotations

import numpy as np
import pytest
from streams import ROVER, begun, lines, text

from terrain_cli.run.long_log import BEHIND, with_behind
from terrain_cli.run.settings import Settings
from terrain_cli.stream import open_segment
from terrain_cli.stream.arriving_samples import ArrivingSamples
from terrain_cli.stream.open_segment import OpenSegment


@pytest.fixture(scope="module")
def samples():
    some = lines((60.0, 60.0))[:301]
    rows = begun(some[:2])
    arriving = ArrivingSamples(rows, ROVER, Settings(), None)
    (part,) = arriving.take(rows.take(text(some[2:])))
    return with_behind(part, part.usable)[0]


def test_pieces_are_joined_in_their_order(samples, monkeypatch):
    monkeypatch.setattr(open_segment, "_PIECES", 3)
    monkeypatch.setattr(open_segment, "_LARGE", 40)
    segment, done = OpenSegment(), 0
    for size in (1, 1, 1, 1, 2, 50, 1, 7, 40, 1, 1, 1, 1, 100, 92):
        segment.add(samples.taken(slice(done, done + size)))
        done += size
        # Few pieces are held, however many came.
        assert len(segment._small) < 3
        assert len(segment._large) < 9
    assert segment.count == done == 300
    whole = segment.whole()
    np.testing.assert_array_equal(whole.time, samples.time)
    np.testing.assert_array_equal(whole.channels["torque"], samples.channels["torque"])


def test_what_is_split_off_is_gone(samples):
    segment = OpenSegment()
    segment.add(samples)
    first = segment.split(120)
    assert (len(first), segment.count) == (120, 180)
    np.testing.assert_array_equal(segment.whole().time, samples.time[120:])
    assert len(segment.split(180)) == 180
    assert segment.count == 0


def test_samples_set_aside_are_counted_behind_the_one_before(samples):
    segment = OpenSegment()
    segment.set_aside(3)
    segment.add(samples.taken(slice(0, 10)))
    segment.set_aside(2)
    segment.add(samples.taken(slice(10, 20)))
    assert segment.ahead == 3
    behind = segment.whole().drivers[BEHIND]
    assert behind[9] == 2
    assert behind.sum() == 2
