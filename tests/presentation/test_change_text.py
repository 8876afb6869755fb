"""A change of a model in words."""

import math
from types import SimpleNamespace

import pytest

from terrain_cli import models
from terrain_cli.comparison.blocks import Interval
from terrain_cli.improvement.improvement_outcome import ChannelChange, HeldOutEvidence, Shift
from terrain_cli.presentation import change_text


def test_an_error_that_rose_needs_no_excuse():
    sinkage = ChannelChange(
        name="sinkage",
        unit="m",
        before=Interval(0.626e-3, 0.6e-3, 0.65e-3),
        after=Interval(0.997e-3, 0.9e-3, 1.1e-3),
        noise=0.62e-3,
        difference=Interval(0.371e-3, 0.3e-3, 0.45e-3),
    )
    step = SimpleNamespace(
        action="add",
        testable=True,
        there=True,
        imitates=[SimpleNamespace(name="c1", value=1.9, se=0.3)],
        fell=[],
        rose=[sinkage],
        pays=False,
        held={"wheel-radius.whole": 1.0},
        after=models.added(models.build("wong-reece"), ["wheel-radius"], 0.02).file,
        evidence=HeldOutEvidence(Interval(1.2, 1.1, 1.3), blocks=20, lost=0.0),
    )
    assert change_text.found(step) == (
        "the held-out error rose in sinkage from 0.626 to 0.997 mm, with wheel-radius.whole = 1 "
        "(0: slip alone was computed with another radius; 1: the contact has that radius too)"
    )


def test_an_error_that_fell_is_not_said_not_to_have_fallen():
    torque = ChannelChange(
        name="torque",
        unit="N m",
        before=Interval(0.0817, 0.06, 0.1),
        after=Interval(0.073, 0.05, 0.09),
        noise=0.065,
        difference=Interval(-0.0087, -0.0144, -0.00297),
    )
    step = SimpleNamespace(
        action="add",
        changed=("stiffness-law",),
        confirmation=None,
        pays=False,
        better=False,
        kept=False,
        testable=True,
        there=False,
        absent=0.016,
        fell=[torque],
        rose=[],
        held={},
        evidence=HeldOutEvidence(Interval(0.877, 0.82, 0.938), blocks=20, lost=0.0),
    )
    assert change_text.verdict(step) == (
        "stiffness-law is not added: the held-out error fell in torque from 0.0817 to 0.073 N m, but its "
        "parameters do not differ significantly from their null values (p 0.016)"
    )


@pytest.mark.parametrize(
    ("c", "phi", "told"),
    [
        (1.5, 0.2, "moved: c by 1.5 standard errors; φ by 0.2 standard errors"),
        (None, 6.2, "moved: φ by 6.2 standard errors; how far c moved is not known"),
        (None, None, "how far c and φ moved is not known"),
    ],
)
def test_what_moved_is_told_and_what_is_not_known_of_it(c, phi, told):
    shifts = [
        Shift(name, size or math.nan, size or math.nan, ("run.csv", "wheel", 1) if size else None)
        for name, size in (("c", c), ("phi", phi))
    ]
    first = SimpleNamespace(wheels=[SimpleNamespace(segments=[1])])
    assert change_text._moved(SimpleNamespace(first=first, shifts=shifts)) == told
