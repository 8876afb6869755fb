"""Two effects that are missing together, and look like a third while either is tried alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import Kind, two, windows_of

from terrain_cli import models
from terrain_cli.diagnosis import diagnose, document, joining, pairs
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


@pytest.mark.parametrize(
    ("pair_loss", "name", "told"),
    [
        (800.0, "", ("slip-sinkage", "slope")),
        (800.0, "max-stress-angle", ("slip-sinkage", "slope")),  # it imitated both
        (800.0, "slope", ()),  # it is there, in another form than the catalogue's
        (995.0, "", ()),  # within chance of what else there is
        (995.0, "max-stress-angle", ()),
    ],
)
def test_a_pair_replaces_a_name_that_is_none_of_it(pair_loss, name, told):
    chance = np.random.default_rng(1).normal(0.0, 3.0, 40)
    effects = [SimpleNamespace(id=one) for one in ("slip-sinkage", "slope")]
    fit = SimpleNamespace(loss=np.full(40, pair_loss / 40) + chance)
    others = [SimpleNamespace(loss=np.full(40, 1000.0 / 40))]
    assert pairs.told((SimpleNamespace(effects=effects), fit), others, name) == told


def test_without_a_pair_nothing_is_told():
    assert pairs.told(None, [], "") == ()
