"""Two effects that are missing together, and look like a third while either is tried alone."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import Kind, two, windows_of

from terrain_cli import models
from terrain_cli.diagnosis import diagnose, pairs
from terrain_cli.effects import catalogue
from terrain_cli.improvement import Stopped, until_quiet
from terrain_cli.presentation import diagnosis_text
from terrain_cli.windows import joined_inputs

HIDDEN = ("load-bias", "motor-temperature")
SEED = 20601


@pytest.fixture(scope="module")
def wheels():
    drive = windows_of(SEED, Kind(two(*HIDDEN)))
    return joined_inputs.by_wheel(drive, catalogue().values())


@pytest.fixture(scope="module")
def found(wheels):
    return diagnose(wheels, models.ModelFile(), seed=SEED)


def test_both_are_named_where_none_alone_explains_it(found):
    assert found.together == HIDDEN
    assert (found.verdict, found.effect, found.unknown) == ("family", None, None)
    assert "Load-bias and motor-temperature together explain more than any effect alone." in found.sentence
    told = diagnosis_text.document(found)["conclusion"]
    assert told["command"].split(" --data ")[0].endswith("model add model.toml load-bias motor-temperature")
    assert diagnosis_text.document(found)["together"] == list(HIDDEN)


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
    assert end.silent
    assert {effect.id for effect in end.file.model.effects} == set(HIDDEN)
    for name, errors in steps[0].second.channels.items():
        assert errors.heldout_rmse < 1.1 * errors.noise, name
        # What the diagnosis told of both is what the change shows.
        assert found.pair.heldout[name] == pytest.approx(errors.heldout_rmse, rel=0.02), name
        assert found.pair.noise[name] == pytest.approx(errors.noise, rel=0.02), name


def test_the_table_has_a_row_of_both(found):
    lines = diagnosis_text.text(found).splitlines()
    row = next(line for line in lines if line.startswith("* "))
    assert row.startswith("* load-bias and motor-temperature")
    assert float(row.split("%")[0].split()[-1]) > 95.0
    told = diagnosis_text.document(found)
    assert told["together_heldout_rmse"] == found.pair.heldout
    alone = [one["heldout_rmse"]["torque"] for one in told["candidates"] if one["effect"] in HIDDEN]
    assert told["together_heldout_rmse"]["torque"] < min(alone)


PAIR = ("slip-sinkage", "slope")
OTHER = ("max-stress-angle", "sensor-lag")


@pytest.mark.parametrize(
    ("pair_loss", "with_name", "name", "told"),
    [
        (800.0, 950.0, "", (PAIR, True, ())),
        (800.0, 801.0, "", (PAIR, True, (OTHER,))),  # these data cannot tell
        (800.0, 950.0, "max-stress-angle", (PAIR, True, ())),  # it imitated both
        (800.0, 801.0, "max-stress-angle", (PAIR, False, (OTHER,))),  # or it may be one of two
        (800.0, 790.0, "max-stress-angle", ((), False, ())),  # it is one of two
        (800.0, 950.0, "slope", ((), False, ())),  # it is there, in another form than the catalogue's
        (995.0, 1005.0, "", ((), False, ())),  # within chance of what else there is
    ],
)
def test_a_pair_replaces_a_name_that_is_none_of_it(pair_loss, with_name, name, told):
    def fitted(loss, seed, *ids):
        chance = np.random.default_rng(seed).normal(0.0, 3.0, 40)
        effects = [SimpleNamespace(id=one) for one in ids]
        return SimpleNamespace(effects=effects), SimpleNamespace(loss=loss / 40 + chance - chance.mean())

    several = [
        fitted(pair_loss, 1, *PAIR),
        fitted(with_name, 2, *OTHER),
    ]
    several.sort(key=lambda one: one[1].loss.sum())
    two = pairs.two_of(several, [fitted(1000.0, 3)[1]], name)
    assert (two.ids, two.is_best, two.rivals) == told


def test_without_a_pair_nothing_is_told():
    assert pairs.two_of([], [], "") == pairs.Two()


@pytest.mark.parametrize(
    ("alone", "beside", "told"),
    [
        (-0.04, -0.2, False),  # in doubt only as the other one takes up what it does
        (-0.04, 0.2, True),  # what it took up alone is the other's
        (0.04, -0.2, True),  # and that may be noise
    ],
)
def test_a_pair_hides_no_effect_that_is_impossible_alone(alone, beside, told, monkeypatch):
    """Soil that pushes the wheel came back beside a load whose gain did the reverse."""
    first, second = (SimpleNamespace(id=name, effects=(name,)) for name in ("bulldozing", "load-bias"))
    pair = SimpleNamespace(id="both")
    sizes = {"bulldozing": (alone, 0.002), "load-bias": (1.0, 0.1), "both": (beside, 0.34)}

    def refit(data, one, **_):
        value, se = sizes[one.id]
        return SimpleNamespace(value=value, se=se, loss=np.ones(2))

    def imitates(data, one, fit, errors=3.0):
        return one.id == "bulldozing" and fit.value < -errors * fit.se

    monkeypatch.setattr(pairs, "_both", lambda *_: pair)
    monkeypatch.setattr(pairs.screening, "promising_pairs", lambda *_: [(first, second)])
    monkeypatch.setattr(pairs.refits, "refit", refit)
    monkeypatch.setattr(pairs.refit_ranking, "imitates", imitates)
    monkeypatch.setattr(pairs.refit_ranking, "doubt", lambda *_: "")
    log = SimpleNamespace(hypotheses=[], found=None)
    ranked = [(one, refit(None, one)) for one in (first, second)]
    assert bool(pairs.best(None, log, ranked, lambda _: None, "")) == told
