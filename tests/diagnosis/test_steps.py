"""The parts of a diagnosis, each against what it has to be by other means."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import Kind, samples_of, sized, windows_of

from formats import Labels
from terrain_cli import effects
from terrain_cli.comparison import smoothed_fit, smoothed_model, whitening
from terrain_cli.comparison.fitted_wheel import FittedWheel
from terrain_cli.diagnosis import (
    diagnose,
    diagnosed_log,
    drafted_laws,
    refits,
    screening,
    signatures,
    steps,
)
from terrain_cli.diagnosis.diagnosis_outcome import Hypothesis
from terrain_cli.effects.laws import effect_file
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.improvement.change_trial import tried
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile, added
from terrain_cli.presentation import change_text
from terrain_cli.vocabulary.channels import CHANNELS
from terrain_cli.windows import joined_inputs
from terrain_cli.windows.cut_windows import cut

NOTHING = FitSettings({}, {}, (), None)


@pytest.fixture(scope="module")
def wheel():
    some = joined_inputs.by_wheel(windows_of(3, Kind(seconds=40.0), "none"))
    return FittedWheel(some[0], Model(), NOTHING)


def test_inputs_of_a_wheel_are_joined_with_soils_and_runs_of_their_own():
    first, second = (cut(samples_of(seed, Kind(seconds=16.0)), "none") for seed in (1, 2))
    (joined,) = joined_inputs.by_wheel([first, second], effects.catalogue().values())
    n = len(first.rows)
    assert len(joined) == len(first) + len(second)
    assert joined.samples.labels["run"].names == ("input 1", "input 2")
    assert np.all(np.diff(joined.samples.time) > 0.0)
    np.testing.assert_array_equal(joined.samples.channels["torque"][n:], second.samples.channels["torque"])
    assert joined.samples.stretch[n] > joined.samples.stretch[n - 1]
    assert np.isfinite(joined.samples.drivers["angular_velocity_rate"]).all()


@pytest.mark.parametrize(
    ("name", "parameter", "size"), [("sensor-lag", "torque_lag", 0.2), ("acceleration-torque", "J", 0.5)]
)
def test_what_the_models_own_effects_need_is_computed_too(name, parameter, size):
    """In a loop the windows were read for the model as it was at first."""
    model = Model(effects=(effects.catalogue()[name],))
    case = diagnosed_log.Case(file=ModelFile(model=model), effects=[], seed=0, progress=lambda _: None)
    log = diagnosed_log.soils(case, windows_of(5, Kind(sized(name), seconds=16.0), "none"))
    (solution,) = log.data.base
    found = solution.of_samples(np.zeros(1, dtype=np.intp))[f"{name}.{parameter}"]
    assert found == pytest.approx(size, rel=0.5)


def test_different_wheels_stay_apart():
    first, second = (samples_of(seed, Kind(seconds=16.0)) for seed in (1, 2))
    second.wheel = "rear"
    assert len(joined_inputs.by_wheel([cut(first, "none"), cut(second, "none")])) == 2


def test_whitened_noise_has_variance_one_and_nothing_in_common():
    rng = np.random.default_rng(0)
    covariance = np.array([[4.0, 1.2, 0.0], [1.2, 1.0, -0.1], [0.0, -0.1, 0.25]])
    errors = rng.multivariate_normal(np.zeros(3), covariance, 20_000)
    white = whitening.Whitening(("torque", "drawbar_pull", "sinkage"), covariance)
    known = np.ones((20_000, 3), dtype=bool)
    known[:5000, 1] = False
    found = white(dict(zip(white.channels, errors.T, strict=True)), known)
    np.testing.assert_allclose(np.cov(found[5000:].T), np.eye(3), atol=0.04)
    assert not found[:5000, 1].any()
    np.testing.assert_allclose(np.cov(found[:5000][:, [0, 2]].T), np.eye(2), atol=0.06)


def test_whitening_can_be_undone():
    rng = np.random.default_rng(3)
    white = whitening.Whitening(("torque", "sinkage"), np.array([[2.0, 0.7], [0.7, 1.0]]))
    known = rng.random((40, 2)) < 0.8
    errors = dict(zip(white.channels, np.where(known, rng.normal(size=(40, 2)), 0.0).T, strict=True))
    found = white.undone(white(errors, known), known)
    for name, column in errors.items():
        np.testing.assert_allclose(found[name], column, atol=1e-12)


@pytest.mark.parametrize("columns", [(), (4,)])
def test_complete_samples_are_whitened_as_they_are_among_others(columns):
    rng = np.random.default_rng(4)
    white = whitening.Whitening(("torque", "sinkage"), np.array([[2.0, 0.7], [0.7, 1.0]]))
    errors = {name: rng.normal(size=(40, *columns)) for name in white.channels}
    known = np.ones((40, 2), dtype=bool)
    alone = white(errors, known)
    known[-1, 0] = False
    np.testing.assert_array_equal(alone[:-1], white(errors, known)[:-1])


def test_a_pull_that_changes_with_the_soil_does_not_explain_itself():
    """Load-transfer reads the measured pull: fed back, it explained soil that varies as no chance would."""
    found = diagnose(windows_of(3_000_063, Kind(course="poor", noise="soil")), ModelFile())
    assert not found.alarm.raised


@pytest.mark.parametrize(("torque", "named"), [(0.4, "drivetrain-friction"), (-0.4, None)])
def test_friction_that_drives_the_wheel_is_not_named(torque, named):
    """A torque that is too low throughout looks like friction below nought: something else is at work."""
    hidden = {"drivetrain-friction": {"Tc": torque}}
    wheels = windows_of(21, Kind(hidden, seconds=32.0))
    found = diagnose(wheels, ModelFile())
    assert found.alarm.raised
    assert found.effect == named
    step = tried(
        wheels,
        "add",
        ["drivetrain-friction"],
        ModelFile(),
        added(ModelFile(), ["drivetrain-friction"], 0.01).file,
        first=found.comparison,
    )
    assert step.better
    assert step.pays == (named is not None)
    assert ("physically impossible" in change_text.verdict(step)) == (named is None)


def test_what_cannot_be_is_never_first_however_plain(monkeypatch):
    rng = np.random.default_rng(3)

    def fitted(name, loss, free):
        noise = rng.normal(0.0, 1e-3, 20)
        at_bound = lambda _one, shape: shape and name == "stuck"  # noqa: E731
        return SimpleNamespace(id=name, free=free), SimpleNamespace(loss=loss + noise, at_bound=at_bound)

    base = fitted("", 9.0, 0)[1]
    several = [
        fitted("best", 1.0, 2),
        fitted("driving", 1.0, 1),
        fitted("plain", 1.0, 1),
        fitted("stuck", 1.0, 0),
        fitted("idle", 9.0, 1),
    ]
    # Of those that predict alike, a thousandth is chance.
    monkeypatch.setattr(
        steps.refit_ranking, "as_good", lambda one, other: one.loss.sum() < other.loss.sum() + 1.0
    )
    monkeypatch.setattr(
        steps.refit_ranking,
        "doubt",
        lambda _data, one, _refit: "physically impossible" * (one.id == "driving"),
    )
    ordered = [one.id for one, _ in steps._in_order(None, base, several)]
    assert ordered == ["plain", "best", "stuck", "driving", "idle"]
    # One that is all there is comes first, wherever its shape is.
    assert [one.id for one, _ in steps._in_order(None, base, [several[3], several[4]])] == ["stuck", "idle"]
    assert [one.id for one, _ in steps._in_order(None, base, several[1:2])] == ["driving"]
    assert steps._in_order(None, base, []) == []


def test_an_effect_that_the_soil_takes_nearly_whole_is_tried_where_it_stands_out_all_the_same():
    """Free angles of the largest stress leave a thousandth of a bias of the sinkage: enough."""
    hidden = {**sized("max-stress-angle"), **sized("sinkage-bias")}
    base = ModelFile(model=Model(effects=(effects.catalogue()["max-stress-angle"],)))
    found = diagnose(windows_of(3_000_202, Kind(hidden, seconds=48.0)), base)
    assert found.alarm.raised
    assert found.family[0] == "sinkage-bias"


def test_scores_are_those_of_a_least_squares_fit():
    rng = np.random.default_rng(1)
    n, soil, columns = 400, rng.normal(size=(400, 2, 3)), rng.normal(size=(400, 2, 4))
    window, block = np.repeat([0, 1], 200), np.repeat(np.arange(20), 20)
    residual = rng.normal(size=(n, 2))
    found, left = signatures.scores(residual, soil, columns, window, block, 20)
    change, covariance, explained = found.fit(np.array([1, 3]))
    wide = np.zeros((n, 2, 8))
    wide[:200, :, :3], wide[200:, :, 3:6], wide[:, :, 6:] = soil[:200], soil[200:], columns[:, :, [1, 3]]
    flat = wide.reshape(-1, 8)
    solution, *_ = np.linalg.lstsq(flat, residual.ravel(), rcond=None)
    np.testing.assert_allclose(change, solution[6:], rtol=1e-9)
    np.testing.assert_allclose(covariance, np.linalg.inv(flat.T @ flat)[6:, 6:], rtol=1e-9)
    without, *_ = np.linalg.lstsq(flat[:, :6], residual.ravel(), rcond=None)
    rest = [np.sum((residual.ravel() - flat[:, :k] @ s) ** 2) for k, s in ((6, without), (8, solution))]
    assert explained == pytest.approx(rest[0] - rest[1], rel=1e-9)
    assert left.shape == columns.shape


def test_one_step_from_a_sinkage_gives_the_derivatives_of_the_root(wheel):
    data = wheel.least_squares_data()
    names = ("tan_phi", "stiffness", "shear_modulus")
    numbers = wheel.of_samples()
    exact, _ = smoothed_model.forecast(wheel.model, data, numbers, order=smoothed_model.ORDER)
    found, tables, sinkage = smoothed_model.nearby(wheel.model, data, numbers, names, exact["sinkage"])
    np.testing.assert_allclose(sinkage, exact["sinkage"], rtol=1e-6)
    for column, name in enumerate(names):
        step = 1e-5 * numbers[name]
        sides = [
            smoothed_model.forecast(
                wheel.model, data, {**numbers, name: numbers[name] + sign * step}, order=smoothed_model.ORDER
            )[0]
            for sign in (1.0, -1.0)
        ]
        for channel in ("torque", "drawbar_pull", "sinkage"):
            np.testing.assert_allclose(found[channel], exact[channel], rtol=1e-6, atol=1e-9)
            slope = (sides[0][channel] - sides[1][channel]) / (2.0 * step)
            size = float(np.abs(slope).max())
            np.testing.assert_allclose(tables[channel][:, column], slope, atol=2e-3 * size)


def test_what_a_model_leaves_counts_as_noise_but_makes_no_channel_better(wheel):
    data = wheel.least_squares_data()
    seen = data.seen.all(axis=1)
    rng = np.random.default_rng(1)
    left = rng.normal(size=(len(seen), 3)) * [1.5, 0.5, 1.0]
    weighed = smoothed_model.with_noise_of(data, left, 30)
    unit = {name: np.ones(len(seen)) for name in data.white.channels}
    # What was 1.5 in the first channel is 1 now; the second, half as noisy as was thought, stays.
    before, after = (one.white(unit, data.seen)[seen][0] for one in (data, weighed))
    assert after[0] / before[0] == pytest.approx(1.0 / 1.5, rel=0.1)
    root = np.linalg.cholesky(data.white.covariance)
    inner = np.linalg.solve(root, np.linalg.solve(root, weighed.white.covariance).T)
    assert np.sqrt(np.diag(inner)) == pytest.approx([1.5, 1.0, 1.0], rel=0.1)
    assert np.linalg.eigvalsh(inner).min() >= 1.0 - 1e-9
    # A residual without end weighs as one of `BEND` deviations.
    wild = smoothed_model.with_noise_of(data, np.where(np.arange(3) == 0, 1e6, left), 30)
    assert np.sqrt(wild.white.covariance[0, 0] / data.white.covariance[0, 0]) <= smoothed_model.BEND * 1.001
    assert smoothed_model.with_noise_of(data, left, int(seen.sum()) + 1) is data


def test_a_fit_to_quiet_channels_ends_at_a_minimum(wheel):
    data = wheel.least_squares_data()
    solution = smoothed_fit.solve(wheel.model, wheel.sought, data, *wheel.beginning())
    again = smoothed_fit.solve(wheel.model, wheel.sought, data, solution.t, solution.common)
    assert again.merit == pytest.approx(solution.merit, rel=1e-4)
    for column in range(solution.t.shape[1]):
        for sign in (-0.05, 0.05):
            moved = solution.t.copy()
            moved[:, column] += sign
            found, _ = smoothed_model.forecast(
                wheel.model,
                data,
                smoothed_model.parameters(wheel.sought, moved[data.window], solution.common, data.window),
                order=smoothed_model.ORDER,
            )
            cost = smoothed_model.bounded(
                smoothed_model.residual(data, found)
            ).sum() + solution.spread * np.sum(moved**2)
            least = smoothed_model.bounded(solution.residual).sum() + solution.spread * np.sum(solution.t**2)
            assert cost > least * (1.0 - 1e-4)


def test_held_out_loss_falls_with_the_right_effect_only():
    kind = Kind(sized("slope"), seconds=64.0)
    (some,) = joined_inputs.by_wheel(windows_of(5, kind, "none"), effects.catalogue().values())
    further = [name for effect in effects.catalogue().values() for name in effect.reads]
    base = FittedWheel(some, Model(), NOTHING, further=further)
    block = np.arange(len(base)) * 16 // len(base)
    data = refits.ground([base], [block], 1500)
    loss = {"": float(refits.refit(data, None).loss.sum())}
    for name in ("slope", "gear-efficiency"):
        effect = effects.find(name)
        one = Hypothesis(id=name, title=effect.title, model=Model("wong-reece", (effect,)), effects=(effect,))
        loss[name] = float(refits.refit(data, one).loss.sum())
    count = int(data.data[0].seen.sum())
    assert loss["slope"] < 1.3 * count < 2.0 * count < loss["gear-efficiency"]
    assert loss["gear-efficiency"] > 0.9 * loss[""]


#: What was measured of the wheel, or is measured in place of it, drives nothing.
DRIVERS = (CHANNELS.keys() - {"torque", "drawbar_pull", "entry_angle", "motor_current"}) | {"wheel_angle"}


def _drafted() -> list[tuple[str, str]]:
    """Return what a draft can change with every driver that it may follow: any number but itself."""
    numbers = [name for name in sorted(DRIVERS) if name not in CHANNELS or CHANNELS[name].unit is not None]
    drivers = [*numbers, "temperature_of_the_third_bearing_on_the_left", "Belt tension [N]"]
    changed = [*drafted_laws.SHOWN, *drafted_laws.IN_THE_GROUND]
    return [(one, driver) for one in changed for driver in drivers if driver != one]


@pytest.mark.parametrize(("changes", "driver"), _drafted())
def test_a_draft_is_written_whatever_its_driver_is_called(changes, driver):
    written = [
        drafted_laws.write(changes, driver, form, np.linspace(20.0, 70.0, 99), usual=0.3)
        for form in drafted_laws.FORMS[1:-1]
    ]
    assert [draft.form for draft in written if draft] == list(drafted_laws.FORMS[1:-1])
    assert len({draft.effect.id for draft in written}) == len(written)


def test_where_the_soil_changes_passes_cannot_be_told():
    """Soils of 8 s each follow the passes a little, by chance."""
    found = diagnose(windows_of(4, Kind(noise="soil-unlabelled", seconds=48.0)), ModelFile())
    assert found.verdict == "none"
    (passes,) = [one for one in found.not_testable if one.effect == "multi-pass"]
    assert "the soil changes along this drive" in passes.because


@pytest.mark.parametrize("form", drafted_laws.FORMS)
@pytest.mark.parametrize("changes", ["torque", "drawbar_pull", "sinkage", "tan_phi"])
def test_every_draft_is_an_effect_that_a_user_can_add(form, changes, tmp_path):
    column = np.linspace(-0.2, 0.3, 100)
    driver, unit = {"constant": ("", ""), "periodic": ("wheel_angle", "rad"), "linear": ("hitch", "rad")}.get(
        form, ("yaw_rate", "rad/s")
    )
    draft = drafted_laws.write(changes, driver, form, column, unit, usual=0.3)
    if changes == "tan_phi" and form in {"constant", "periodic"}:
        return
    assert draft is not None
    file = tmp_path / "draft.toml"
    file.write_text(draft.text, encoding="utf-8")
    effect = effect_file.load(file)
    assert effect.id == draft.effect.id
    assert changes in effect.laws
    assert "empirical" in effect.reference


def test_a_table_of_three_points_says_that_it_is_too_short():
    samples = samples_of(2, Kind(seconds=16.0))
    few = np.arange(3)
    samples.channels = {name: column[few] for name, column in samples.channels.items()}
    samples.time, samples.stretch, samples.distance = None, np.arange(3), None
    samples.set_aside = Labels(np.full(3, -1, dtype=np.int32), ())
    found = diagnose([cut(samples, "none")], ModelFile(model=Model()))
    assert found.verdict == "none"
    assert any("independent stretches" in warning for warning in found.warnings)


def test_a_law_may_be_as_large_as_what_was_measured_makes_it_likely():
    assert drafted_laws.usual("torque", np.array([1.0, -1.0, np.nan])) == pytest.approx(0.3)
    assert drafted_laws.usual("torque", np.full(9, -60.0)) == pytest.approx(6.0)
    assert drafted_laws.usual("drawbar_pull", np.empty(0)) == pytest.approx(3.0)
    assert drafted_laws.usual("tan_phi", np.empty(0)) == pytest.approx(0.2)


def test_a_line_along_what_is_never_near_zero_has_room_for_its_offset():
    """2.5 N m/V about 24 V: the bus of a large rover varies by 3 V, which is 7.5 N m, and 60 N m off."""
    volts = np.linspace(21.0, 27.0, 99)
    draft = drafted_laws.write("torque", "bus", "linear", volts, "V", usual=6.0)
    scale = {p.name: p.scale for p in draft.effect.parameters}
    assert scale["a"] == pytest.approx(2.0, rel=0.1)
    assert scale["b"] > 40.0
    # And a driver that varies about 0 needs none.
    draft = drafted_laws.write("torque", "bus", "linear", volts - 24.0, "V", usual=6.0)
    assert {p.name: p.scale for p in draft.effect.parameters}["b"] == pytest.approx(6.0, rel=0.1)


def test_a_shape_that_stuck_at_its_end_is_let_go():
    wheels, every = windows_of(2, Kind(seconds=48.0)), [effects.catalogue()["crust"]]
    fitted = [FittedWheel(one, Model(), NOTHING) for one in wheels]
    data = refits.ground(fitted, [np.arange(len(one)) // 120 for one in fitted], 1_000)
    (crust,), _ = screening.hypotheses(ModelFile(model=Model()), fitted, every)
    free = refits.refit(data, crust)
    (solution,) = free.solutions
    names = [unknown.name for unknown in solution.unknowns.shared]
    at = names.index("crust.thickness")
    common = solution.common.copy()
    common[at] = solution.unknowns.shared[at].lower
    # As bad as a fit that ended elsewhere.
    stuck = replace(free, solutions=[replace(solution, common=common, residual=solution.residual + 2.0)])
    better = refits.over_shapes(data, crust, stuck)
    assert better is not stuck
    assert better.solutions[0].merit < stuck.solutions[0].merit
    # One that did not run to its end is left as it is.
    common = solution.common.copy()
    common[at] = 0.0
    inside = replace(free, solutions=[replace(solution, common=common)])
    assert refits.over_shapes(data, crust, inside) is inside


def test_a_cohesion_below_nought_is_told_with_what_it_may_mean():
    """A motor that helps the wheel looks like soil that pushes it."""
    every = list(effects.catalogue().values())

    def told(hidden, *known):
        file = ModelFile(model=Model(effects=tuple(map(effects.find, known))))
        case = diagnosed_log.Case(file=file, effects=every, seed=0, progress=lambda _: None)
        found = diagnosed_log.soils(case, windows_of(21, hidden)).comparison
        return [one for one in found.warnings if "physically impossible" in one]

    helps = Kind({"drivetrain-friction": {"Tc": -1.5}}, seconds=40.0)
    (warning,) = told(helps)
    assert warning.startswith(
        "wong-reece gives a cohesion of -9 kPa in 1 of 1 soil, which is physically impossible: "
        "an effect is missing"
    )
    assert "measured wrongly" in warning
    (warning,) = told(helps, "acceleration-torque")
    assert warning.startswith("wong-reece + acceleration-torque gives a cohesion of -9.5 kPa in 1 of 1 soil")
    assert "an effect is wrong or missing" in warning
    assert told(Kind(seconds=40.0)) == []
