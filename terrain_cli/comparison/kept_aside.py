"""Stretches kept aside: `diagnose` does not see them, and a change of a model is judged on them."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from formats.recovery import Notice
from terrain_cli.comparison import comparison_criteria as criteria
from terrain_cli.comparison.blocks import at_times
from terrain_cli.errors import UsageError
from terrain_cli.telemetry import Samples
from terrain_cli.telemetry.usable_samples import STANDS
from terrain_cli.vocabulary.arrays import Index
from terrain_cli.windows.cut_windows import Windows, pieces


class TooShort(Notice):
    """Said of an input of which nothing can be kept aside."""

    __slots__ = ()


def marked(wheels: Sequence[Windows], share: float) -> list[Windows]:
    """Mark the samples of each input that are kept aside, and remark how many, or that it is too short.

    An input is cut into `FEWEST_BLOCKS` parts of as many samples, and the last share of each is kept aside.
    So this depends on the log alone, and what varies along a drive is in both. Samples of a wheel that
    stands do not count, and the wheels of an input are cut at the same times. UsageError where the share
    is none.
    """
    if not 0.0 < share < 1.0:
        raise UsageError(
            f"the share kept aside is {share:g}", hint="give a number between 0 and 1, such as 0.5"
        )
    leaders: dict[str, Samples] = {}
    for samples in (one.samples for one in wheels):
        known = leaders.setdefault(samples.source, samples)
        if samples.time is not None and (known.time is None or len(samples) > len(known)):
            leaders[samples.source] = samples
    needed = math.ceil(criteria.FEWEST_BLOCKS * criteria.BLOCK_SAMPLES / min(share, 1.0 - share))
    found = []
    for one in wheels:
        samples = one.samples
        leader = samples if samples.time is None else leaders[samples.source]
        place = _place(leader)
        count = int(place[-1]) + 1
        aside = place * criteria.FEWEST_BLOCKS % count >= (1.0 - share) * count
        said: Notice
        if count < needed:
            said = TooShort(f"too short to keep stretches aside: {count} samples, and {needed} are needed")
        else:
            of = f"{int(aside[leader.usable].sum())} of {len(leader.usable)} samples"
            said = Notice(f"{of} are kept aside, in {criteria.FEWEST_BLOCKS} stretches")
            if leader.time is not None and samples.time is not None and samples is not leader:
                # What the leader's last sample before them has.
                aside = aside[at_times(leader.time, samples.time)]
        kept = None if count < needed else aside
        found.append(replace(one, samples=replace(samples, aside=kept, remarks=[*samples.remarks, said])))
    return found


def seen(wheels: Sequence[Windows]) -> list[Windows]:
    """Leave out the samples that are kept aside."""
    found = [
        one if one.samples.aside is None else pieces(one, np.flatnonzero(~one.samples.aside[one.rows]))
        for one in wheels
    ]
    return [one for one in found if len(one.rows)]


def number(several: Iterable[Samples]) -> int:
    return sum(int(one.aside[one.usable].sum()) for one in several if one.aside is not None)


def too_short(several: Iterable[Samples]) -> bool:
    """Tell whether stretches were to be kept aside of an input that is too short."""
    return any(isinstance(remark, TooShort) for one in several for remark in one.remarks)


def _place(samples: Samples) -> Index:
    """Return the number of each sample, from 0, without counting those of a wheel that stands."""
    reasons = samples.set_aside
    stands = reasons.names.index(STANDS) if STANDS in reasons.names else -2
    return np.maximum(np.cumsum(reasons.codes != stands, dtype=np.intp) - 1, 0)
