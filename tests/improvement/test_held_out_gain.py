"""What held-out errors prove, on errors that were drawn: chance rarely passes, what is plain always."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from terrain_cli import models
from terrain_cli.comparison.blocks import Interval
from terrain_cli.comparison.comparison_outcome import UNITS, Series
from terrain_cli.comparison.kept_aside import TooShort
from terrain_cli.improvement import model_history
from terrain_cli.improvement.held_out_gain import weigh
from terrain_cli.improvement.improvement_outcome import Estimated, HeldOutEvidence, Step
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.presentation.change_text import proof, verdict

N, BLOCKS = 400, 20
BLOCK = np.repeat(np.arange(BLOCKS), N // BLOCKS)


def outcome(errors, blocks=BLOCK, noise=1.0, base="wong-reece", aside=None, remarks=()):
    """Return a comparison as far as it is weighed: held-out errors by channel, of one wheel."""
    series = {
        name: Series(error, np.zeros(len(error)), np.zeros(len(error))) for name, error in errors.items()
    }
    channels = {
        name: SimpleNamespace(
            unit=UNITS[name], noise=noise, heldout_rmse=1.0, heldout_low=0.9, heldout_high=1.1
        )
        for name in errors
    }
    windows = SimpleNamespace(
        samples=SimpleNamespace(aside=aside, remarks=list(remarks)), rows=np.arange(len(blocks))
    )
    wheel = SimpleNamespace(series=series, blocks=blocks, model=Model(base), windows=windows)
    return SimpleNamespace(channels=channels, wheels=[wheel])


def drawn(rng, sizes, memory=0.0):
    """Draw errors; a share `memory` of their variance is the same throughout a block."""
    own, common = rng.normal(size=N), rng.normal(size=BLOCKS)[BLOCK]
    error = np.sqrt(1.0 - memory) * own + np.sqrt(memory) * common
    return {name: size * error for name, size in zip(UNITS, sizes, strict=True)}


def step(first, second, action="add"):
    channels, evidence = weigh(first, second)
    return Step(
        action=action,
        changed=("x",),
        before=models.build("wong-reece"),
        after=models.build("wong-reece"),
        first=first,
        second=second,
        compared_before=first,
        compared_after=second,
        channels=channels,
        evidence=evidence,
    )


def test_ratio_is_the_mean_of_logarithms_over_all_samples():
    rng = np.random.default_rng(1)
    errors = drawn(rng, (1.0, 5.0, 1e-3))
    factors = dict(zip(UNITS, (0.5, 1.0, 0.9), strict=True))
    channels, evidence = weigh(
        outcome(errors), outcome({name: errors[name] * factors[name] for name in errors})
    )
    # Samples count alike in all three.
    assert evidence.overall.value == pytest.approx((0.5 * 1.0 * 0.9) ** (1.0 / 3.0))
    # Every block says the same: nothing is left to chance.
    assert evidence.overall.high == pytest.approx(evidence.overall.value)
    for one in channels:
        assert one.after.value == pytest.approx(factors[one.name] * one.before.value)
        assert one.before.value == pytest.approx(np.sqrt(np.mean(errors[one.name] ** 2)))
    assert evidence.blocks == BLOCKS


def test_only_stretches_kept_aside_count():
    """What is better only where a diagnosis has seen it does not pay, and nothing is lost there."""
    rng = np.random.default_rng(9)
    aside = np.arange(N) % 100 >= 60
    errors = drawn(rng, (1.0, 5.0, 1e-3))
    better = {name: np.where(aside, 0.8, 0.1) * error for name, error in errors.items()}
    better["torque"][~aside] = np.nan
    channels, evidence = weigh(outcome(errors, aside=aside), outcome(better, aside=aside))
    assert evidence.overall.value == pytest.approx(0.8)
    assert (evidence.blocks, evidence.lost) == (8, 0.0)
    assert (evidence.aside, evidence.too_short) == (160, False)
    for one in channels:
        assert one.before.value == pytest.approx(np.sqrt(np.mean(errors[one.name][aside] ** 2)))
    named = {name: np.where(aside, 1.0, 0.1) * error for name, error in errors.items()}
    assert step(outcome(errors), outcome(named)).pays
    judged = step(outcome(errors, aside=aside), outcome(named, aside=aside))
    assert (judged.pays, judged.proof) == (False, "stretches kept aside")
    assert "(on the stretches kept aside, in no channel was the change significant" in verdict(judged)


def test_where_nothing_can_be_kept_aside_the_proof_says_so():
    rng = np.random.default_rng(10)
    errors = drawn(rng, (1.0, 5.0, 1e-3))
    short = [TooShort("too short to keep stretches aside")]
    one, same = (step(outcome(errors, remarks=some), outcome(errors, remarks=some)) for some in (short, ()))
    assert (one.proof, same.proof) == ("same data", "same data")
    assert proof(one) == "proof: on data that may have chosen the effect: too short to keep any aside"
    assert proof(same).endswith("; for a stricter proof give --confirm LOG or --keep-aside SHARE")
    assert model_history.same_stretches(same) == "no others were kept aside"
    # Nothing names what is taken out.
    assert model_history.same_stretches(replace(one, action="remove")) == ""


def test_interval_is_that_of_the_t_test_where_that_is_exact():
    """Of two models with errors of one size, the log ratio's interval is nearly that of block means."""
    from scipy.stats import ttest_1samp

    rng = np.random.default_rng(2)
    a, b = 1.0 + 0.01 * rng.normal(size=(2, N))
    _, evidence = weigh(outcome({"torque": a}), outcome({"torque": b}))
    means = (np.log(b) - np.log(a)).reshape(BLOCKS, -1).mean(axis=1)
    low, high = ttest_1samp(means, 0.0).confidence_interval(0.95)
    assert np.log(evidence.overall.low) == pytest.approx(low, rel=0.05)
    assert np.log(evidence.overall.high) == pytest.approx(high, rel=0.05)


