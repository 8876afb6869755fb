"""From a plan to the channels of each wheel, on the clock of its torque."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.errors import ConfigurationError, InputError, nearest
from terrain_cli.telemetry import bags, tables
from terrain_cli.telemetry.channel_sources import CLOCKS, match_name
from terrain_cli.telemetry.plan.mapping import is_table, only_wheel
from terrain_cli.telemetry.raw_columns import read_topics

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from formats import Batch, Column, Labels
    from terrain_cli.rover import Rover
    from terrain_cli.telemetry.channel_sources import Plan
    from terrain_cli.telemetry.wheel_samples import Raw


def read_raw(
    plan: Plan,
    rover: Rover,
    channels: Iterable[str],
    extras: Sequence[str] = (),
    *,
    wheels: Collection[str] = (),
    batches: list[Batch] | None = None,
    topics: Mapping[str, dict[str, Column]] | None = None,
) -> list[Raw]:
    """Read the channels asked for, wheel by wheel, ordered by name; those without a feed are passed over.

    `batches` are the columns of a table, `topics` those of the topics of a bag, where they were read before.
    """
    wanted = set(channels)

    def choose(labels: Labels | None) -> list[str]:
        return choose_wheels(plan, rover, labels, wheels)

    if is_table(plan.source):
        return tables.read(plan, wanted, extras, choose, rover.max_gap, batches)
    if topics is None:
        topics = read_topics(plan.source, bags.fields(plan, wanted))
    return bags.wheels(plan, topics, wanted, choose, rover.max_gap)


def choose_wheels(plan: Plan, rover: Rover, labels: Labels | None, wheels: Collection[str]) -> list[str]:
    """Name the wheels to read: labels of a column, those of rover.toml, or the only one."""
    path = plan.source.path
    if labels is None:
        there = sorted(plan.wheels) or [only_wheel(rover)]
    else:
        there = labels_there(labels)
        if not there:
            raise InputError(f"{path}: the column of wheels is empty", hint="fill it in, or leave it out")
    chosen = among(path, there, wheels)
    clocks = [next((feeds[c] for c in CLOCKS if c in feeds), None) for feeds in map(plan.feeds, chosen)]
    if labels is None and len(chosen) > 1 and clocks[0] and clocks.count(clocks[0]) == len(clocks):
        raise ConfigurationError(
            f"{path}: {clocks[0].place} is given once for {len(chosen)} wheels: {', '.join(chosen)}",
            hint="choose one with --wheel NAME, or give each its own in rover.toml: [wheels.NAME.channels]",
        )
    return chosen


def labels_there(labels: Labels) -> list[str]:
    """Return the labels that occur, sorted."""
    there = np.bincount(labels.codes[labels.codes >= 0], minlength=1)
    return sorted(labels.names[code] for code in np.flatnonzero(there).tolist())


def among(path: str, there: Sequence[str], wheels: Collection[str]) -> list[str]:
    """Choose those among wheels that are asked for to the letter, all if none is; left is not front-left."""
    for name in wheels:
        if name not in there:
            meant = match_name(name, there)
            near = f"; did you mean {meant}?" if meant else nearest(name, there)
            raise InputError(f"{path}: there is no wheel {name}{near}", hint=f"it has {', '.join(there)}")
    return [name for name in there if not wheels or name in wheels]
