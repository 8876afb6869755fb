"""Findings on drives of the simulator: none on clean ones, the right ones on known misfits."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from known_misfits import MISFITS, Kind, compare, samples_of, windows_of

from formats import Labels
from terrain_cli import effects
from terrain_cli.comparison import against, comparison_criteria
from terrain_cli.comparison import compare as comparing
from terrain_cli.improvement.held_out_gain import weigh
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.windows.cut_windows import Windows, cut


def all_of(samples, bounds=None):
    n = len(samples)
    bounds, nothing = np.array(bounds or [0, n]), np.zeros(n)
    return Windows(samples=samples, rows=np.arange(n), bounds=bounds, x=nothing, y=nothing)


def some_of(samples, rows, **changed):
    """Return some of the samples, with some of what they are changed."""
    own = {
        "channels": {name: column[rows] for name, column in samples.channels.items()},
        "time": samples.time[rows],
        "stretch": samples.stretch[rows],
        "distance": samples.distance[rows],
        "set_aside": Labels(np.full(len(rows), -1, dtype=np.int32), ()),
    }
    return replace(samples, **{**own, **changed})


@pytest.fixture(scope="module")
def clean():
    return compare([windows_of(1, Kind())], Model())


@pytest.fixture(scope="module")
def biased():
    hidden, _ = MISFITS["torque bias 0.25 N m"]
    return compare([windows_of(1, Kind(hidden))], Model())


def test_a_clean_drive_has_no_findings_and_its_errors_are_the_noise(clean):
    assert clean.failures == []
    assert clean.warnings == []
    for errors in clean.channels.values():
        assert errors.noise == pytest.approx(errors.rmse, rel=0.06)
        assert errors.heldout_low < errors.heldout_rmse < errors.heldout_high
        assert errors.rmse <= errors.heldout_rmse < 1.02 * errors.rmse
        assert abs(errors.bias) < 0.1 * errors.rmse
    # 3 % of each channel, and what the noise of slip and sinkage makes of the torque.
    assert 0.03 < clean.channels["torque"].nrmse < 0.07
    assert clean.channels["sinkage"].unit == "m"


@pytest.mark.parametrize("kind", [Kind(memory=0.8), Kind(share=0.1), Kind(varies=True, runs=True)])
def test_neither_do_those_with_other_noise_or_soil_that_varies(kind):
    assert [compare([windows_of(seed, kind)], Model()).failures for seed in (1, 2)] == [[], []]


def test_how_much_of_a_finding_shows_in_the_residuals(biased):
    """Of a bias the fit leaves what is across all that the soil can do."""
    (bias,) = biased.failures
    (wheel,) = biased.wheels
    series = wheel.series["torque"]
    left = series.measured - series.predicted
    assert 0.1 < bias.seen < 0.8
    assert np.nanmean(left) == pytest.approx(bias.seen * bias.amplitude, rel=0.1)
    assert ("hides" in bias.sentence) == (bias.seen < comparison_criteria.HIDDEN)


@pytest.mark.parametrize("name", MISFITS)
def test_a_known_misfit_is_found_in_its_channel_with_its_driver(name):
    hidden, right = MISFITS[name]
    compared = compare([windows_of(2, Kind(hidden))], Model())
    found = compared.failures
    assert any({f.driver, *f.alternatives} & set(right.get(f.channel, ())) for f in found)
    assert not any(f.channel in (f.driver, *f.alternatives) for f in found)
    for offset in (f for f in found if f.shape == "constant" and "-predicted" in f.sentence):
        assert offset.amplitude * compared.channels[offset.channel].bias > 0.0


def test_a_misfit_is_told_from_noise(biased, clean):
    torque = biased.channels["torque"]
    assert torque.rmse > 1.3 * torque.noise
    # The noise of the sinkage reaches the torque through another soil.
    assert torque.noise == pytest.approx(clean.channels["torque"].noise, rel=0.3)


def test_a_finding_says_what_where_and_how_much(biased):
    (found,) = biased.failures
    assert (found.channel, found.driver, found.shape, found.unit) == ("torque", "", "constant", "N m")
    assert found.amplitude == pytest.approx(0.25, rel=0.1)
    assert found.p_value < 0.01
    assert 0.7 < found.share <= 1.0
    assert found.sentence == "the model predicts 0.25 N m too little torque throughout"
    assert found.worst_segments == (("drive 1", "wheel", 1),)


def test_what_each_segments_own_soil_hides_is_found_between_segments():
    hidden, _ = MISFITS["second pass 40 % stiffer"]
    found = compare([windows_of(1, Kind(hidden, runs=True))], Model()).failures
    assert ("sinkage", "pass_number") in [(f.channel, f.driver) for f in found]


def test_a_stretch_that_differs_is_found_where_it_lies():
    """A bearing that sticks for 20 s: its torque is larger by a share, whatever slip and load are."""
    samples = samples_of(1, Kind())
    sticks = (samples.time >= 40.0) & (samples.time < 60.0)
    torque = samples.channels["torque"] * np.where(sticks, 1.3, 1.0)
    found = compare([cut(replace(samples, channels=samples.channels | {"torque": torque}), "auto")], Model())
    first = found.failures[0]
    assert (first.channel, first.driver, first.shape) == ("torque", "time", "stretch")
    assert found.stretch == pytest.approx((40.0, 60.0), abs=1.0)
    assert first.amplitude > 0.0


def test_a_step_with_time_has_no_end():
    samples = samples_of(1, Kind())
    channels = {name: values for name, values in samples.channels.items() if name not in {"x", "y"}}
    channels["torque"] = channels["torque"] + np.where(samples.time >= 60.0, 0.6, 0.0)
    found = compare([cut(replace(samples, channels=channels), "none")], Model())
    first = found.failures[0]
    assert (first.channel, first.driver, first.shape) == ("torque", "time", "step")
    assert found.stretch == (pytest.approx(60.0, abs=6.0), np.inf)
    told = replace(first, alternatives=("motor_temperature",))
    assert replace(found, failures=[told]).stretch is None


def test_a_zero_that_jumps_is_told_at_the_time_at_which_it_does():
    """The steps tried of any number are tenths of it; where the drive was cut is known to the sample."""
    samples = samples_of(1, Kind())
    channels = {name: values for name, values in samples.channels.items() if name not in {"x", "y"}}
    jump = float(samples.time[np.searchsorted(samples.time, 0.55 * samples.time[-1])])
    channels["torque"] = channels["torque"] + np.where(samples.time >= jump, 0.6, 0.0)
    found = compare([cut(replace(samples, channels=channels), "auto")], Model())
    first = found.failures[0]
    assert (first.channel, first.driver, first.shape) == ("torque", "time", "step")
    assert first.at == pytest.approx(jump, abs=1.0)


def test_a_value_held_that_is_impossible_under_this_wheel_is_noted(clean):
    wheels, model = [one.windows for one in clean.wheels], Model(effects=(effects.find("load-bias"),))
    gain = {"load-bias.gain": 1.0}
    assert compare(wheels, model, fixed={**gain, "load-bias.offset": 5.0}).warnings == []
    said = compare(wheels, model, fixed={**gain, "load-bias.offset": 1500.0}).warnings[-1]
    beyond = "load-bias.offset is held at 1500 N; under such a wheel it is from -1000 to 1000 N"
    assert said == f"drive 1: the wheel: {beyond}"


def test_a_soil_below_nought_is_noted_where_there_are_blocks_enough():
    """Of a few seconds the errors of a fit tell too little."""
    values, errors = np.array([-5e3, -9e3]), np.array([1e3, 1e3])
    wheel = SimpleNamespace(
        model=Model(),
        fit=SimpleNamespace(values={"cohesion": values}, errors={"cohesion": errors}),
        window=np.repeat([0, 1], [80, 20]),
        windows=[0, 1],
        measured={"torque": np.zeros(100)},
    )
    ((value, note),) = comparing._impossible_soils([wheel], [np.arange(100) // 10])
    assert value == "a cohesion of -5 kPa"
    assert note.startswith("wong-reece gives a cohesion of -5 kPa in 1 of 2 soils")


def test_two_models_are_compared_on_the_same_blocks(clean):
    wheels = [one.windows for one in clean.wheels]
    held = compare(wheels, Model(), fixed={"shear_modulus": 0.1}, like=clean)
    assert np.array_equal(held.wheels[0].blocks, clean.wheels[0].blocks)
    differences = {(d.name, d.where): d for d in against(clean, held)}
    torque = differences["torque", None]
    assert torque.moved
    assert torque.low > 0.0
    assert torque.second == pytest.approx(held.channels["torque"].heldout_rmse)
    assert differences["c", ("drive 1", "wheel", 1)].unit == "Pa"
    assert not any(d.moved for d in against(clean, clean))


def test_an_error_has_one_interval_whichever_command_tells_it(biased, clean):
    """`compare` tells the errors of one model, `model add` those of two on the same blocks."""
    changes, _ = weigh(biased, biased)
    assert len(changes) == len(biased.channels) == 3
    for one in changes:
        errors = biased.channels[one.name]
        alone = (errors.heldout_rmse, errors.heldout_low, errors.heldout_high)
        assert one.before == pytest.approx(alone, rel=1e-9)
        assert 0.0 < errors.heldout_low < errors.heldout_rmse < errors.heldout_high


def test_whatever_is_measured_is_compared():
    samples = samples_of(1, Kind())
    rows = np.arange(1200)

    def without(*names):
        one = some_of(samples, rows)
        channels = {name: column for name, column in one.channels.items() if name not in names}
        return set(compare([all_of(replace(one, channels=channels))], Model()).channels)

    assert without() == {"torque", "drawbar_pull", "sinkage"}
    assert without("torque") == {"drawbar_pull", "sinkage"}
    assert without("load", "drawbar_pull") == {"torque"}
    assert without("sinkage") == {"torque", "drawbar_pull"}


def test_the_linear_base_predicts_no_sinkage():
    samples = samples_of(1, Kind())
    assert set(compare([all_of(samples)], Model("linear")).channels) == {"torque", "drawbar_pull"}


def test_a_handful_of_test_points_does_not_tell_its_noise():
    samples = some_of(samples_of(1, Kind()), np.arange(0, 2400, 500), time=None)
    compared = compare([all_of(samples)], Model())
    assert np.isnan(compared.channels["torque"].noise)
    assert sum("too few test points were repeated" in one for one in compared.warnings) == 3
    assert np.isfinite(compared.channels["torque"].heldout_high)


def test_a_few_samples_are_compared_but_prove_nothing():
    compared = compare([all_of(some_of(samples_of(1, Kind()), np.arange(30)))], Model())
    assert compared.failures == []
    assert "too few to tell where the model fails" in compared.warnings[0]
    assert np.isfinite(compared.channels["torque"].heldout_rmse)


def test_wheels_of_one_input_share_the_times_of_their_blocks():
    samples = samples_of(1, Kind())
    later = some_of(samples, np.arange(300, 2000), wheel="other")
    compared = compare([all_of(samples), all_of(later, [0, 700, 1700])], Model())
    first, second = (one.blocks for one in compared.wheels)
    assert np.array_equal(first[300:2000], second)
    assert compared.channels["torque"].n == len(first) + len(second)
    assert all(np.all(np.diff(one) >= 0) for one in (first, second))


def test_a_bias_of_one_wheel_is_found_with_its_name():
    samples = samples_of(1, Kind())
    wrong = {**samples.channels, "torque": samples.channels["torque"] + 0.3}
    wheels = [all_of(samples), all_of(replace(samples_of(4, Kind()), source=samples.source, wheel="second"))]
    wheels.append(all_of(replace(samples, wheel="third", channels=wrong)))
    found = compare(wheels, Model()).failures
    assert ("torque", "wheel") in [(f.channel, f.driver) for f in found]
    assert any("third" in f.sentence for f in found)


def test_progress_is_told():
    said = []
    compare([all_of(some_of(samples_of(1, Kind()), np.arange(400)))], Model(), progress=said.append)
    assert said[0] == "fitting the wheel"
    assert all(a != b for a, b in pairwise(said))


def test_a_further_column_is_a_driver():
    samples = samples_of(1, Kind())
    cable = np.abs(np.sin(samples.time / 3.0))
    pulled = {**samples.channels, "drawbar_pull": samples.channels["drawbar_pull"] - 2.0 * (cable > 0.8)}
    compared = compare([all_of(replace(samples, channels=pulled, drivers={"cable": cable}))], Model())
    (found,) = compared.failures
    assert (found.channel, found.driver, found.shape) == ("drawbar_pull", "cable", "step")
    assert found.at == pytest.approx(0.8, abs=0.08)
    assert found.amplitude == pytest.approx(-2.0, rel=0.15)
    assert "too much drawbar pull" in found.sentence


def test_one_soil_is_fitted_to_each_terrain_between_segments():
    samples = samples_of(1, Kind())
    n = len(samples)
    terrain = Labels((np.arange(n) // 640 % 2).astype(np.int32), ("sand", "gravel"))
    bounds = list(range(0, n + 1, 160))
    compared = compare([all_of(replace(samples, labels={"terrain": terrain}), bounds)], Model())
    assert compared.failures == []
    assert compared.wheels[0].drivers["terrain"].labels == ("sand", "gravel")


def test_a_soil_that_changes_once_in_a_drive_with_gaps_is_no_misfit():
    """The pieces of one soil are alike, and so is what rises along the drive, as a motor's temperature."""
    samples = samples_of(1, Kind(two=True))
    bounds = list(range(0, len(samples) + 1, len(samples) // 16))
    assert compare([all_of(samples, bounds)], Model()).failures == []


def test_a_finding_on_one_soil_for_all_segments_says_so():
    """The errors that are printed are those of the segments' own soils."""
    hidden, _ = MISFITS["second pass 40 % stiffer"]
    found = compare([windows_of(1, Kind(hidden, runs=True))], Model()).failures
    between = [one.sentence for one in found if one.driver == "pass_number"]
    assert between
    assert all(one.startswith("with one soil for all segments, the model ") for one in between)


def test_a_ripple_is_found_however_many_grousers_nobody_counted():
    samples = samples_of(3, Kind())
    angle = np.cumsum(samples.channels["angular_velocity"]) * np.median(np.diff(samples.time))
    torque = samples.channels["torque"] * (1.0 + 0.1 * np.sin(11.0 * angle))
    found = compare([all_of(replace(samples, channels={**samples.channels, "torque": torque}))], Model())
    (one,) = found.failures
    assert (one.channel, one.driver) == ("torque", "wheel_angle")
    assert one.sentence.endswith("11 times in a turn of the wheel")


def test_drivers_are_without_the_noise_that_is_in_the_predictions():
    samples = samples_of(1, Kind())
    (wheel,) = compare([all_of(samples)], Model()).wheels
    for channel, driver in (("torque", "sinkage"), ("sinkage", "load")):
        residual = wheel.series[channel].measured - wheel.series[channel].predicted
        columns = (samples.channels[driver], wheel.drivers[driver].values)
        measured, shown = (abs(np.corrcoef(residual, column)[0, 1]) for column in columns)
        assert shown < 0.1 * measured, (channel, driver)
        assert measured > 0.2, (channel, driver)


def test_a_ripple_that_is_found_is_no_noise():
    """It is over within seconds, as noise of sensors is; what is left beside it is the noise."""
    calm = compare([windows_of(3, Kind(), "none")], Model()).channels["torque"].noise
    ripple = Kind(effects={"grouser-ripple": {"torque_sine": 0.05}})
    found = compare([windows_of(3, ripple, "none")], Model())
    assert {one.driver for one in found.failures if one.channel == "torque"} == {"wheel_angle"}
    torque = found.channels["torque"]
    assert torque.noise == pytest.approx(calm, rel=0.1)
    assert torque.heldout_rmse > 2.0 * torque.noise
    assert found.wheels[0].errors["torque"].noise == torque.noise
