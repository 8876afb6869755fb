"""The loop, on a measured log and with diagnoses that are told to it: right, wrong, and none."""

from __future__ import annotations

import tomllib
from contextlib import chdir
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from changed_models import DIGS, write_all, write_log
from scipy.special import chdtrc

from terrain_cli import models, rover, telemetry
from terrain_cli.comparison import kept_aside
from terrain_cli.diagnosis.diagnosis_outcome import Alarm, NextDrive
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.improvement import Stopped, loop, model_history, tried_in_forms, until_quiet
from terrain_cli.improvement.change_trial import compared
from terrain_cli.models import Refused
from terrain_cli.presentation import change_text
from terrain_cli.vocabulary import toml_files
from terrain_cli.windows import cut_windows


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("logs")
    write_all(path)
    return path


@pytest.fixture(scope="module")
def sinks(folder):
    return cut(folder, "sinks.csv")


@pytest.fixture(scope="module")
def clean(folder):
    return cut(folder, "clean.csv")


#: A candidate of one's own, and where it lies.
OWN = {"digs-itself-in": "digs.toml"}
#: Comparisons of a log with a model, which several tests begin with.
_COMPARED = {}


def comparison_of(wheels, file):
    key = wheels[0].samples.source, file.model.base, *(effect.id for effect in file.model.effects)
    if key not in _COMPARED:
        _COMPARED[key] = compared(wheels, file)
    return _COMPARED[key]


def cut(folder, name):
    samples = telemetry.read(str(folder / name), rover.load(folder / "rover.toml"), effects=[], compared=True)
    return [cut_windows.cut(one, "none") for one in samples]


def diagnosing(*answers):
    """Return a diagnosis that gives these answers in turn: names, none of them, or something unknown."""
    left = list(answers)

    def diagnose(wheels, file):
        answer = left.pop(0) if left else []
        unknown = answer if isinstance(answer, SimpleNamespace) else None
        names = [] if unknown else list(answer)
        return SimpleNamespace(
            comparison=comparison_of(wheels, file),
            verdict="unknown" if unknown else "family" if names else "none",
            unrecorded=(),
            alarm=Alarm(raised=names != [] or unknown is not None, p_value=0.5, level=0.01),
            effect=names[0] if len(names) == 1 else None,
            family=tuple(names),
            unknown=unknown,
            together=(),
            together_or=(),
            pair=None,
            candidates=[],
            heldout={},
            soils=1,
            next_drive=[NextDrive((names[0], name), f"drive for {name}", 0.9) for name in names[1:]],
        )

    return diagnose


def run(wheels, *answers, **options):
    *steps, end = until_quiet(wheels, models.resolve("wong-reece"), diagnose=diagnosing(*answers), **options)
    assert isinstance(end, Stopped)
    return steps, end


def told(steps):
    return [(one.action, *one.changed, one.kept) for one in steps]


def effects(end):
    return [effect.id for effect in end.file.model.effects]


def test_silence_changes_nothing(clean):
    steps, end = run(clean)
    assert (steps, effects(end), end.silent) == ([], [], True)


@pytest.fixture(scope="module")
def right(sinks):
    """Return what becomes of the right name."""
    return run(sinks, ["slip-sinkage"])


def test_right_name_is_added_and_the_alarm_asked_again(right):
    steps, end = right
    assert told(steps) == [("add", "slip-sinkage", True)]
    assert effects(end) == ["slip-sinkage"]
    assert end.silent


def test_the_next_of_a_family_is_tried_and_told_with_what_the_data_do_not_tell_it_from(sinks):
    family = ["drivetrain-friction", "load-bias", "slip-sinkage"]
    (*refused, kept), end = run(sinks, family)
    assert told([*refused, kept]) == [
        ("add", "drivetrain-friction", False),
        ("add", "load-bias", False),
        ("add", "slip-sinkage", True),
    ]
    assert effects(end) == ["slip-sinkage"]
    assert [(one.rivals, one.next_drive) for one in refused] == [((), None)] * len(refused)
    assert kept.rivals == ("drivetrain-friction", "load-bias")
    assert kept.next_drive.manoeuvre == "drive for slip-sinkage"
    assert (
        "kept slip-sinkage; these data cannot tell it from drivetrain-friction or load-bias: "
        "drive for slip-sinkage" in change_text.loop_text([*refused, kept], end)
    )
    drive = replace(kept.next_drive, settings={"load": [48.0, 80.0]}, power=0.9)
    assert change_text.doubt(replace(kept, next_drive=drive)).endswith(
        "; to tell, drive for slip-sinkage (decides in 90% of cases)"
    )
    # Where its rivals are in the model too, nothing is in doubt.
    effects_too = tuple(SimpleNamespace(id=name) for name in family)
    model = replace(end.file.model, effects=effects_too)
    both = replace(end, file=replace(end.file, model=model))
    assert "cannot tell it" not in change_text.loop_text([kept], both)
    whole = change_text.loop([*refused, kept], end)["steps"][-1]
    entry = model_history.entry(kept, "")
    for found in (whole, entry):
        assert found["rivals"] == list(kept.rivals)
        assert found["next_drive"]["pair"] == ["drivetrain-friction", "slip-sinkage"]
    assert tomllib.loads(f"entry = {toml_files.value(entry)}")["entry"]["rivals"] == list(kept.rivals)


