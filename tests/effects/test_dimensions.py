"""Units of parameters, and what the terms of a law measure."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.effects.laws import dimensions, grammar
from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.effect import QUANTITIES
from terrain_cli.vocabulary import units
from terrain_cli.vocabulary.channels import CHANNELS


@pytest.mark.parametrize(
    ("text", "factor", "same_as"),
    [
        ("", 1.0, "1"),
        ("1", 1.0, "rad"),
        ("-", 1.0, "1"),
        ("%", 0.01, "1"),
        ("deg", math.pi / 180.0, "1"),
        ("N s/rad", 1.0, "kg m/s"),
        ("N m", 1.0, "kg m²/s²"),
        ("Nm", 1.0, "N m"),
        ("N·m", 1.0, "N m"),
        ("N*m", 1.0, "N m"),
        ("N.m", 1.0, "J"),
        ("mN m", 1e-3, "N m"),
        ("kPa", 1e3, "N/m^2"),
        ("MPa", 1e6, "N m⁻²"),
        ("Pa/m^1.5", 1.0, "Pa m^-1.5"),
        ("Pa/m^(3/2)", 1.0, "Pa/m^1.5"),
        ("1/K", 1.0, "K^-1"),
        ("%/K", 0.01, "1/K"),
        ("1/°C", 1.0, "1/K"),
        ("rad/s", 1.0, "1/s"),
        ("rpm", math.tau / 60.0, "rev/min"),
        ("1/min", 1.0 / 60.0, "Hz"),
        ("mm", 1e-3, "m"),
        ("µm", 1e-6, "m"),
        ("cm^2", 1e-4, "m2"),
        ("N/(m/s)", 1.0, "N s/m"),
        ("km/h", 1.0 / 3.6, "m s⁻¹"),
        ("m/s/s", 1.0, "m/s²"),
        ("(N m)/A", 1.0, "V s"),
        ("W", 1.0, "N m/s"),
        ("kN/m3", 1e3, "N/m³"),
        ("Pa/m^n", 1.0, "Pa/m^n"),
        ("kPa/m^(n-1)", 1e3, "Pa m/m^n"),
        ("Pa/m^(n+1)", 1.0, "Pa/(m m^n)"),
    ],
)
def test_unit(text, factor, same_as):
    scale = dimensions.parse(text)
    assert scale.factor == pytest.approx(factor, rel=1e-14)
    assert scale.dimension == dimensions.parse(same_as).dimension


@pytest.mark.parametrize("dimension", [name for name in units.POWERS if name != "coordinate"])
def test_every_unit_of_a_channel_is_one(dimension):
    for symbol in units.symbols(dimension):
        if (dimension, symbol) in {("mass", "g"), ("acceleration", "g")}:
            continue
        scale = dimensions.parse(symbol)
        assert scale.factor == pytest.approx(units.parse(symbol, dimension).factor, rel=1e-12)
        assert scale.dimension == dimensions.parse(units.si(dimension).symbol).dimension


@pytest.mark.parametrize(
    "unit", [*QUANTITIES.values(), *(c.unit.symbol for c in CHANNELS.values() if c.unit)]
)
def test_common_units_are_called_by_their_name(unit):
    shown = str(dimensions.parse(unit).dimension)
    assert shown == "a plain number" or dimensions.parse(shown) == dimensions.Scale(
        1.0, dimensions.parse(unit).dimension
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("g", "'g' is not a known unit"),
        ("furlong", "'furlong' is not a known unit"),
        ("N foo", "is not a known unit: 'foo'"),
        ("N/m s", "can be read in two ways"),
        ("N/m·s", "can be read in two ways"),
        ("m//s", "from '/s' on"),
        ("/s", "from '/s' on"),
        ("2 m", "from '2 m' on"),
        ("m^99", "powers go up to 12"),
        ("m^9 m^9", "powers go up to 12"),
        ("m^9999999", "powers go up to 12"),
        ("ns^-12 s^12 ns^-12 s^12 ns^-12 s^12", "beyond all bounds"),
        ("mm^n", "only m can have the power n"),
        ("m^n^2", "from '^2' on"),
        ("(m", "never closed"),
        ("m)", "a ) too many"),
        ("m;import os", "is not a known unit"),
        ("м", "is not a known unit"),
        ("m" * 61, "longer than 60"),
        ("(" * 100_000, "longer than 60"),
    ],
)
def test_what_is_no_unit_is_refused(text, says):
    with pytest.raises(ConfigurationError) as error:
        dimensions.parse(text)
    assert says in str(error.value)
    assert len(str(error.value)) < 160
    assert error.value.hint


@given(st.text("mNskPa/^()n-+.12 ·*°%²⁻", max_size=20) | st.text(max_size=20))
def test_no_text_breaks_the_reader_of_units(text):
    try:
        scale = dimensions.parse(text)
    except ConfigurationError:
        return
    assert 0.0 < scale.factor < math.inf


KNOWN = {
    "F": "N",
    "T": "N m",
    "z": "m",
    "i": "1",
    "w": "rad/s",
    "keq": "Pa/m^n",
    "sinkage_exponent": "1",
    "p": "kPa",
    "k": "N s/rad",
}


def infer(law):
    known = {name: dimensions.parse(unit).dimension for name, unit in KNOWN.items()}
    return dimensions.Inference(law, known).of(grammar.parse(law))


@pytest.mark.parametrize(
    ("law", "unit"),
    [
        ("F - k * abs(w)", "N"),
        ("T + F * z", "N m"),
        ("T / z + F", "N"),
        ("F ^ 2 / F", "N"),
        ("sqrt(F * F) + F", "N"),
        ("sqrt(z)", "m^0.5"),
        ("z ^ -1.5", "1/m^1.5"),
        ("max(0, F, -F)", "N"),
        ("min(F, 0) + 0", "N"),
        ("where(w > 0 and i < 0.5, F, 0)", "N"),
        ("where(z > 0, 0, F)", "N"),
        ("0 * F + T", "N m"),
        ("sign(F) * T", "N m"),
        ("exp(-i) * log(F / F) + tanh(z / z)", "1"),
        ("(i + 0.5) ^ i", "1"),
        ("2 ^ (z / z)", "1"),
        ("F * (1 + 0.5 * i) ^ 2", "N"),
        ("keq * z ^ sinkage_exponent + p", "Pa"),
        ("keq * (1 + i)", "Pa/m^n"),
        ("pi * z", "m"),
    ],
)
def test_law_measures(law, unit):
    assert infer(law) == dimensions.parse(unit).dimension


def test_nothing_fits_anything():
    assert infer("0") is None
    assert infer("max(0, -0 * F)") is None


@pytest.mark.parametrize(
    ("law", "place", "says"),
    [
        ("F + T", "T", "adds T (N m) to F (N)"),
        ("F - k * z", "k * z", "subtracts k * z ("),
        ("F + 5", "5", "adds 5 (a plain number) to F (N)"),
        ("F * (i + z)", "z", "adds z (m) to i (a plain number)"),
        ("exp(F / z)", "F / z", "what exp takes must be a plain number, and F / z is in N/m"),
        ("sin(T)", "T", "what sin takes must be a plain number, and T is in N m"),
        ("2 ^ z", "z", "an exponent must be a plain number, and z is in m"),
        ("F ^ i", "i", "F is in N and has a power that is not a constant"),
        ("F ^ sinkage_exponent", "sinkage_exponent", "a power that is not a constant"),
        ("max(F, 1)", "1", "max of 1 (a plain number) and F (N)"),
        ("where(F > z, 1, 2)", "z", "compares z (m) with F (N)"),
        ("where(1 < F < 2, 1, 2)", "F", "compares F (N) with 1 (a plain number)"),
        ("where(i > 0, F, T)", "T", "gives T (N m) or F (N)"),
        ("where(i > 0 and F > T, 1, 2)", "T", "compares T (N m) with F (N)"),
        ("keq * z + p", "p", "adds p (Pa) to keq * z (Pa/m^(n-1))"),
    ],
)
def test_mismatch_is_refused_at_its_place(law, place, says):
    with pytest.raises(grammar.LawError) as error:
        infer(law)
    assert law[error.value.start : error.value.end] == place
    assert says in error.value.problem
