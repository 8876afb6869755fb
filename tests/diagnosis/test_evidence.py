"""What comparisons and diagnoses tell of a model."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conclusions import ASKED, LOOK

from terrain_cli.diagnosis.conclusion import conclude
from terrain_cli.diagnosis.diagnosis_outcome import NextDrive, UnknownEffect
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.effects import catalogue
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import Refused


def compared_to(channels, **further):
    known = {
        "blocks": 20,
        "stretch": None,
        "doubted": (),
        "at_limit": (),
        "refused": Refused(),
        "points": False,
    }
    known |= {"soil_count": 0, "soil_changes": [], "wheels": [None], "unsorted": False, "impossible": ()}
    known["model"] = {"base": "wong-reece", "effects": []}
    return SimpleNamespace(channels=channels, **{**known, "failures": [], **further})


@pytest.mark.parametrize(("amplitude", "raised"), [(0.002, False), (-0.002, False), (0.004, True)])
def test_a_finding_too_small_for_an_alarm_of_diagnose_raises_none_in_compare(amplitude, raised):
    # A torque of 1 N m, of which diagnose asks for 0.3 %.
    torque = SimpleNamespace(rmse=0.01, nrmse=0.01, noise=0.01, heldout_rmse=0.0102)
    finding = SimpleNamespace(channel="torque", amplitude=amplitude)
    found = compared_to({"torque": torque}, failures=[finding], scores=None)
    assert Evidence.of_comparison(found).raised is raised


def candidate(effect, **known):
    usual = {"doubt": "", "explained": 0.9, "refitted": True, "noise": {}, "settles": False}
    return SimpleNamespace(effect=effect, **{**usual, **known})


def diagnosis(*, stretch=None, **known):
    torque = SimpleNamespace(noise=1.0, heldout_rmse=5.0)
    usual = {
        "alarm": SimpleNamespace(raised=True, small=False, idle=False),
        "unknown": None,
        "together": (),
        "together_or": (),
        "pair": None,
        "candidates": [],
        "next_drive": [],
        "unrecorded": (),
        "heldout": {},
        "soils": 0,
    }
    return SimpleNamespace(comparison=compared_to({"torque": torque}, stretch=stretch), **{**usual, **known})


@pytest.mark.parametrize(
    ("driver", "form", "explained", "command"),
    [
        ("time", "saturating", 0.99, LOOK + " --draft law.toml"),
        ("board V", "step", 0.99, LOOK + " --draft law.toml"),
        ("board V", "step", 0.3, "terrain-est compare 'a run.csv' --segments none --where 'time < 40'"),
        ("time", "step", 0.99, "terrain-est compare 'a run.csv' --segments none --where 'time < 40'"),
    ],
)
def test_a_law_that_explains_most_is_more_than_a_stretch_unless_it_is_that_stretch(
    driver, form, explained, command
):
    """What drifts is off most of all at one end: to leave out half of a log again and again ends nowhere."""
    law = UnknownEffect(
        channel="sinkage", driver=driver, form=form, explained=explained, law="", sentence="", draft=""
    )
    found = diagnosis(verdict="unknown", family=(), unknown=law, stretch=(40.0, math.inf))
    assert conclude(Evidence.of_diagnosis(found), ASKED).command == command


def test_effects_of_a_doubtful_size_explain_nothing():
    names = ("slope", "crust", "hardpan")
    doubts = ("", "at its bound", "")
    found = diagnosis(
        verdict="family",
        family=names,
        candidates=[
            candidate(name, doubt=doubt, heldout={"torque": 1.6})
            for name, doubt in zip(names, doubts, strict=True)
        ],
        next_drive=[
            NextDrive(("slope", "crust"), "drive over firm ground", 0.9, settings={"part": []}),
            NextDrive(("slope", "hardpan"), "no drive tells", 0.1, check="weigh it"),
            NextDrive(("slope", "crust"), "no drive tells", 0.1, check="level it"),
        ],
    )
    evidence = Evidence.of_diagnosis(found)
    assert evidence.family == ("slope", "hardpan")
    assert evidence.leaves
    assert (evidence.drive, evidence.checks) == ("", ("weigh it",))
    for one in found.candidates:
        # A twelfth of the error: the noise differs by as much between models.
        one.doubt, one.heldout = "at its bound", {"torque": 1.3}
    assert not Evidence.of_diagnosis(found).leaves
    assert Evidence.of_diagnosis(found).family == names


@pytest.mark.parametrize(
    ("noise", "heldout", "told"),
    [
        (
            2.0,
            4.4,
            "2.2 × the noise in torque (noise of torque as estimated with sensor-lag), and sensor-lag",
        ),
        (
            3.9,
            4.4,
            "at most 1.10 × the noise (in torque), but the residuals are systematic, and sensor-lag explains",
        ),
        # Where compare sees it too, both say the same.
        (2.0, 10.0, "2.5 × the noise in torque, and sensor-lag explains"),
    ],
)
def test_a_misfit_that_passed_for_noise_is_none(noise, heldout, told):
    """The jumps that a lag leaves; noise differs by some percent between models that miss nothing."""
    found = SimpleNamespace(
        comparison=compared_to({"torque": SimpleNamespace(noise=4.0, heldout_rmse=heldout)}),
        alarm=SimpleNamespace(raised=True, small=False, idle=False),
        verdict="effect",
        unknown=None,
        family=("sensor-lag",),
        together=(),
        together_or=(),
        pair=None,
        candidates=[candidate("sensor-lag", heldout={"torque": 2.0}, noise={"torque": noise})],
        next_drive=[],
        unrecorded=(),
        heldout={},
        soils=0,
    )
    assert told in conclude(Evidence.of_diagnosis(found), ASKED).sentence


@pytest.mark.parametrize(
    ("after", "ratio", "fewer", "better"),
    [
        # It leaves what two soils leave: all that it explains is their difference.
        (1.5, 6.0, 1, False),
        # It takes off what these miss too, or leaves as much again.
        (1.0, 1.5, 0, False),
        (5.0, 1.5, 0, True),
    ],
)
def test_what_an_effect_explains_is_told_of_the_soils_that_it_stands_for(after, ratio, fewer, better):
    torque = SimpleNamespace(noise=1.0, heldout_rmse=1.5)
    found = diagnosis(
        verdict="family",
        family=("multi-pass",),
        candidates=[candidate("multi-pass", heldout={"torque": after}, noise={"torque": 1.0})],
        heldout={"torque": 6.0},
        soils=1,
    )
    found.comparison = compared_to({"torque": torque}, soil_count=2, soil_changes=["8 s"])
    evidence = Evidence.of_diagnosis(found)
    assert evidence.ratios == {"torque": ratio}
    assert (evidence.fewer, evidence.better) == (fewer, better)


@pytest.mark.parametrize(
    ("explained", "told"),
    [
        (0.0, "no effect explains it significantly; held-out data can test sensor-lag. Next: "),
        (0.02, "load-transfer explains a part of it, but this is not certain. Next: "),
    ],
)
def test_what_takes_nothing_off_an_error_is_not_said_to_explain_a_part_of_it(explained, told):
    """It predicts best once the noise is weighed, and the errors that are printed do not fall."""
    found = diagnosis(
        verdict="family",
        family=("load-transfer",),
        candidates=[
            candidate("load-transfer", explained=explained, heldout={"torque": 5.0}),
            candidate("sensor-lag", explained=0.76, heldout={"torque": 2.0}),
        ],
    )
    assert told in conclude(Evidence.of_diagnosis(found), ASKED).sentence


@pytest.mark.parametrize(
    ("settles", "heldout", "left"),
    [
        (True, 1.0, ("the unit of load",)),
        (False, 1.0, ("the unit of torque", "the unit of load")),
        # What an effect leaves much of is not explained by it.
        (True, 3.0, ("the unit of torque", "the unit of load")),
    ],
)
def test_an_effect_that_explains_the_misfit_removes_the_doubt_of_a_unit(settles, heldout, left):
    torque = SimpleNamespace(noise=1.0, heldout_rmse=5.0)
    warm = candidate("motor-temperature", explained=1.0, settles=settles, heldout={"torque": heldout})
    found = SimpleNamespace(
        comparison=compared_to({"torque": torque}, doubted=("the unit of torque", "the unit of load")),
        alarm=SimpleNamespace(raised=True, small=False, idle=False),
        verdict="effect",
        unknown=None,
        family=("motor-temperature",),
        together=(),
        together_or=(),
        pair=None,
        candidates=[warm],
        next_drive=[],
        unrecorded=(),
        heldout={},
        soils=0,
    )
    assert Evidence.of_diagnosis(found).doubted == left


@pytest.mark.parametrize(
    ("effect", "shared", "beyond", "absent"),
    [
        # A bound at which the effect does nothing.
        ("hardpan", {"modulus": 0.0, "top": 0.01}, {}, ("hardpan",)),
        # One at which it does as much as it can.
        (
            "post-peak-softening",
            {"loss": -0.5, "length": 0.07},
            {"post-peak-softening": "post-peak-softening.loss = -0.5, which is its bound"},
            (),
        ),
        # Where an effect acts is no size of it.
        ("post-peak-softening", {"loss": 0.2, "length": 0.5}, {}, ()),
        (
            "drivetrain-friction",
            {"Tc": -0.4},
            {"drivetrain-friction": "drivetrain-friction.Tc = -0.4 N m, which is physically impossible"},
            (),
        ),
        ("drivetrain-friction", {"Tc": 0.4}, {}, ()),
        ("sensor-lag", {"sinkage_lag": 0.3, "filtered": 0.0}, {}, ()),
    ],
)
def test_what_an_effect_of_the_model_came_to_is_told(effect, shared, beyond, absent):
    values = {f"{effect}.{name}": value for name, value in shared.items()}
    # What is held at a bound is no size of an effect either.
    held = {"sensor-lag.filtered"}
    fit = SimpleNamespace(shared=values, under=(60.0, 0.1), undetermined=values.keys() - held)
    model = Model(effects=(catalogue()[effect],))
    wheel = SimpleNamespace(model=model, fit=fit)
    limited = [(values, 1e-4 * np.eye(len(values)), {}, fit.under)]
    torque = SimpleNamespace(rmse=0.01, nrmse=0.01, noise=0.01, heldout_rmse=0.0102)
    named = {"base": "wong-reece", "effects": [effect]}
    found = Evidence.of_comparison(
        compared_to({"torque": torque}, scores=None, wheels=[wheel], limited=lambda: limited, model=named)
    )
    assert (dict(found.beyond), found.absent) == (beyond, absent)


@pytest.mark.parametrize(
    ("further", "made_up"),
    [({}, True), ({"reference": "a paper"}, False), ({"laws": {}}, False), ({"needs": ("load",)}, False)],
)
def test_nature_bounds_the_sum_of_an_effect_and_a_drafted_law_of_the_same(further, made_up):
    """Friction below nothing drives no wheel where a parabola of the same speed is on top of it."""
    friction = catalogue()["drivetrain-friction"]
    drafted = {"reference": "empirical: drafted", "needs": ("angular_velocity",), **further}
    law = replace(friction, id="law", parameters=(), any_of=(), sums=(), **drafted)
    values = {"drivetrain-friction.Tc": -0.4}
    fit = SimpleNamespace(shared=values, under=(60.0, 0.1), undetermined=set())
    wheel = SimpleNamespace(model=SimpleNamespace(effects=(friction, law)), fit=fit)
    torque = SimpleNamespace(rmse=0.01, nrmse=0.01, noise=0.01, heldout_rmse=0.0102)
    limited = [(values, 1e-4 * np.eye(1), {}, fit.under)]
    known = {"wheels": [wheel], "limited": lambda: limited}
    known["model"] = {"base": "wong-reece", "effects": [friction.id, law.id]}
    found = Evidence.of_comparison(compared_to({"torque": torque}, scores=None, **known))
    assert (not found.beyond) is made_up


@pytest.mark.parametrize(
    ("fitted", "closest"),
    [
        # Of what was fitted the fit counts; a score alone says of every effect that it explains all.
        ({"slope": 0.12}, ""),
        ({"slope": 0.7}, "slope"),
        # Of those that explain as much, the first listed: by their names, it would be the last.
        ({}, "slope"),
    ],
)
def test_where_the_alarm_is_silent_held_out_data_test_what_explains_most(fitted, closest):
    candidates = [candidate(n, explained=fitted.get(n, 1.0), refitted=n in fitted) for n in ("slope", "z")]
    found = diagnosis(verdict="none", family=(), candidates=candidates)
    found.alarm.raised = False
    assert Evidence.of_diagnosis(found).closest == closest
