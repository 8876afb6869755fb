"""A diagnosis in words."""

from types import SimpleNamespace

from terrain_cli.diagnosis.diagnosis_outcome import NextDrive
from terrain_cli.presentation import diagnosis_text


def test_a_drive_that_tells_several_apart_is_said_once():
    sweep = {"slip": [0.05, 0.6]}
    drives = [
        NextDrive(("load-bias", "slope"), "sweep", 0.98, sweep),
        NextDrive(("load-bias", "crust"), "sweep", 0.88, sweep),
        NextDrive(("load-bias", "bulldozing"), "no drive tells them apart: weigh it", 0.7, check="weigh it"),
    ]
    both = "slope (settles it in 98% of cases) or crust (settles it in 88% of cases)"
    found = SimpleNamespace(next_drive=drives, candidates=[], unknown=None)
    assert diagnosis_text._drives(found) == [
        "",
        f"to tell load-bias from {both}: sweep",
        "",
        "to tell load-bias from bulldozing: no drive tells them apart: weigh it",
    ]
