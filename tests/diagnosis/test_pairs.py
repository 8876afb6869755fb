"""Two effects that are missing together, and look like a third while either is tried alone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hidden_drives import Kind, two, windows_of

from terrain_cli import models
from terrain_cli.diagnosis import diagnose, document, joining
from terrain_cli.effects import catalogue
from terrain_cli.improvement import Stopped, until_quiet

HIDDEN = ("load-bias", "motor-temperature")
SEED = 20601


@pytest.fixture(scope="module")
def wheels():
    drive = windows_of(SEED, Kind(two(*HIDDEN)))
    return joining.by_wheel(drive, catalogue().values())


@pytest.fixture(scope="module")
def found(wheels):
    return diagnose(wheels, models.ModelFile(), seed=SEED)


def test_both_are_named_where_none_alone_explains_it(found):
    assert found.together == HIDDEN
    assert (found.verdict, found.effect, found.unknown) == ("family", None, None)
    assert "add both with: terrain-est model add FILE load-bias motor-temperature" in found.sentence
    assert document.document(found)["together"] == list(HIDDEN)


def test_they_are_added_together_and_stay(wheels, found):
    nothing = replace(found.alarm, raised=False)
    answers = iter([found, replace(found, alarm=nothing)])
    *steps, end = until_quiet(wheels, models.ModelFile(), diagnose=lambda *_: next(answers), seed=SEED)
    assert [(step.action, step.changed, step.kept) for step in steps] == [
        ("add", HIDDEN, True),
        ("remove", HIDDEN[:1], False),
        ("remove", HIDDEN[1:], False),
    ]
    assert isinstance(end, Stopped)
    assert end.quiet
    assert {effect.id for effect in end.file.model.effects} == set(HIDDEN)
    for name, errors in steps[0].second.channels.items():
        assert errors.heldout_rmse < 1.1 * errors.noise, name
