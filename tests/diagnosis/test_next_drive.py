"""The drive that a family of explanations asks for, on logs of the independent simulator."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import LOAD, SPEED, Kind, drive_of, samples_from, sized
from next_drives import appended
from simulator import constant, simulate

from terrain_cli import simulation
from terrain_cli.comparison import blocks, held_out
from terrain_cli.comparison.compare import fit_wheels
from terrain_cli.diagnosis import (
    diagnosis_criteria,
    manoeuvres,
    next_drive,
    refit_ranking,
    refits,
    screening,
    steps,
)
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
from terrain_cli.diagnosis.next_drive import suggest
from terrain_cli.diagnosis.verdict import Decision
from terrain_cli.effects import catalogue
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.mechanics.effect import Effect, Parameter
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile
from terrain_cli.windows import joined_inputs
from terrain_cli.windows.cut_windows import cut

SEED = 2


def sensor(name, channel, law, scale, null=0.0, needs=()):
    """Return an effect with one parameter `a` on one channel."""
    return Effect(
        id=name,
        title=name,
        kind="sensor",
        parameters=(Parameter("a", "1", null, scale),),
        laws={channel: law},
        needs=needs,
    )


OWN = {
    effect.id: effect
    for effect in (
        sensor("coulomb", "torque", lambda q: q["torque"] + q["a"], 0.5),
        sensor("coulomb-again", "torque", lambda q: q["torque"] + q["a"], 0.5),
        sensor(
            "viscous",
            "torque",
            lambda q: q["torque"] + q["a"] * np.absolute(q["angular_velocity"]),
            0.2,
            needs=("angular_velocity",),
        ),
        # Torque is counted the way the wheel turns: what is constant at the sensor turns round with it.
        sensor(
            "torque-bias",
            "torque",
            lambda q: q["torque"] + q["a"] * np.sign(q["angular_velocity"]),
            0.5,
            needs=("angular_velocity",),
        ),
        sensor("drawbar-bias", "drawbar_pull", lambda q: q["drawbar_pull"] + q["a"], 5.0),
        sensor("load-gain", "load", lambda q: q["load"] / q["a"], 0.05, 1.0),
    )
}
FRICTION = {"drivetrain-friction": {"Tc": 0.4, "Bv": 0.0}}


def poor(effects, noise="white"):
    return Kind(effects=effects, course="poor", noise=noise, rate=10.0)


def windows(kind, *, pull=True, pitch=0.0):
    drive = replace(drive_of(SEED, kind), pitch=constant(pitch))
    columns = simulate(drive).wheels["wheel"].aligned()
    if not pull:
        columns.pop("drawbar_pull")
    return cut(samples_from("log", columns, kind), "auto")


def fitted(several, names):
    """Fit the base and each effect, the best first."""
    effects = [OWN.get(name) or catalogue()[name] for name in names]
    file = ModelFile(model=Model("wong-reece"))
    joined = joined_inputs.by_wheel(several, effects)
    settings = FitSettings.of(joined, file)
    further = tuple(dict.fromkeys(name for effect in effects for name in effect.reads))
    wheels, _ = fit_wheels(joined, file.model, settings, further=further)
    wheels, _ = held_out.join_segments(wheels)
    block = [part.astype(np.intp) for part in blocks.fine([len(wheel) for wheel in wheels], 60, most=24)]
    data = refits.ground(wheels, block, 1500)
    found, lacking = screening.hypotheses(file, wheels, effects)
    assert not lacking
    pairs = [(one, refits.refit(data, one)) for one in found]
    return data, sorted(pairs, key=lambda pair: float(pair[1].loss.sum()))


#: Name → what is hidden, what it may be, and how the log was driven.
CASES = {
    "reverse": (FRICTION, ("coulomb", "torque-bias"), {}),
    "speed": (FRICTION, ("coulomb", "viscous"), {"pull": False}),
    "warm": (sized("motor-temperature"), ("motor-temperature", "coulomb"), {}),
    "load": (sized("bulldozing"), ("bulldozing", "drawbar-bias"), {}),
    "slope": (sized("slope"), ("slope", "drawbar-bias"), {"pitch": 0.08}),
    "radius": (sized("wheel-radius"), ("wheel-radius", "post-peak-softening"), {}),
    "same": (FRICTION, ("coulomb", "coulomb-again"), {}),
    "three": (FRICTION, ("coulomb", "viscous", "torque-bias", "motor-temperature"), {}),
    "lasting": (sized("motor-temperature"), ("motor-temperature", "coulomb"), {"noise": "ar1"}),
    "large": (
        sized("motor-temperature"),
        ("motor-temperature", "coulomb", "gear-efficiency", "sinkage-bias", "drawbar-bias"),
        {},
    ),
}


@lru_cache
def case(name):
    effects, pair, given = CASES[name]
    return fitted([windows(poor(effects, given.get("noise", "white")), **without_noise(given))], pair)


def without_noise(given):
    return {name: value for name, value in given.items() if name != "noise"}


def reach(part, name):
    """Return the least and the greatest value of what varies in a part of a drive."""
    given = part[name]
    values = given["steps"] if isinstance(given, dict) else np.atleast_1d(given)
    return min(values), max(values)


@pytest.mark.parametrize(
    ("name", "channel", "low", "high"),
    [
        ("reverse", "speed", -1.0, 1.0),
        ("speed", "speed", 0.5, 2.0),
        ("warm", "motor_temperature", 30.0, 70.0),
        ("load", "load", 0.6, 1.4),
        ("slope", "pitch_deg", -10.0, 10.0),
        ("radius", "slip", -0.1, 0.6),
    ],
)
def test_the_drive_is_the_one_known_to_settle_it(name, channel, low, high):
    data, pairs = case(name)
    (found,) = suggest(data, pairs)
    assert found.pair == tuple(one.id for one, _ in pairs)
    assert 0.9 < found.power <= diagnosis_criteria.MOST_POWER
    least, greatest = reach(found.settings, channel)
    assert least <= low
    assert greatest >= high
    assert (least > 0.0) == (name in {"speed", "load", "warm"})
    others = {"slip", "load", "speed", "pitch_deg", "motor_temperature"} - {channel}
    assert all(np.ptp(reach(found.settings, one)) == 0.0 for one in others & found.settings.keys())


def test_where_no_drive_tells_it_says_so_and_what_does():
    data, pairs = case("same")
    (found,) = suggest(data, pairs)
    assert found.power == pytest.approx(diagnosis_criteria.RULED_OUT, abs=1e-6)
    assert found.manoeuvre.startswith("no drive tells them apart")
    assert "known brake" in found.manoeuvre
    assert found.settings == {}


def test_of_a_sensor_that_cannot_be_told_from_the_ground_it_asks_for_a_calibration():
    model = Model("wong-reece")
    one, other = (
        Hypothesis(id=effect.id, title=effect.title, model=model, effects=(effect,))
        for effect in (catalogue()["bulldozing"], OWN["load-gain"])
    )
    found = next_drive._unsettled(one, other, diagnosis_criteria.LEAST_POWER - 0.1)
    assert found.check == "calibrate the load cell with known weights"
    assert found.manoeuvre.endswith(found.check)


def test_of_drives_of_the_same_power_one_that_was_not_just_driven_comes_first():
    part = SimpleNamespace(inputs={"slip": np.linspace(0.03, 0.57, 50), "load": np.linspace(70.0, 130.0, 50)})
    known = {one.varies: one for one in manoeuvres.library(AT, 60.0)}
    sweep, loads = (known[frozenset(names)] for names in ({"slip"}, {"slip", "load"}))
    course = {"slip": np.linspace(0.05, 0.6, 50), "load": np.full(50, 100.0)}
    assert next_drive.driven(sweep, course, part)
    assert not next_drive.driven(loads, course | {"load": np.repeat([60.0, 140.0], 25)}, part)
    assert not next_drive.driven(sweep, course, SimpleNamespace(inputs={}))
    side = SimpleNamespace(hypothesis=SimpleNamespace(id="x", effects=()))
    pair = next_drive._Pair(side, side, np.array([[5.0] * 4, [4.0] * 4]))
    for again, expected in ((True, loads), (False, sweep)):
        found, _ = next_drive._best(pair, [sweep, loads], np.array([again, False]), pair.worst)
        assert found.manoeuvre == expected.text


def test_of_drives_of_the_same_power_one_that_more_often_leaves_a_single_effect_comes_first():
    known = manoeuvres.library(AT, 60.0)[:3]
    side = SimpleNamespace(hypothesis=SimpleNamespace(id="x", effects=()))
    pair = next_drive._Pair(side, side, np.full((3, 4), 5.0))
    for best, alone in ((1, [0.3, 0.6, 0.5]), (0, [0.58, 0.6, 0.5])):
        found, share = next_drive._best(pair, known, np.zeros(3, dtype=bool), np.array(alone))
        assert (found.manoeuvre, share) == (known[best].text, alone[best])


def test_where_no_drive_tells_a_check_counts_as_much_as_its_sensor_is_likely():
    loss = np.linspace(1.0, 2.0, 12)
    refits = [SimpleNamespace(loss=loss + more) for more in (0.0, 0.0, 0.5)]
    likely = next_drive._likely(refits)
    np.testing.assert_allclose(likely, [0.5, 0.5, 0.0], atol=1e-6)
    side = SimpleNamespace(hypothesis=SimpleNamespace(id="x", effects=(catalogue()["load-bias"],)))
    pair = next_drive._Pair(side, side, np.zeros((1, 4)))
    known, again = manoeuvres.library(AT, 60.0)[:1], np.zeros(1, dtype=bool)
    found, share = next_drive._best(pair, known, again, np.array([0.9]), likely[1])
    assert found.settings == {}
    assert found.check == "calibrate the load cell with known weights"
    assert share == likely[1]


def test_the_first_drive_for_a_large_family_tells_its_members_from_one_another_too():
    first = suggest(*case("large"))[0].settings
    # The best pair alone would be content with one of these: then another two stay as alike as they were.
    assert reach(first, "motor_temperature") == (30.0, 70.0)
    assert reach(first, "load") == (0.1, 1.4)


@pytest.mark.parametrize(("there", "least", "most"), [(0.0, 0.0, 0.4), (0.5, 0.5, 0.9), (1.0, 1.0, 1.0)])
def test_an_effect_is_bent_as_far_as_the_data_allow(there, least, most):
    data, pairs = joined_after("warm")
    truth, other = (refit_ranking._design(data, refit, one) for one, refit in pairs)
    form = refit_ranking.FORMS[1]
    residuals = [
        residual + there * part.bend(form)
        for part, residual in zip(truth, pairs[0][1].residuals, strict=True)
    ]
    allowed = refit_ranking._allowed(other, truth, form, residuals)
    assert least <= allowed <= most


def test_each_of_the_others_gets_a_drive():
    data, pairs = case("three")
    found = suggest(data, pairs)
    assert {one.pair for one in found} == {(pairs[0][0].id, other.id) for other, _ in pairs[1:]}
    assert len(found) == len(pairs) - 1
    assert [one.pair for one in suggest(data, pairs[:2])] == [(pairs[0][0].id, pairs[1][0].id)]
    assert suggest(data, pairs[:1]) == []


def power(name, manoeuvre, seconds):
    """Return the power of one manoeuvre of a length."""
    data, pairs = case(name)
    ground = next_drive.PowerLog(data, 0, pairs[0][1])
    sides = [next_drive.Side(ground, one, refit.solutions[0]) for one, refit in pairs]
    at = manoeuvres.Conditions.of(data.data[0])
    table = next_drive.margins(ground, sides, manoeuvres.library(at, seconds)[manoeuvre].drive(at))
    margins = np.concatenate([table[0, 1], table[1, 0]])[None]
    return next_drive._Pair(*sides, margins).power[0]


@pytest.mark.parametrize(
    ("margins", "expected"),
    [
        # The one has to be 2.05 deviations ahead of the other, which is then at 0; the other just ahead.
        ((3.0, 0.0), 0.5 * (0.8278 + 0.5)),
        # The other one would be taken for the first by no more than −2 + 2.05.
        ((2.0, 2.0), 0.9743),
        ((9.0, 9.0), diagnosis_criteria.MOST_POWER),
    ],
)
def test_a_drive_settles_what_it_rules_out(margins, expected):
    pair = next_drive._Pair(None, None, np.array([margins]))
    assert pair.power == pytest.approx([expected], abs=2e-3)


def test_one_form_that_is_not_ruled_out_leaves_a_pair_open():
    margins = np.array([[4.0, 4.0, 4.0, 4.0, 4.0, -2.0]])
    assert next_drive._Pair(None, None, margins).power < 0.75


@pytest.mark.parametrize(("name", "manoeuvre"), [("warm", 0), ("load", 2)])
def test_the_longer_it_is_driven_the_surer(name, manoeuvre):
    powers = [power(name, manoeuvre, seconds) for seconds in (6.0, 24.0, 96.0)]
    assert all(longer > shorter for shorter, longer in pairwise([diagnosis_criteria.RULED_OUT, *powers]))
    assert powers[2] > powers[0] + 0.05
    assert power(name, manoeuvre, 960.0) <= diagnosis_criteria.MOST_POWER


def test_noise_that_lasts_makes_it_less_sure():
    data, pairs = case("lasting")
    lasting, white = (
        next_drive.PowerLog(data, 0, pairs[0][1]),
        next_drive.PowerLog(case("warm")[0], 0, case("warm")[1][0][1]),
    )
    assert lasting.inflation > 1.8 * white.inflation
    assert power("lasting", 0, 24.0) < power("warm", 0, 24.0)


@lru_cache
def joined_after(name):
    """Fit to the log and what the first drive that is recommended adds."""
    kind = poor(CASES[name][0])
    further = appended(SEED + 1000, kind, SEED, suggest(*case(name))[0].settings)
    return fitted([windows(kind), *further], CASES[name][1])


def test_the_drive_settles_it():
    _, pairs = case("warm")
    _, after = joined_after("warm")
    assert after[0][0].id == "motor-temperature"
    before, now = (
        {one.id: float(refit.loss.sum()) for one, refit in some}["coulomb"] - float(some[0][1].loss.sum())
        for some in (pairs, after)
    )
    assert now > 10.0 * abs(before)


AT = manoeuvres.Conditions(
    load=LOAD,
    speed=SPEED,
    slip=0.3,
    sinkage=0.01,
    others={"motor_temperature": 30.0, "pitch": 0.1},
    radius=0.125,
)


def test_a_heavy_wheel_is_told_its_loads_in_plain_numbers():
    texts = [one.text for one in manoeuvres.library(replace(AT, load=1210.0), 60.0)]
    assert not any("e+" in text for text in texts)
    assert any("until 121 N are left on it" in text for text in texts)


@pytest.mark.parametrize("one", manoeuvres.library(AT, 60.0), ids=lambda one: one.text[:30])
def test_every_manoeuvre_can_be_simulated_and_is_what_is_forecast(one):
    scenario = simulation.read(None, {"part": [one.part], "load": LOAD, "speed": SPEED, "rate": 10.0})
    table = simulation.table(simulation.simulate(scenario))
    course = one.drive(AT)
    rows = np.round(course["time"] * 10.0).astype(int)
    for name in ("load", "velocity", "angular_velocity", "motor_temperature", "pass_number", "slip_angle"):
        np.testing.assert_allclose(course[name], np.asarray(table[name])[rows], rtol=1e-6, atol=1e-9)
    assert scenario.duration == 60.0


def test_a_drive_needs_what_varies_in_it():
    warm = next(one for one in manoeuvres.library(AT, 60.0) if "motor_temperature" in one.varies)
    assert warm.possible({"slip", "load", "motor_temperature"})
    assert not warm.possible({"slip", "load", "velocity"})
    lag = next(one for one in manoeuvres.library(AT, 60.0) if "rates" in one.varies)
    assert lag.possible({"torque", "time"})
    assert not lag.possible({"torque"})
    way = next(one for one in manoeuvres.library(AT, 60.0) if one.varies == {"rates", "speed"})
    assert way.possible({"velocity", "time"})
    assert not way.possible({"torque", "time"})


@pytest.mark.parametrize(
    ("doubts", "left"),
    [
        (("", "", "at its bound"), "ab"),
        # What keeps the only one from being the name is what a drive has to rule out.
        (("", "at its bound", "physically impossible"), "abc"),
        (("at its bound",) * 3, "abc"),
    ],
)
def test_a_drive_tells_causes_apart_or_the_only_one_from_what_is_not_believed(doubts, left):
    decision = Decision(verdict="family", family=tuple("abc"))
    members = [(SimpleNamespace(id=name), None) for name in "abc"]
    listed = [
        SimpleNamespace(effect=name, doubt=doubt, explained=0.9, in_family=True)
        for name, doubt in zip("abc", doubts, strict=True)
    ]
    assert "".join(one.id for one, _ in steps.rivals(decision, members, listed)) == left
