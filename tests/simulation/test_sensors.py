"""Noise as it was asked for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from profiles import examples

from terrain_cli.errors import ConfigurationError
from terrain_cli.simulation.sensors import (
    USUAL,
    Sensor,
    SensorAmount,
    amount_rule,
    clock,
    sensors_rule,
    share_rule,
    ten_digits,
)

N = 20_000
TIME = clock(50.0, N / 50.0)
TRUE = 2.0 + np.sin(0.05 * TIME)
FEW = examples(15)


def error(sensor, seed=0, true=TRUE):
    return sensor.error(TIME, true, TIME[-1], seed, "left torque")


def autocorrelation(values, lag):
    return np.corrcoef(values[lag:], values[:-lag])[0, 1]


@FEW
@given(st.floats(0.001, 0.5), st.integers(0, 2**31))
def test_white(share, seed):
    noise = error(Sensor(white=SensorAmount(share=share)), seed) / (share * TRUE)
    assert np.std(noise) == pytest.approx(1.0, rel=4.0 / math.sqrt(2 * N))
    assert abs(np.mean(noise)) < 5.0 / math.sqrt(N)
    assert abs(autocorrelation(noise, 1)) < 5.0 / math.sqrt(N)


@FEW
@given(st.floats(0.1, 2.0), st.integers(0, 2**31))
def test_correlated(correlation_time, seed):
    noise = error(Sensor(correlated=SensorAmount(absolute=0.3), correlation_time=correlation_time), seed)
    # As many independent samples as there are correlation times.
    wide = 5.0 / math.sqrt(TIME[-1] / (2.0 * correlation_time))
    assert np.std(noise) == pytest.approx(0.3, rel=wide)
    lag = max(1, round(50.0 * correlation_time))
    assert autocorrelation(noise, lag) == pytest.approx(math.exp(-lag / 50.0 / correlation_time), abs=wide)


@FEW
@given(st.floats(0.01, 0.6), st.sampled_from([0.0, 0.02, 0.5]), st.integers(0, 2**31))
def test_dropouts(share, length, seed):
    lost = np.isnan(error(Sensor(dropouts=share, dropout_length=length), seed))
    each = max(length * 50.0, 1.0)
    assert np.mean(lost) == pytest.approx(share, abs=6.0 * math.sqrt(2.0 * share * each / N))
    if length == 0.5:
        runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], lost, [0]]))))[::2]
        assert np.mean(runs) == pytest.approx(25.0, rel=6.0 / math.sqrt(len(runs)))


@FEW
@given(st.floats(0.01, 0.5), st.integers(0, 2**31))
def test_outliers(share, seed):
    off = error(Sensor(outliers=share, outlier_size=SensorAmount(absolute=7.0)), seed)
    assert np.mean(off != 0.0) == pytest.approx(share, abs=5.0 * math.sqrt(share / N))
    assert set(np.abs(off[off != 0.0])) == {7.0}
    assert abs(np.mean(np.sign(off[off != 0.0]))) < 6.0 / math.sqrt(share * N)


def test_drift_ends_at_its_amount():
    drift = error(Sensor(drift=SensorAmount(absolute=0.5)))
    np.testing.assert_allclose(drift, 0.5 * TIME / TIME[-1])


def test_perfect_sensor():
    assert not error(Sensor()).any()
    np.testing.assert_allclose(Sensor().rounded(TRUE), TRUE, rtol=1e-10)


@pytest.mark.parametrize("quantum", [0.1, 0.008, 2.0, 1e-5])
def test_quantum(quantum):
    values = Sensor(quantum=quantum).rounded(TRUE)
    assert np.max(np.abs(values - TRUE)) <= quantum / 2.0 * (1.0 + 1e-9)
    steps = values / quantum
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)


@given(st.lists(st.floats(-1e200, 1e200).filter(lambda x: x == 0.0 or abs(x) > 1e-200), min_size=1))
def test_ten_digits(values):
    np.testing.assert_allclose(ten_digits(np.array(values)), values, rtol=1e-9)


def test_ten_digits_hide_the_last_bit():
    values = np.linspace(0.1, 9.0, 1000)
    np.testing.assert_array_equal(ten_digits(values), ten_digits(np.nextafter(values, 0.0)))
    assert np.isnan(ten_digits(np.array([np.nan])))[0]


@pytest.mark.parametrize("rate", [0.5, 3.0, 20.0, 100.0])
def test_clock(rate):
    times = clock(rate, 10.0)
    assert len(times) == 10.0 * rate
    np.testing.assert_allclose(np.diff(times), 1.0 / rate, atol=1.1e-6)


@pytest.mark.parametrize(
    ("channel", "text", "amount"),
    [
        ("torque", 0.02, SensorAmount(absolute=0.02)),
        ("torque", "0.02", SensorAmount(absolute=0.02)),
        ("torque", "20 mN m", SensorAmount(absolute=0.02)),
        ("sinkage", "1mm", SensorAmount(absolute=1e-3)),
        ("sinkage", "3%", SensorAmount(share=0.03)),
        ("motor_temperature", "2 K", SensorAmount(absolute=2.0)),
        ("slip", 0.01, SensorAmount(absolute=0.01)),
    ],
)
def test_amounts(channel, text, amount):
    read = amount_rule(channel)(text, "f")
    assert (read.share, read.absolute) == pytest.approx((amount.share, amount.absolute))


@pytest.mark.parametrize("text", ["3 kg", "x", "-1", "1e999", -0.5, True, float("nan"), "1..2 mm"])
def test_wrong_amounts(text):
    with pytest.raises(ConfigurationError, match="f: "):
        amount_rule("sinkage")(text, "f")


@pytest.mark.parametrize("text", ["110%", 1.0, "3 mm", "-1%"])
def test_wrong_shares(text):
    with pytest.raises(ConfigurationError, match="f: "):
        share_rule(text, "f")


def test_noise_of_all_and_of_one():
    assert set(sensors_rule("3%", "f")) == set(USUAL)
    sensors = sensors_rule(
        {"load": "1 N", "torque": {"white": "2%", "dropouts": "5%", "quantum": "1 mN m"}}, "f"
    )
    assert sensors["load"].white == SensorAmount(absolute=1.0)
    assert sensors["torque"].describe() == {
        "white": {"share": 0.02, "absolute": 0.0},
        "dropouts": 0.05,
        "quantum": 0.001,
    }
    with pytest.raises(ConfigurationError, match="did you mean torque"):
        sensors_rule({"torqe": 0.1}, "f")
    with pytest.raises(ConfigurationError, match="a step is no share"):
        sensors_rule({"torque": {"quantum": "1%"}}, "f")