@pytest.mark.parametrize("memory", [0.0, 0.5])
@pytest.mark.parametrize("blocks", [4, 20])
def test_chance_rarely_pays(memory, blocks):
    """A model as bad as the other, with errors of its own, pays in few of 400 cases."""
    rng = np.random.default_rng(3)
    block = BLOCK * blocks // BLOCKS
    pays = 0
    for _ in range(400):
        a, b = drawn(rng, (1.0, 5.0, 1e-3), memory), drawn(rng, (1.0, 5.0, 1e-3), memory)
        pays += step(outcome(a, block), outcome(b, block)).pays
    # One side of 95 % and its binomial error; the three channels are alike here.
    assert pays / 400 < 0.025 + 2.0 * np.sqrt(0.025 / 400)


def test_a_fifth_less_is_seen_in_one_channel_of_three():
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(50):
        a = drawn(rng, (1.0, 5.0, 1e-3))
        b = {name: error + 0.02 * np.std(error) * rng.normal(size=N) for name, error in a.items()}
        found += step(outcome(a), outcome({**b, "torque": 0.8 * b["torque"]})).pays
    assert found == 50


def test_a_way_back_costs_what_the_way_there_paid():
    rng = np.random.default_rng(5)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    b = {name: error * rng.uniform(0.6, 0.9, N) for name, error in a.items()}
    there, back = step(outcome(a), outcome(b)), step(outcome(b), outcome(a), "remove")
    assert (there.pays, there.costs) == (True, False)
    assert (back.pays, back.costs) == (False, True)


