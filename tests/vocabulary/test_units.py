from __future__ import annotations

import math

import numpy as np
import pytest

from terrain_cli.vocabulary import units

EVERY_UNIT = [(dimension, symbol) for dimension in units.POWERS for symbol in units.symbols(dimension)]


@pytest.mark.parametrize(("dimension", "symbol"), EVERY_UNIT)
def test_a_symbol_names_its_unit_with_and_without_the_dimension(dimension, symbol):
    unit = units.parse(symbol, dimension)
    assert (unit.symbol, unit.dimension) == (symbol, dimension)
    if dimension != "coordinate" and symbol != "g":
        assert units.parse(symbol) == unit


@pytest.mark.parametrize(
    ("text", "dimension", "value", "expected"),
    [
        ("mm", "length", 25.4, 0.0254),
        ("in", "length", 1.0, 0.0254),
        ("um", "length", 5.0, 5e-6),
        ("deg", "angle", 180.0, math.pi),
        ("kN", "force", 0.0814, 81.4),
        ("lbf", "force", 1.0, 4.4482216152605),
        ("kgf", "force", 1.0, 9.80665),
        ("mN m", "torque", 1500.0, 1.5),
        ("N cm", "torque", 150.0, 1.5),
        ("lbf ft", "torque", 1.0, 1.3558179483314004),
        ("rpm", "angular speed", 60.0, math.tau),
        ("rev/s", "angular speed", 2.0, 2.0 * math.tau),
        ("deg/s", "angular speed", 90.0, math.pi / 2.0),
        ("km/h", "speed", 36.0, 10.0),
        ("g", "acceleration", 2.0, 19.6133),
        ("g", "mass", 250.0, 0.25),
        ("mA", "current", 350.0, 0.35),
        ("K", "temperature", 293.15, 20.0),
        ("°C", "temperature", 20.0, 20.0),
        ("ns", "time", 1.5e9, 1.5),
        ("h", "time", 0.5, 1800.0),
        ("kPa", "pressure", 0.8, 800.0),
        ("%", "ratio", 30.0, 0.3),
        ("rad", "coordinate", math.pi, 180.0),
    ],
)
def test_values_become_the_programs(text, dimension, value, expected):
    unit = units.parse(text, dimension)
    assert unit.to_si(value) == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(unit.to_si(np.array([value, value])), [expected, expected], rtol=1e-12)


@pytest.mark.parametrize(
    ("symbol", "spellings"),
    [
        ("N m", "Nm|N·m|N*m|N-m|N.m|N_m|N × m"),
        ("mN m", "mNm|mN·m|mN_m"),
        ("m/s", "m / s|m s-1|m s^-1|m s⁻¹|m·s⁻¹|m_s|m_per_s|m per s|mps"),
        ("m/s²", "m/s2|m/s^2|m/s**2|m s⁻²|m_s2|m_s_2|m_per_s2|m/s/s"),
        ("mm/s", "mm_s|mm s-1"),
        ("rad/s", "rad_s|rad·s⁻¹|rads|rad_per_s"),
        ("deg/s", "°/s|dps|deg_s"),
        ("°C", "degC|deg_C|ºC|℃|C"),
        ("µm", "um|μm"),
        ("deg", "°|degrees"),
        ("%", "percent|pct"),
        ("1", "-|ratio"),
    ],
)
def test_one_unit_has_many_spellings(symbol, spellings):
    for text in spellings.split("|"):
        found = units.parse(text)
        assert found is not None, text
        assert found.symbol == symbol, text


@pytest.mark.parametrize(
    ("text", "dimension", "symbol"),
    [
        ("nm", "torque", "N m"),
        ("NM", "torque", "N m"),
        ("mnm", "torque", "mN m"),
        ("n", "force", "N"),
        ("KN", "force", "kN"),
        ("kpa", "pressure", "kPa"),
        ("RPM", "angular speed", "rpm"),
        ("c", "temperature", "°C"),
        ("k", "temperature", "K"),
        ("a", "current", "A"),
    ],
)
def test_case_does_not_count_where_the_dimension_leaves_one_reading(text, dimension, symbol):
    assert units.parse(text, dimension).symbol == symbol


@pytest.mark.parametrize(
    ("text", "dimension"),
    [
        ("nm", None),  # nobody said it is a torque
        ("nm", "length"),
        ("MN m", "torque"),
        ("MN", "force"),
        ("MM", "length"),
        ("g", None),
        ("mm", "torque"),
        ("Hz", "angular speed"),
        ("1/s", "angular speed"),
        ("grad", "angle"),
        ("ms", "speed"),
        ("k_m", None),
        ("furlong", "length"),
        ("", None),
        ("", "length"),
    ],
)
def test_what_could_mean_something_else_is_no_unit(text, dimension):
    assert units.parse(text, dimension) is None


def test_the_programs_own_unit_changes_nothing():
    for dimension in units.POWERS:
        own = units.si(dimension)
        assert own.symbol == units.symbols(dimension)[0]
        assert own.to_si(0.1) == 0.1
