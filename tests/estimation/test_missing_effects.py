"""Effects that a model lacks: whether they show, how far they would move the soil, and what the rows say."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from simulator import CHANNELS, DRY_SAND, Drive, Sensor, Track, Wheel, base_contact, simulate, undulation

import terrain_cli as terrain
from terrain_cli.effects import find
from terrain_cli.estimation import estimators
from terrain_cli.estimation.further_unknowns import suspects
from terrain_cli.estimation.wheel_fit import Prior, fit, missing_effects
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

WHEEL = Wheel(0.125, 0.1)
ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
HIDDEN = {
    "load-bias": {"gain": 0.95, "offset": 8.0},
    "drawbar-bias": {"offset": 2.5},
    "drivetrain-friction": {"Tc": 0.5},
    "sinkage-bias": {"offset": 0.0025},
    "wheel-radius": {"relative_error": 0.05},
    "load-transfer": {"ratio": 0.3},
}
CONTACT = {"max-stress-angle": {"c1": 0.2, "c2": 0.32}}


@cache
def columns(hidden="", seed=3):
    """Return what a drive over one soil measures, with an effect that is not in the model."""
    effects = {**HIDDEN, **CONTACT, "little": {"relative_error": 0.01}}
    track = Track(
        "wheel",
        [(base_contact(DRY_SAND), 100.0)],
        undulation(60.0, 0.25, 7.0, seed),
        undulation(0.3, 0.8, 9.0, seed + 1),
    )
    noisy = dict.fromkeys(("load", "torque", "sinkage", "slip"), Sensor(relative=0.02))
    drive = Drive(
        [track],
        WHEEL,
        undulation(0.07, 0.2, 11.0, seed),
        effects={"wheel-radius" if hidden == "little" else hidden: effects[hidden]} if hidden else {},
        rate=10.0,
        sensors={**noisy, "drawbar_pull": Sensor(absolute=0.3)},
        channels=(*CHANNELS, "slip", "drawbar_pull"),
        seed=seed,
    )
    return simulate(drive).wheels["wheel"].aligned()


@pytest.fixture(scope="module")
def windows_of(tmp_path_factory):
    rover = tmp_path_factory.mktemp("rover") / "rover.toml"
    rover.write_text(ROVER)

    @cache
    def windows(hidden=""):
        import pandas as pd

        (samples,) = terrain.from_frame(pd.DataFrame(columns(hidden)), rover)
        return terrain.segment(samples, "none")

    return windows


def scored(monkeypatch, hidden, effects, windows=1, priors=None, **fixed):
    """Return scores by parameter, and how far each would move c and tan φ, with the fit they are about."""
    kept = {}

    def moved(problem, data, t, common, found, suspects):
        kept["scores"] = missing_effects.scores(problem, data, t, common, suspects)
        return np.zeros(len(t), dtype=bool), np.zeros((*t.shape, t.shape[1]))

    monkeypatch.setattr(missing_effects, "moved", moved)
    table = columns(hidden)
    n = len(table["time"])
    geometry = WheelGeometry(WHEEL.radius, WHEEL.width)
    bounds, suspects = np.linspace(0, n, windows + 1).astype(int), [find(one) for one in effects]
    found = fit(Model(), geometry, table, bounds, fixed=fixed, priors=priors, suspects=suspects)
    of = kept["scores"]
    moves = dict(zip(of.names, of.moves[0, :2].T, strict=True))
    return dict(zip(of.names, of.score, strict=True)), moves, found


def test_scores_are_small_where_nothing_is_missing(monkeypatch):
    score, _, _ = scored(monkeypatch, "", HIDDEN)
    assert max(map(abs, score.values())) < 3.5


def test_what_is_wrongly_known_of_one_soil_counts_once_in_all_its_windows(monkeypatch):
    """Else any effect would score that brings k nearer to what rover.toml says of it."""
    far = {"shear_modulus": Prior.factor(4.0 * DRY_SAND.shear_modulus, 1.6)}
    score, _, _ = scored(monkeypatch, "", HIDDEN, windows=20, priors=far)
    assert max(map(abs, score.values())) < 3.0


@pytest.mark.parametrize("effect", HIDDEN)
def test_an_effect_shows(monkeypatch, effect):
    score, _, _ = scored(monkeypatch, effect, HIDDEN)
    assert max(abs(score[name]) for name in score if name.startswith(effect)) > 5.0


def test_it_moves_the_soil_as_a_fit_with_the_effect_does(monkeypatch):
    _, moves, without = scored(monkeypatch, "little", ["wheel-radius"])
    table, geometry = columns("little"), WheelGeometry(WHEEL.radius, WHEEL.width)
    with_effect = fit(Model(effects=(find("wheel-radius"),)), geometry, table, [0, len(table["time"])])
    step = moves["wheel-radius.relative_error"]
    for place, name in enumerate(("cohesion", "tan_phi")):
        there = with_effect.values[name][0] - without.values[name][0]
        error = without.errors[name][0]
        assert abs(there) > 0.5 * error
        assert step[place] * without.priors[name][1] == pytest.approx(there, rel=0.25)


def test_what_reads_nothing_that_is_there_scores_nothing(monkeypatch):
    table = {name: column for name, column in columns().items() if name != "drawbar_pull"}
    monkeypatch.setattr(f"{__name__}.columns", lambda _: table)
    score, _, _ = scored(monkeypatch, "", ["drawbar-bias"])
    assert score == {"drawbar-bias.offset": 0.0}


@pytest.mark.parametrize("turning", [False, True])
def test_what_the_log_can_show_is_tested_but_no_other_law_of_the_soil(turning, windows_of):
    windows = windows_of()
    channels = windows.samples.channels
    if turning:
        channels = {**channels, "slip_angle": 0.0 * channels["load"]}
    samples = replace(windows.samples, channels=channels)
    tested = {effect.id for effect in suspects(estimators.full_model(), replace(windows, samples=samples))[0]}
    assert tested >= {"drivetrain-friction", "load-transfer", "slip-sinkage"}
    assert ("side-slip" in tested) == turning
    assert not tested & {"strength-curvature", "post-peak-softening", "hardpan", "rate-dependence"}


@pytest.mark.parametrize("effect", HIDDEN)
def test_rows_say_so(windows_of, effect):
    found = estimators.estimate(windows_of(effect), "auto", estimators.full_model())
    assert found.estimates.status[0] != "ok"


@pytest.mark.parametrize("effect", ["", *CONTACT])
def test_rows_that_a_model_fits_are_ok(windows_of, effect):
    found = estimators.estimate(windows_of(effect), "auto", estimators.full_model())
    assert found.estimates.status[0] == "ok"
    assert found.account["moved"] == 0


def test_the_summary_says_so(windows_of):
    found = estimators.estimate(windows_of("load-bias"), "auto", estimators.full_model())
    assert found.account["moved"] == 1
    assert found.estimates.status[0] == "model-misses"


def lasting(torque, time):
    """Return torque with noise that lasts for 0.5 s."""
    noise = 0.03 * torque.std() * np.random.default_rng(8).normal(size=len(time))
    for j in range(1, len(time)):
        noise[j] += 0.8 * noise[j - 1]
    return torque + noise


@pytest.mark.parametrize(
    ("change", "follows"),
    [
        (lambda torque, _: torque, False),
        (lasting, False),
        # Of another model than the program's lag: as it was 0.3 s before.
        (lambda torque, time: np.interp(time - 0.3, time, torque), True),
    ],
)
def test_what_is_left_follows_the_inputs_only_where_the_model_misses(change, follows):
    table = dict(columns())
    table["torque"] = change(table["torque"], table["time"])
    geometry, n = WheelGeometry(WHEEL.radius, WHEEL.width), len(table["time"])
    found = fit(Model(), geometry, table, [0, n // 2, n], suspects=[], second=10.0)
    assert found.follows.tolist() == [follows, follows]
    assert (found.status == "model-misses").tolist() == [follows, follows]
    # Steady test points have no past.
    assert not fit(Model(), geometry, table, [0, n], suspects=[], correlated=False).follows.any()


def drifted(share, seconds):
    """Return what adds a zero that comes and goes to a torque: a share of its size, in so many seconds."""
    return lambda torque, time: torque + share * torque.mean() * np.sin(np.pi * time / seconds)


@pytest.mark.parametrize(
    ("channel", "pull", "change", "wanders"),
    [
        ("torque", False, lasting, False),
        ("torque", True, lasting, False),
        ("torque", False, drifted(0.02, 40.0), True),
        ("torque", True, drifted(0.02, 20.0), True),
        ("sinkage", True, drifted(0.02, 20.0), True),
        ("load", False, drifted(0.02, 20.0), True),
        # It moves c, φ and strength by less than their errors.
        ("torque", True, drifted(0.003, 20.0), False),
    ],
)
def test_a_channel_that_wanders_is_missed_where_it_moves_the_soil(channel, pull, change, wanders):
    table = {name: column for name, column in columns(seed=5).items() if pull or name != "drawbar_pull"}
    table[channel] = change(table[channel], table["time"])
    geometry, n = WheelGeometry(WHEEL.radius, WHEEL.width), len(table["time"])
    found = fit(Model(), geometry, table, [0, n // 2, n], suspects=[], second=10.0)
    assert found.follows.any() == wanders
    assert (found.status == "model-misses").any() == wanders


@pytest.mark.parametrize(
    ("wild", "share"), [(("load", "torque", "sinkage", "slip"), 0.08), (("torque",), 0.15)]
)
@pytest.mark.parametrize(("drift", "status"), [(0.0, "ok"), (0.1, "model-misses")])
def test_wild_samples_are_no_misfit_of_a_robust_fit(wild, share, drift, status):
    table = {name: column for name, column in columns(seed=5).items() if name != "drawbar_pull"}
    table["torque"] = drifted(drift, 20.0)(table["torque"], table["time"])
    rng, n = np.random.default_rng(12), len(table["time"])
    for name in wild:
        chosen, way = rng.random(n) < share, rng.choice([-1.0, 1.0], size=n)
        table[name] = table[name] * (1.0 + np.where(chosen, 10.0 * 0.02 * way, 0.0))
    geometry = WheelGeometry(WHEEL.radius, WHEEL.width)
    found = fit(Model(), geometry, table, [0, n // 2, n], suspects=[], second=10.0, robust=True)
    assert found.status.tolist() == [status, status]


def covariance(found):
    """Return the covariance of c and tan φ of the first window."""
    pair = [found.names.index(name) for name in ("cohesion", "tan_phi")]
    return found.covariance[0][np.ix_(pair, pair)], found.assumed[0][np.ix_(pair, pair)]


def test_a_model_that_misses_a_share_of_the_torque_may_be_off_by_that_share():
    table = {name: column for name, column in columns().items() if name != "drawbar_pull"}
    time = table["time"]
    geometry, n = WheelGeometry(WHEEL.radius, WHEEL.width), len(time)
    noise = fit(Model(), geometry, table, [0, n])
    table["torque"] = table["torque"] * (1.0 + 0.1 * np.sin(2.0 * np.pi * time / 31.0))
    plain = fit(Model(), geometry, table, [0, n])
    told = fit(Model(), geometry, table, [0, n], suspects=[], joint=[0])
    assert told.missed[0]
    (before, _), (after, assumed) = covariance(plain), covariance(told)
    share = np.sqrt((told.torque_rmse**2 - noise.torque_rmse**2)[0] / np.mean(table["torque"] ** 2))
    assert share == pytest.approx(0.1 / np.sqrt(2.0), rel=0.3)
    # c and tan φ grow less sure alike, until the strength that is known best may be off by the share.
    stress = -before[0, 1] / before[1, 1]
    soil = np.array([told.values[name][0] for name in ("cohesion", "tan_phi")])
    strength, added = soil @ (1.0, stress), np.array([1.0, stress]) @ (after - before) @ (1.0, stress)
    assert added == pytest.approx((share * strength) ** 2, rel=0.1)
    np.testing.assert_allclose(after / before, (after / before)[0, 0], rtol=0.1)
    # It is the same in all windows: pooled, it does not average out.
    assert assumed[0, 0] >= 0.99 * (after - before)[0, 0]
    assert told.strength_se[0] > share * told.strength[0]
    # The joint posterior is as wide as the errors.
    density = np.exp(told.grids[0].log_density).sum(axis=1)
    density /= density.sum()
    tan_phi = told.grids[0].tan_phi
    deviation = np.sqrt(density @ tan_phi**2 - (density @ tan_phi) ** 2)
    assert deviation == pytest.approx(told.errors["tan_phi"][0], rel=0.05)


def test_a_model_that_fits_is_off_by_noise_alone():
    table, geometry = columns(), WheelGeometry(WHEEL.radius, WHEEL.width)
    one, other = (fit(Model(), geometry, table, [0, len(table["time"])], suspects=s) for s in (None, []))
    assert not other.missed[0]
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_errors_allow_for_a_friction_that_does_not_show():
    geometry, suspects = WheelGeometry(WHEEL.radius, WHEEL.width), [find("drivetrain-friction")]

    def fits(share):
        table = {name: column for name, column in columns().items() if name != "drawbar_pull"}
        table["torque"] = table["torque"] + share * table["torque"].mean()
        bounds = [0, len(table["time"])]
        return [fit(Model(), geometry, table, bounds, suspects=these) for these in ([], suspects)]

    (plain, clean), (without, found) = fits(0.0), fits(0.04)
    assert not found.moved[0]
    shift = without.values["cohesion"][0] - plain.values["cohesion"][0]
    assert shift > 2.5 * without.errors["cohesion"][0]
    assert shift < 1.96 * found.errors["cohesion"][0]
    # Where nothing speaks for it, hardly.
    assert 1.0 < clean.errors["cohesion"][0] / plain.errors["cohesion"][0] < 1.1
    # It is the same in all windows: pooled, it does not average out.
    (whole, assumed), (narrow, _) = covariance(found), covariance(without)
    assert assumed[0, 0] >= 0.99 * (whole - narrow)[0, 0]


@pytest.mark.parametrize(("share", "wider"), [(0.0, (1.0, 1.01)), (-0.008, (1.3, 2.5))])
def test_errors_allow_for_an_effect_as_far_as_the_data_speak_for_it(share, wider):
    table, geometry = dict(columns()), WheelGeometry(WHEEL.radius, WHEEL.width)
    table["slip"] = 1.0 - (1.0 - table["slip"]) / (1.0 + share)
    bounds = [0, len(table["time"])]
    plain, found = (
        fit(Model(), geometry, table, bounds, suspects=these) for these in ([], [find("wheel-radius")])
    )
    assert not found.moved[0]
    assert wider[0] <= found.strength_se[0] / plain.strength_se[0] < wider[1]


@pytest.mark.parametrize(("ends", "wider"), [((1e3, 1e3), (1.0, 1.02)), ((700.0, 1300.0), (1.2, 2.0))])
def test_errors_allow_for_soil_that_changes_little_by_little(ends, wider):
    pieces, length, seed = 40, 4.2, 3
    places = (np.arange(pieces) + 0.5) / pieces
    soils = [replace(DRY_SAND, cohesion=np.interp(at, (0.0, 1.0), ends)) for at in places]
    soils = [(base_contact(soil), length * (piece + 1) / pieces) for piece, soil in enumerate(soils)]
    track = Track("wheel", soils, undulation(60.0, 0.25, 7.0, seed), undulation(0.3, 0.8, 9.0, seed + 1))
    sensors = dict.fromkeys(("load", "torque", "sinkage", "slip"), Sensor(relative=0.02))
    drive = Drive(
        [track],
        WHEEL,
        undulation(0.07, 0.2, 11.0, seed),
        rate=10.0,
        sensors={**sensors, "drawbar_pull": Sensor(absolute=0.3)},
        channels=(*CHANNELS, "slip", "drawbar_pull"),
        seed=seed,
    )
    table = simulate(drive).wheels["wheel"].aligned()
    n = len(table["time"])
    given = Model(), WheelGeometry(WHEEL.radius, WHEEL.width), table, [0, n // 3, 2 * n // 3, n]
    plain, found = (fit(*given, suspects=suspects, second=10.0) for suspects in (None, []))
    assert wider[0] <= found.errors["tan_phi"][2] / plain.errors["tan_phi"][2] <= wider[1]
