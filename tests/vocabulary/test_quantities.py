"""Names, units and numbers as a person reads them."""

from __future__ import annotations

import math

import pytest

from terrain_cli.vocabulary import quantities


@pytest.mark.parametrize(
    ("name", "unit", "label"),
    [
        ("torque", "N m", "torque T (N m)"),
        ("drawbar_pull", "N", "drawbar pull DP (N)"),
        ("sinkage", "m", "sinkage z (mm)"),
        ("slip", "1", "slip i"),
        ("x", "m", "x (m)"),
        ("yaw_rate", "rad/s", "yaw rate (°/s)"),
        ("bus_voltage", "", "bus_voltage"),
    ],
)
def test_label(name, unit, label):
    assert quantities.quantity(name, unit).label == label


def test_factor_goes_with_the_unit():
    assert 0.012 * quantities.quantity("sinkage", "m").factor == pytest.approx(12.0)
    assert math.pi * quantities.quantity("pitch", "rad").factor == pytest.approx(180.0)


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.05194, "0.0519"), (-1.834, "-1.83"), (12345.0, "12345"), (0.0, "0"), (math.nan, "–"), (1e9, "1e+09")],
)
def test_number(value, text):
    assert quantities.number(value) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"), [(-1234.5, 3, "-1230"), (3.2e-5, 2, "0.000032"), (211979.0, 2, "210000")]
)
def test_no_exponent_where_the_size_is_common(value, digits, text):
    assert quantities.short(value, digits) == text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (30.1234, 0.4567, "30.12 ± 0.46"),
        (-0.7, 6.4, "-0.7 ± 6.4"),
        (1234.5, 120.0, "1234 ± 120"),
        (5.0, math.nan, "5"),
        (5.0, math.inf, "5"),
        (math.nan, 1.0, "–"),
    ],
)
def test_plus_minus(value, error, text):
    assert quantities.plus_minus(value, error) == text
