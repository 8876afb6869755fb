"""What a model file remembers of a parameter that several wheels have."""

from __future__ import annotations

import math

import pytest

from terrain_cli.comparison.blocks import Interval
from terrain_cli.improvement import model_history
from terrain_cli.improvement.improvement_outcome import ChannelChange, Estimated
from terrain_cli.vocabulary import toml_files


def test_wheels_are_averaged_by_what_each_knows():
    """By the usual formula for two measurements of one thing."""
    wheels = [
        Estimated(
            source="run.csv",
            wheel=wheel,
            name="slip-sinkage.n1",
            unit="1",
            value=value,
            se=se,
            determined=True,
        )
        for wheel, value, se in (("left", 0.4, 0.1), ("right", 0.6, 0.2), ("rear", math.nan, math.nan))
    ]
    (mean,) = model_history.means(wheels).values()
    assert mean["value"] == pytest.approx((0.4 * 4.0 + 0.6) / 5.0)
    assert mean["se"] == pytest.approx(0.1 * 0.2 / math.hypot(0.1, 0.2), rel=1e-5)
    assert (mean["wheels"], mean["lowest"], mean["highest"]) == (2, 0.4, 0.6)


def test_one_wheel_has_no_range_and_none_no_mean():
    one = Estimated(source="run.csv", wheel="left", name="x.a", unit="N", value=3.0, se=0.5, determined=False)
    assert model_history.means([one])["x.a"] == {
        "value": 3.0,
        "se": 0.5,
        "unit": "N",
        "wheels": 1,
        "lowest": None,
        "highest": None,
    }
    held = Estimated(
        source="run.csv", wheel="left", name="x.a", unit="N", value=3.0, se=0.0, determined=False
    )
    assert model_history.means([held]) == {}


def test_what_is_not_known_is_left_out_of_the_file():
    nothing = Interval(math.nan, math.nan, math.nan)
    found = model_history.channel(
        ChannelChange(
            name="sinkage",
            unit="m",
            before=nothing,
            after=Interval(0.002, 0.001, 0.004),
            noise=math.nan,
            difference=nothing,
        )
    )
    assert found["heldout_before"] is None
    assert toml_files.value(found) == (
        '{ unit = "m", heldout_after = 0.002, heldout_after_interval = [0.001, 0.004] }'
    )