def test_an_effect_stays_without_which_one_error_rises_and_none_falls():
    """However open another channel is over all: a few blocks had most of what it gained there."""
    rng = np.random.default_rng(21)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    wild = np.where(np.arange(N) < N // 20, 3.0, 0.97)
    b = {**a, "drawbar_pull": 1.06 * a["drawbar_pull"], "torque": wild * a["torque"]}
    found = step(outcome(a), outcome(b), "remove")
    low, high = found.evidence.overall[1:]
    assert low < 1.0 < high
    assert [one.name for one in found.rose] == ["drawbar_pull"]
    assert not found.fell
    assert found.costs
    # Nor is one taken out that may have taken a part off all of them.
    open_ = step(outcome(a), outcome({**a, "torque": wild * a["torque"]}), "remove")
    assert open_.evidence.overall.value > 1.02
    assert not open_.rose
    assert open_.costs
    assert "the held-out error rose over all channels, × 1.0" in verdict(open_)


def test_what_rises_much_outweighs_what_falls():
    rng = np.random.default_rng(6)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    b = {"torque": 0.75 * a["torque"], "drawbar_pull": 1.1 * a["drawbar_pull"], "sinkage": a["sinkage"]}
    assert not step(outcome(a), outcome(b)).pays
    # By little in any case; or by a part of what is won elsewhere.
    assert step(outcome(a), outcome({**b, "drawbar_pull": 1.03 * a["drawbar_pull"]})).pays
    assert step(outcome(a), outcome({**b, "torque": 0.3 * a["torque"]})).pays


def test_a_rise_to_the_noise_does_not_count():
    """A wrong soil may pass less of the noise on to a channel than the right one does."""
    rng = np.random.default_rng(6)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    b = {"torque": 0.75 * a["torque"], "drawbar_pull": 1.1 * a["drawbar_pull"], "sinkage": a["sinkage"]}
    above, at = (outcome(b, noise=noise) for noise in (5.0, 5.5))
    assert not step(outcome(a), above).pays
    assert step(outcome(a), at).pays
    assert not step(above, outcome(a), "remove").costs
    assert step(at, outcome(a), "remove").costs


def test_less_than_a_fiftieth_does_not_count():
    rng = np.random.default_rng(7)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    assert not step(outcome(a), outcome({name: 0.985 * error for name, error in a.items()})).pays
    assert step(outcome(a), outcome({name: 0.97 * error for name, error in a.items()})).pays


def test_an_effect_that_may_be_absent_does_not_count():
    """Neither when it is added nor when it is removed; unless what it does is plain."""
    rng = np.random.default_rng(12)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    plain = {name: 0.8 * error for name, error in a.items()}
    assert replace(step(outcome(a), outcome(plain)), absent=0.05).pays
    assert replace(step(outcome(plain), outcome(a), "remove"), absent=0.05).costs
    # What the data leave open has moved the soil, and that is what is plain.
    one = Estimated(source="log", wheel="wheel", name="x.a", unit="1", value=0.2, se=2.0, determined=False)
    left_open = replace(step(outcome(a), outcome(plain)), absent=0.05, parameters=[one])
    assert not left_open.pays
    assert replace(left_open, absent=0.001).pays
    assert replace(left_open, parameters=[replace(one, determined=True)]).pays
    b = {name: 0.95 * error for name, error in a.items()}
    there, back = step(outcome(a), outcome(b)), step(outcome(b), outcome(a), "remove")
    assert replace(there, absent=0.001).pays
    assert not replace(there, absent=0.05).pays
    assert replace(back, absent=0.001).costs
    assert not replace(back, absent=0.05).costs
    assert ", but its parameters do not differ significantly from their null values (p 0.05)" in verdict(
        replace(there, absent=0.05)
    )
    worse = step(outcome(b), outcome(a))
    assert ", and its parameters do not differ significantly from their null values (p 0.05)" in verdict(
        replace(worse, absent=0.05)
    )


def test_a_sentence_turns_once():
    """What fell, what rose, and why it is refused: one "but" among them."""
    rng = np.random.default_rng(13)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    moved = step(outcome(a), outcome({**a, "torque": 0.5 * a["torque"], "sinkage": 1.5 * a["sinkage"]}))
    pushes = Estimated(source="log", wheel="wheel", name="x.a", unit="1", value=-1.0, se=0.1, determined=True)
    told = verdict(replace(moved, imitates=[pushes]))
    assert told.count(" but ") == 1
    assert "mm, and rose in sinkage" in told or "N m, and rose in sinkage" in told
    assert told.endswith(
        "but only with x.a = -1 ± 0.1, which is physically impossible; another effect is missing"
    )


def test_samples_without_a_prediction_are_no_gain():
    rng = np.random.default_rng(8)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    b = {name: np.where(np.abs(error) > np.std(error), np.nan, error) for name, error in a.items()}
    found = step(outcome(a), outcome(b))
    assert found.evidence.lost == pytest.approx(0.32, abs=0.05)
    assert not found.pays
    assert found.costs


def test_two_blocks_prove_nothing_and_one_has_no_interval():
    rng = np.random.default_rng(9)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    b = {name: 0.1 * error for name, error in a.items()}
    assert not step(outcome(a, BLOCK // 10), outcome(b, BLOCK // 10)).pays
    whole = np.zeros(N, dtype=int)
    _, evidence = weigh(outcome(a, whole), outcome(b, whole))
    assert evidence.blocks == 1
    assert np.isnan(evidence.overall.high)
    assert evidence.overall.value == pytest.approx(0.1)


def test_a_channel_that_only_one_predicts_has_no_difference():
    rng = np.random.default_rng(10)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    fewer = {name: a[name] for name in ("torque", "drawbar_pull")}
    channels, _ = weigh(outcome(fewer), outcome(a))
    sinkage = channels[-1]
    assert sinkage.name == "sinkage"
    assert np.isnan(sinkage.before.value)
    assert sinkage.after == Interval(1.0, 0.9, 1.1)
    assert not sinkage.fell
    assert not sinkage.rose
    _, nothing = weigh(outcome({"torque": a["torque"]}), outcome({"sinkage": a["sinkage"]}))
    assert isinstance(nothing, HeldOutEvidence)
    assert nothing.blocks == 0


def test_noise_is_that_of_the_better_model():
    rng = np.random.default_rng(11)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    b = {name: 0.5 * error for name, error in a.items()}
    for first, second in ((outcome(a, noise=3.0), outcome(b)), (outcome(b), outcome(a, noise=3.0))):
        assert {one.noise for one in weigh(first, second)[0]} == {1.0}


def test_noise_of_the_model_after_is_told_on_blocks_of_its_own():
    """On the long blocks of a model that misses, what the better one leaves passes for noise."""
    rng = np.random.default_rng(13)
    a = drawn(rng, (1.0, 5.0, 1e-3))
    b = {name: 0.5 * error for name, error in a.items()}
    channels, _ = weigh(outcome(a, noise=3.0), outcome(b), outcome(b, noise=0.5))
    assert {one.noise for one in channels} == {0.5}


def test_another_base_is_counted_with_the_noise_of_the_first():
    """A misfit of 1 beside noise of 2 is taken away, and noise of 3 comes with the other base."""
    rng = np.random.default_rng(12)
    first = outcome({"torque": np.sqrt(5.0) * rng.normal(size=N)}, noise=2.0, base="linear")
    second = outcome({"torque": 3.0 * rng.normal(size=N)}, noise=3.0)
    ((change,), evidence) = weigh(first, second)
    assert change.after.value == pytest.approx(2.0, abs=0.35)
    assert (change.noise, evidence.overall.value < 1.0) == (2.0, True)
    ((raw,), _) = weigh(outcome({"torque": first.wheels[0].series["torque"].measured}), second)
    assert raw.after.value == pytest.approx(3.0, rel=0.1)


def test_noise_that_a_better_soil_passes_on_is_no_loss():
    """A hard layer answers to the noise of the sinkage: torque scatters more in places, all by noise."""
    rng = np.random.default_rng(14)
    before = drawn(rng, (1.0, 5.0, 1e-3))
    after = {**before, "sinkage": 0.85 * before["sinkage"]}
    after["torque"] = before["torque"] * np.exp(0.05 + 0.3 * rng.normal(size=BLOCKS))[BLOCK]
    noise = float(np.sqrt(np.mean(after["torque"] ** 2)))
    assert noise > 1.1 * np.sqrt(np.mean(before["torque"] ** 2))
    assert not step(outcome(before), outcome(after, noise=1.0)).better
    found = step(outcome(before), outcome(after, noise=noise))
    assert found.better
    assert found.evidence.overall.value == pytest.approx(0.85 ** (1 / 3))
