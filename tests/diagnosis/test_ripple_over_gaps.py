"""The ripple of grousers in logs whose stretches begin with the wheel at any angle."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_drives import Kind, samples_of, sized

from terrain_cli.diagnosis import diagnose
from terrain_cli.models import ModelFile
from terrain_cli.windows.cut_windows import cut

RIPPLE = sized("grouser-ripple", 0.6)


def with_gaps(samples):
    """Take three seconds and a bit out of a drive, three times."""
    kept = samples.taken(np.flatnonzero((samples.time % 32.0 < 27.0) | (samples.time % 32.0 > 30.17)))
    kept.stretch = np.cumsum(np.diff(kept.time, prepend=kept.time[:1]) > 1.0)
    return kept


def drive(how, given):
    """Return the inputs of a diagnosis."""
    short = Kind(effects=given, course="poor", seconds=96.0, rate=10.0)
    if how == "gaps":
        return [with_gaps(samples_of(4, short))]
    if how == "runs":
        return [samples_of(4, Kind(effects=given, course="poor", noise="soil", seconds=96.0, rate=10.0))]
    return [samples_of(seed, Kind(effects=given, course="poor", seconds=48.0, rate=10.0)) for seed in (4, 8)]


@pytest.mark.parametrize("how", ["gaps", "runs", "two inputs"])
def test_a_ripple_is_found_whatever_the_angle_at_which_stretches_begin(how):
    found = diagnose([cut(one, "none") for one in drive(how, RIPPLE)], ModelFile())
    assert (found.verdict, found.effect) == ("effect", "grouser-ripple"), found.sentence


@pytest.mark.parametrize("how", ["gaps", "runs"])
def test_nothing_ripples_in_a_clean_drive_with_gaps(how):
    found = diagnose([cut(one, "none") for one in drive(how, {})], ModelFile())
    assert found.verdict == "none", found.sentence
