"""Stretches kept aside: fixed by the log, the same for all wheels, and never seen by a diagnosis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from formats import Labels
from terrain_cli.comparison import comparison_criteria, kept_aside
from terrain_cli.errors import UsageError
from terrain_cli.telemetry.usable_samples import STANDS
from terrain_cli.telemetry.wheel_samples import Geometry, Samples
from terrain_cli.windows.cut_windows import cut
from terrain_cli.windows.joined_inputs import by_wheel

N = 400


def samples(n=N, wheel="left", source="run.csv", rate=10.0, standing=0, table=False):
    """Return samples of a wheel that stands at first."""
    time = np.arange(n) / rate
    channels = dict.fromkeys(("load", "torque", "sinkage", "slip"), np.full(n, 0.1))
    return Samples(
        source=source,
        wheel=wheel,
        geometry=Geometry(0.125, 0.1, 0.018),
        origin=0.0,
        time=None if table else time,
        channels=channels,
        labels={},
        stretch=np.zeros(n, dtype=np.intp),
        distance=None,
        set_aside=Labels(np.where(np.arange(n) < standing, 0, -1).astype(np.int32), (STANDS,)),
    )


def windows(*args, length=100, **options):
    return cut(samples(*args, **options), "fixed", window_samples=length)


def stretches(mask):
    """Return where the stretches of a mask begin and end."""
    return (
        np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int))).reshape(-1, 2).tolist()
    )


@pytest.mark.parametrize("share", [0.2, 0.5, 0.75])
def test_the_end_of_each_eighth_is_kept_aside(share):
    (one,) = kept_aside.marked([windows()], share)
    begins = 50 - int(50 * share)
    assert stretches(one.samples.aside) == [[50 * j + begins, 50 * j + 50] for j in range(8)]
    assert one.samples.remarks == [f"{8 * int(50 * share)} of 400 samples are kept aside, in 8 stretches"]
    assert kept_aside.number([one.samples]) == 8 * int(50 * share)


def test_the_help_and_the_pages_say_eight():
    assert comparison_criteria.FEWEST_BLOCKS == 8


def test_what_a_model_sets_aside_moves_no_stretch():
    """Whichever effects a model has: each verb and round has to keep the same samples aside."""
    whole = windows()
    codes = np.where(np.arange(N) % 3 == 0, 1, -1).astype(np.int32)
    fewer = cut(replace(whole.samples, set_aside=Labels(codes, (STANDS, "no pitch"))), "none")
    (a,), (b,) = (kept_aside.marked([one], 0.5) for one in (whole, fewer))
    np.testing.assert_array_equal(a.samples.aside, b.samples.aside)


def test_a_wheel_that_stands_takes_no_stretch():
    (one,) = kept_aside.marked([windows(600, standing=200)], 0.5)
    assert stretches(one.samples.aside) == [[200 + 50 * j + 25, 200 + 50 * j + 50] for j in range(8)]


def test_wheels_of_an_input_are_cut_at_the_same_times():
    slow, fast = kept_aside.marked([windows(rate=10.0), windows(1600, "right", rate=40.0)], 0.5)
    np.testing.assert_array_equal(fast.samples.aside[::4], slow.samples.aside)
    assert stretches(fast.samples.aside)[0] == [100, 200]
    assert {*slow.samples.remarks} == {*fast.samples.remarks}


def test_inputs_and_tables_without_time_are_cut_by_themselves():
    first, other, points = kept_aside.marked(
        [windows(), windows(800, source="b.csv"), windows(160, "right", table=True)], 0.5
    )
    assert [len(stretches(one.samples.aside)) for one in (first, other, points)] == [8, 8, 8]
    assert stretches(points.samples.aside)[0] == [10, 20]


def test_a_short_input_is_seen_whole_and_says_so():
    short, longer = kept_aside.marked([windows(159), windows(160, source="b.csv")], 0.5)
    assert short.samples.aside is None
    assert short.samples.remarks == ["too short to keep stretches aside: 159 samples, and 160 are needed"]
    assert kept_aside.too_short([short.samples])
    assert not kept_aside.too_short([longer.samples])
    assert len(kept_aside.seen([short])[0].rows) == 159
    (joined,) = by_wheel([short, longer])
    np.testing.assert_array_equal(joined.samples.aside, [*[False] * 159, *longer.samples.aside])
    assert joined.samples.taken(slice(159, None)).aside.tolist() == longer.samples.aside.tolist()


def test_what_is_seen_is_all_the_rest_in_pieces():
    whole = windows(length=60)
    marked = kept_aside.marked([whole], 0.5)
    (seen,) = kept_aside.seen(marked)
    np.testing.assert_array_equal(seen.rows, np.flatnonzero(~marked[0].samples.aside))
    # Each window keeps what is left of it, and pieces do not touch.
    for j in range(len(seen)):
        rows = seen.rows[seen.bounds[j] : seen.bounds[j + 1]]
        assert {*(rows // 60)} == {j}
    # Nor do those left out touch them: rates of channels are taken within a stretch.
    np.testing.assert_array_equal(seen.samples.stretch, np.arange(N) // 25)


def test_without_a_mark_everything_is_seen():
    whole = windows()
    assert kept_aside.seen([whole]) == [whole]
    assert kept_aside.number([whole.samples]) == 0


@pytest.mark.parametrize("share", [0.0, 1.0, -0.5, float("nan")])
def test_a_share_is_between_nothing_and_all(share):
    with pytest.raises(UsageError, match="the share kept aside is"):
        kept_aside.marked([windows()], share)
