"""A diagnosis in words."""

import math
from types import SimpleNamespace

import pytest

from terrain_cli.diagnosis.diagnosis_outcome import Candidate, NextDrive
from terrain_cli.presentation import diagnosis_text


def test_a_drive_that_tells_several_apart_is_said_once():
    sweep = {"slip": [0.05, 0.6]}
    drives = [
        NextDrive(("load-bias", "slope"), "sweep", 0.98, sweep),
        NextDrive(("load-bias", "crust"), "sweep", 0.88, sweep),
        NextDrive(("load-bias", "bulldozing"), "no drive tells them apart: weigh it", 0.7, check="weigh it"),
    ]
    both = "slope (decides in 98% of cases) or crust (decides in 88% of cases)"
    found = SimpleNamespace(next_drive=drives, candidates=[], unknown=None)
    assert diagnosis_text._drives(found) == [
        "",
        f"to tell load-bias from {both}: sweep",
        "",
        "to tell load-bias from bulldozing: no drive tells them apart: weigh it",
    ]


@pytest.mark.parametrize(
    ("raised", "heldout", "noise", "told"),
    [
        (False, {}, 1.0, "–"),
        (True, {}, 1.0, "100%"),
        (False, {"torque": 1.02}, 1.0, "100%"),
        (False, {}, 0.5, "100%"),
        (False, {}, math.nan, "100%"),
    ],
)
def test_of_errors_that_are_those_of_noise_no_share_is_told(raised, heldout, noise, told):
    """Else "no effect explains the misfit" stands above one that explains all of it."""
    slope = Candidate(
        effect="slope",
        title="",
        score=1.0,
        p_value=0.5,
        surviving=1.0,
        explained=1.0,
        loss=0.0,
        loss_se=1.0,
        heldout={"torque": 1.01},
        sizes={},
        refitted=True,
    )
    torque = SimpleNamespace(unit="N m", heldout_rmse=1.02, noise=noise)
    found = SimpleNamespace(
        alarm=SimpleNamespace(raised=raised),
        comparison=SimpleNamespace(channels={"torque": torque}),
        heldout=heldout,
    )
    *_, row = diagnosis_text._table(found, [slope])
    assert row.split()[:2] == ["slope", told]
