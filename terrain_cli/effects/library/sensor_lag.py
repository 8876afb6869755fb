"""A channel is late."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from terrain_cli.mechanics.effect import Effect, Parameter, Quantities

_CHANNELS = ("torque", "drawbar_pull", "sinkage")


def _late(channel: str, q: Quantities) -> Any:
    """Show what was true a little earlier, to first order."""
    return q[channel] - q[f"{channel}_lag"] * q.get(f"{channel}_rate", 0.0)


def _late_on_the_way(q: Quantities) -> Any:
    """Take the rate from the slope of the rut: at one speed a distance is a time, and nothing else."""
    if "rut_slope" not in q or "velocity" not in q:
        return _late("sinkage", q)
    return q["sinkage"] - q["sinkage_lag"] * np.absolute(q["velocity"]) * q["rut_slope"]


_LAWS = {channel: partial(_late, channel) for channel in _CHANNELS}

EFFECT = Effect(
    id="sensor-lag",
    title="A channel is late",
    kind="sensor",
    parameters=tuple(
        Parameter(
            f"{channel}_lag",
            "s",
            0.0,
            0.1,
            lower=-2.0,
            upper=2.0,
            meaning=f"by how much {channel.replace('_', ' ')} is late",
            needs=(f"{channel}_rate",),
        )
        for channel in _CHANNELS
    ),
    laws=_LAWS,
    others=({**_LAWS, "sinkage": _late_on_the_way},),
    any_of=tuple(f"{channel}_rate" for channel in _CHANNELS),
    formula="shown = true − lag · d(shown)/dt, for torque, drawbar pull and sinkage each",
    explanation=(
        "Filters, buses and clocks that disagree make a channel late by 0.05 to 0.5 s. Where nothing "
        "changes it is right; in a change the residual is the lag times the channel's own rate, with one "
        "sign as it rises and the other as it falls, so that torque over slip becomes a loop. The lags are "
        "relative to slip and load: if those are late, all three come out early, below zero. A wheel that "
        "has yet to sink after a change of slip makes sinkage loop too: there it is a distance that counts, "
        "see sinkage-relaxation. Acceleration-torque follows the wheel's acceleration, not the torque's "
        "rate. A lag longer than the changes themselves is beyond this first-order law: shift the channel "
        "instead."
    ),
    shows="the late channel, against its own rate of change",
    reference=(
        "Furgale, Rehder, Siegwart (2013), Unified temporal and spatial calibration for multi-sensor "
        "systems, IEEE/RSJ International Conference on Intelligent Robots and Systems, doi "
        "10.1109/IROS.2013.6696514"
    ),
    settled_by="quick changes of slip or load, up and down; for sinkage, at two speeds",
)