def test_stretches_kept_aside_are_hidden_from_the_diagnosis_and_judge(sinks):
    marked = kept_aside.marked(sinks, 0.5)
    aside = marked[0].samples.aside
    answer, shown = diagnosing(["slip-sinkage"]), []

    def diagnose(wheels, file):
        shown.append(np.isin(wheels[0].rows, np.flatnonzero(aside)).sum())
        return answer(sinks, file)

    kept, end = until_quiet(marked, models.resolve("wong-reece"), diagnose=diagnose)
    assert shown == [0, 0]
    assert (effects(end), kept.proof) == (["slip-sinkage"], "stretches kept aside")
    assert kept.evidence.aside == aside.sum() == len(sinks[0].rows) // 2
    assert "proof: stretches kept aside, 240 samples that diagnose" in change_text.loop_text([kept], end)
    entry = model_history.entry(kept, "")
    assert (entry["proof"], entry["data"]["kept_aside"]) == ("stretches kept aside", 240)
    assert entry["proof_because"] is None


def test_one_name_has_no_rivals(right):
    (kept,), end = right
    assert (kept.rivals, kept.next_drive) == ((), None)
    told = change_text.loop_text([kept], end)
    assert "do not tell" not in told
    # Another drive is for effects that are named.
    assert (
        "proof: on data that may have chosen the effect; for a stricter proof give --keep-aside SHARE\n"
        in told
    )
    assert model_history.entry(kept, "")["rivals"] is None


def test_what_does_not_pay_is_never_kept(clean):
    steps, end = run(clean, ["drivetrain-friction", "load-bias"])
    assert told(steps) == [("add", "drivetrain-friction", False), ("add", "load-bias", False)]
    assert (effects(end), end.silent) == ([], False)
    assert "no further effect; tried: drivetrain-friction and load-bias" in end.because


def test_an_effect_that_another_makes_needless_is_dropped(folder):
    """A gear that loses a share of the torque explains friction in part."""
    write_log(folder / "rubs.csv", {"drivetrain-friction": {"Tc": 0.6, "Bv": 0.0}}, seed=3)
    steps, end = run(cut(folder, "rubs.csv"), ["gear-efficiency"], ["drivetrain-friction"])
    assert told(steps)[:2] == [("add", "gear-efficiency", True), ("add", "drivetrain-friction", True)]
    assert [[one.effect for one in step.idle] for step in steps[:2]] == [[], ["gear-efficiency"]]
    assert "\ngear-efficiency is no longer significant (p 0." in change_text.text(steps[1])
    (idle,) = change_text.loop(steps, end)["steps"][1]["idle"]
    assert idle["effect"] == "gear-efficiency"
    assert 0.01 < idle["p_value"] <= 1.0
    assert ("remove", "gear-efficiency", True) in told(steps)
    assert effects(end) == ["drivetrain-friction"]
    # The silence that is told is that of the model as it is in the end.
    assert (end.silent, end.evidence.verdict) == (True, "none")
    for one in steps:
        assert one.kept == (one.pays if one.action == "add" else not one.costs)


def test_what_nature_does_not_have_is_not_kept_though_the_error_falls(sinks):
    """A peak of stress far in front makes a wheel sink that digs itself in: further than was published."""
    (step,), end = run(sinks, ["max-stress-angle"])
    assert (step.better, step.pays, step.kept) == (True, False, False)
    (one,) = step.imitates
    assert one.name == "max-stress-angle.c1 + max-stress-angle.c2"
    assert one.value - 0.85 > 2.0 * one.se
    assert effects(end) == []


def test_unknown_stops_without_a_place_for_a_draft(sinks):
    steps, end = run(
        sinks,
        SimpleNamespace(
            law="torque follows yaw rate",
            draft="",
            sentence="sinkage follows slip",
            begins=False,
            explained=0.9,
        ),
    )
    assert (steps, end.silent) == ([], False)
    assert end.because == "sinkage follows slip; --draft FILE.toml adds this law"


def test_a_draft_is_tried_as_any_effect(sinks, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def draft(unknown):
        (tmp_path / "draft.toml").write_text(unknown.draft, "utf-8")
        return "draft.toml"

    steps, end = run(
        sinks, SimpleNamespace(channel="torque", driver="yaw_rate", sentence="", draft=DIGS), draft=draft
    )
    assert told(steps) == [("add", "digs-itself-in", True)]
    assert end.file.effects == ("draft.toml",)


@pytest.fixture(scope="module")
def own(sinks, folder):
    """Return what becomes of a candidate of one's own."""
    with chdir(folder):
        return run(sinks, ["digs-itself-in"], paths=OWN)


def test_candidates_of_ones_own_are_named_by_their_paths(own):
    steps, end = own
    assert told(steps) == [("add", "digs-itself-in", True)]
    assert end.file.effects == ("digs.toml",)


def test_an_alarm_without_a_name_is_told(sinks):
    nothing = SimpleNamespace(
        comparison=SimpleNamespace(
            model={"base": "wong-reece", "effects": []},
            channels={},
            blocks=20,
            stretch=None,
            doubted=(),
            at_limit=(),
            refused=Refused(),
            points=False,
            failures=[],
            soil_count=1,
            soil_changes=[],
            impossible=(),
            unsorted=False,
            wheels=[None],
        ),
        heldout={},
        soils=1,
        verdict="family",
        unrecorded=(),
        alarm=Alarm(raised=True, p_value=0.0, level=0.01),
        effect=None,
        family=(),
        unknown=None,
        together=(),
        together_or=(),
        pair=None,
        candidates=[],
        next_drive=[],
    )
    (end,) = until_quiet(sinks, models.resolve("wong-reece"), diagnose=lambda *_: nothing)
    assert not end.silent
    assert "no effect can be named" in end.because


@pytest.mark.parametrize(
    ("effects", "says"),
    [
        ((), "no effect explains the misfit"),
        (("slope",), "no further effect explains what is left"),
    ],
)
def test_what_an_effect_leaves_is_not_all_of_the_misfit(effects, says, monkeypatch):
    """Beside what was just added, "no effect explains the misfit" would speak against it."""
    known = Evidence(ratios={"torque": 1.4}, blocks=20, raised=False, effects=effects)
    monkeypatch.setattr(Evidence, "of_diagnosis", lambda _: known)
    assert loop._proposed(SimpleNamespace(alarm=SimpleNamespace(raised=False)), None) == ([], says)


def test_how_sure_an_effect_is_of_itself(own, clean, folder, monkeypatch):
    """The right one far beyond chance; one that is absent by Wald's test from its own numbers."""
    monkeypatch.chdir(folder)
    (right,), _ = own
    (one,) = right.parameters
    assert right.absent == pytest.approx(chdtrc(1, (one.value / one.se) ** 2), abs=1e-12)
    assert right.absent < 1e-6
    (wrong,), _ = run(clean, ["digs-itself-in"], paths=OWN)
    (one,) = wrong.parameters
    assert wrong.absent == pytest.approx(chdtrc(1, (one.value / one.se) ** 2), rel=1e-6)
    assert wrong.absent > 0.001


def test_it_ends(clean, monkeypatch):
    """Even if everything seems to pay, and the alarm never falls silent."""
    from terrain_cli.improvement import improvement_criteria
    from terrain_cli.improvement.improvement_outcome import Step

    monkeypatch.setattr(Step, "pays", True)
    assert improvement_criteria.MOST_EFFECTS >= 4
    monkeypatch.setattr(improvement_criteria, "MOST_EFFECTS", 2)
    steps, end = run(clean, ["slip-sinkage"], ["load-bias"], ["hardpan"])
    assert [one.changed for one in steps if one.action == "add"] == [("slip-sinkage",), ("load-bias",)]
    assert end.because == "stopped after 2 effects"


def test_an_effect_that_needs_more_than_was_read(sinks):
    """Rates are computed where a candidate uses them."""
    steps, _ = run(sinks, ["acceleration-torque"])
    assert told(steps) == [("add", "acceleration-torque", False)]
    assert [one.name for one in steps[0].parameters] == ["acceleration-torque.J"]


@pytest.mark.parametrize(("filtered", "held"), [(0.0, {}), (1.0, {"sensor-lag.filtered": 1.0})])
def test_a_late_channel_gets_the_form_that_predicts_better(folder, filtered, held):
    """A delay or a first-order filter of 1 s: diagnose tries both, and so does who adds the effect."""
    late = {"torque_lag": 1.0, "filtered": filtered}
    write_log(folder / "late.csv", {"sensor-lag": late}, seed=79_990_004)
    wheels, before = cut(folder, "late.csv"), models.resolve("wong-reece")
    step = tried_in_forms(wheels, "add", models.added(before, ["sensor-lag"], 0.018), before)
    assert step.pays
    assert step.after.fixed == held
    told_form = ", with sensor-lag.filtered = 1 (0: the channel is delayed; 1: a first-order filter"
    assert (told_form in change_text.verdict(step)) == bool(held)
    lag = next(one for one in step.parameters if one.name == "sensor-lag.torque_lag")
    assert lag.value == pytest.approx(1.0, abs=0.05)
