from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from terrain_cli.errors import InputError
from terrain_cli.vocabulary.channels import CHANNELS, LABEL, Match, identify, resolve, stated_unit, unit_hint

CONTRACT = {
    "time": "s", "wheel": None, "load": "N", "torque": "N m", "sinkage": "m", "entry_angle": "rad",
    "angular_velocity": "rad/s", "velocity": "m/s", "slip": "1", "drawbar_pull": "N", "pitch": "rad",
    "roll": "rad", "yaw_rate": "rad/s", "motor_current": "A", "motor_temperature": "°C",
    "acceleration": "m/s²", "pass_number": "1", "slip_angle": "rad", "x": "m", "y": "m",
    "elevation": "m", "longitude": "deg", "latitude": "deg", "terrain": None, "run": None,
}  # fmt: skip


def read(header, **options):
    """Return (channel, symbol of the unit, stated) of a header, or None."""
    match = identify(header, **options)
    return match and (match.channel, match.unit and match.unit.symbol, match.stated)


def test_the_vocabulary_is_the_contracts():
    assert {name: c.unit and c.unit.symbol for name, c in CHANNELS.items()} == CONTRACT


@pytest.mark.parametrize("name", CONTRACT)
def test_a_channels_name_is_taken_as_it_is(name):
    assert identify(name) == Match(name, CHANNELS[name].unit, exact=True, stated=False)


def test_no_alias_belongs_to_two_channels():
    words = [word for c in CHANNELS.values() for word in {c.name, *c.aliases.split(), *c.letters}]
    assert len(words) == len(set(words))
    assert all(word == word.lower() for c in CHANNELS.values() for word in c.aliases.split())


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        ("sinkage_mm", ("sinkage", "mm", True)),
        ("torque [mN m]", ("torque", "mN m", True)),
        ("load (kN)", ("load", "kN", True)),
        ("Normal load [N]", ("load", "N", True)),
        ("vertical_load_n", ("load", "N", True)),
        ("Fz_load_N", ("load", "N", True)),
        ("meas_torque_nm", ("torque", "N m", True)),
        ("meas_drawbar_pull_n", ("drawbar_pull", "N", True)),
        ("meas_sinkage_m", ("sinkage", "m", True)),
        ("measured slip", ("slip", "1", False)),
        ("slip_angle_deg", ("slip_angle", "deg", True)),
        ("V_mm_s", ("velocity", "mm/s", True)),
        ("velocity_m_per_s", ("velocity", "m/s", True)),
        ("omega_rpm", ("angular_velocity", "rpm", True)),
        ("T_Nm", ("torque", "N m", True)),
        ("t_s", ("time", "s", True)),
        ("time_ms", ("time", "ms", True)),
        ("time_min", ("time", "min", True)),
        ("time (UTC)", ("time", "s", False)),
        ("time [ISO 8601]", ("time", "s", False)),
        ("timestamp_ns", ("time", "ns", True)),
        ("slip [%]", ("slip", "%", True)),
        ("slip_pct", ("slip", "%", True)),
        ("slip_ratio", ("slip", "1", False)),
        ("pass_number [-]", ("pass_number", "1", True)),
        ("motor_temp_c", ("motor_temperature", "°C", True)),
        ("motor_temperature_K", ("motor_temperature", "K", True)),
        ("motor_current_mA", ("motor_current", "mA", True)),
        ("acceleration_g", ("acceleration", "g", True)),
        ("longitude_deg", ("longitude", "deg", True)),
        ("lat", ("latitude", "deg", False)),
        ("x_m", ("x", "m", True)),
        ("theta1_deg", ("entry_angle", "deg", True)),
        ("Drawbar Pull", ("drawbar_pull", "N", False)),
        (" DP ", ("drawbar_pull", "N", False)),
        ("W", ("load", "N", False)),
        ("T", ("torque", "N m", False)),
        ("z", ("sinkage", "m", False)),
        ("V", ("velocity", "m/s", False)),
        ("v", ("velocity", "m/s", False)),
        ("v_cm_s", ("velocity", "cm/s", True)),
        ("w_rad_s", ("angular_velocity", "rad/s", True)),
        ("w [rpm]", ("angular_velocity", "rpm", True)),
        ("w_kN", ("load", "kN", True)),
        ("i", ("slip", "1", False)),
        ("t", ("time", "s", False)),
        ("ω", ("angular_velocity", "rad/s", False)),
    ],
)
def test_headers_that_mean_a_channel(header, expected):
    assert read(header) == expected


@pytest.mark.parametrize(
    "header",
    [
        *(
            "effort",
            "current",
            "speed",
            "wheel_speed",
            "wheel_velocity",
            "motor_torque",
            "temperature",
            "altitude",
        ),
        *(
            "tractive_force",
            "Fx_tractive_N",
            "trial",
            "curL",
            "velR",
            "phi_deg",
            "tau",
            "Z",
            "w",
            "w_n",
            "w_std",
            "I",
            "",
        ),
        *("nominal_Vry_mm_s", "rim_speed_mm_s", "wheel_radius_m", "soil_shear_modulus_k_m", "t_start_s"),
        *("torque_std", "load_cell_N", "load_mean", "slip_1", "sinkage_in", "pose.position.x", "wheel [m]"),
        # A unit of another dimension on a name or unit too short to be sure of:
        *("T [°C]", "T_degC", "V [V]", "i [A]", "x_deg", "velocity_n", "torque_m", "torque_s", "load_min"),
    ],
)
def test_headers_that_mean_no_channel(header):
    assert identify(header) is None


@pytest.mark.parametrize(
    ("header", "text"),
    [
        ("torque [mm]", "'mm' is a unit of length; torque takes N m, kN m, mN m"),
        ("torque [-]", "'-' is a unit of ratio; torque takes N m"),
        ("torque ()", "'' is not a known unit; torque takes N m"),
        ("torque [furlong]", "'furlong' is not a known unit; torque takes N m"),
        ("load_kg", "'kg' is a unit of mass; load takes N, kN"),
        ("slip (deg)", "'deg' is a unit of angle; slip takes 1, %"),
        ("wheel_sinkage [MM]", "'MM' is not a known unit; sinkage takes m, km"),
    ],
)
def test_a_wrong_unit_is_bad_data_and_says_what_is_expected(header, text):
    with pytest.raises(InputError) as error:
        identify(header)
    assert str(error.value).startswith(f"column {header!r}: {text}")
    assert "rover.toml" in error.value.hint
    assert error.value.exit_code == 65


def test_a_channel_chosen_elsewhere_is_read_from_no_header():
    assert identify("torque [mm]", chosen={"torque"}) is None
    assert identify("load_kg", chosen={"load"}) is None
    assert identify("torque", chosen={"torque"}) is None
    assert read("T", chosen={"load"}) == ("torque", "N m", False)


def test_fields_of_messages_have_no_letters():
    assert identify("z", letters=False) is None
    assert identify("x", letters=False) is None
    assert read("sinkage", letters=False) == ("sinkage", "m", False)


def test_slip_hides_no_slip_angle():
    found = resolve(["slip", "slip_angle_deg", "sinkage_mm"])
    assert {name: header for name, (header, _) in found.items()} == {
        "slip": "slip",
        "slip_angle": "slip_angle_deg",
        "sinkage": "sinkage_mm",
    }


def test_resolve_sorts_channels_from_other_columns():
    found = resolve(["time", "W", "sinkage_mm", "T [°C]", "cable_N", "note", "terrain"])
    assert {channel: header for channel, (header, _) in found.items()} == {
        "time": "time", "load": "W", "sinkage": "sinkage_mm", "terrain": "terrain",
    }  # fmt: skip
    assert [stated_unit(header).symbol for header in ("T [°C]", "cable_N")] == ["°C", "N"]
    assert stated_unit("note") is None


@pytest.mark.parametrize(
    ("headers", "winner"),
    [
        (["W", "Fz", "load"], "load"),
        (["load", "load_kg"], "load"),
        (["load (raw)", "load"], "load"),
        (["W", "Fz", "load_kN"], "load_kN"),
        (["load_kN", "load"], "load"),
        (["W", "load_cell"], "W"),
    ],
)
def test_the_channels_own_name_wins(headers, winner):
    found = resolve(headers)
    assert found["load"][0] == winner
    assert list(found) == ["load"]


@pytest.mark.parametrize("headers", [["T_Nm", "wheel_torque"], ["x", "torque_mNm", "torque_Nm"]])
def test_two_columns_that_can_be_one_channel_are_an_error(headers):
    first, second = headers[-2:]
    with pytest.raises(InputError) as error:
        resolve(headers)
    assert f"columns {first!r} and {second!r} can all be torque" in str(error.value)
    assert f'[channels] torque = "{first}"' in error.value.hint
    assert resolve(headers, chosen={"torque"}).keys() == {"x"} & set(headers)


def test_of_a_letter_in_both_cases_none_is_preferred():
    with pytest.raises(InputError, match="columns 'V' and 'v' can all be velocity"):
        resolve(["V", "v"])
    found = resolve(["W", "w", "T", "t"])
    assert {channel: header for channel, (header, _) in found.items()} == {
        "load": "W", "torque": "T", "time": "t",
    }  # fmt: skip


def test_units_of_other_columns():
    assert stated_unit("rim_speed_mm_s").symbol == "mm/s"
    assert stated_unit("Fx_tractive_N").symbol == "N"
    assert stated_unit("cable [kN]").symbol == "kN"
    assert stated_unit("soil_k_m").symbol == "m"
    assert stated_unit("pull_nm", "torque").symbol == "N m"
    assert stated_unit("cable (raw)") is None
    assert stated_unit("load_min") is None
    assert stated_unit("cable") is None


@given(st.text(max_size=30))
def test_any_header_is_read_or_refused_in_one_line(header):
    try:
        outcome = identify(header)
    except InputError as error:
        outcome = error
    if isinstance(outcome, InputError):
        assert "\n" not in str(outcome)
    else:
        assert outcome is None or outcome.channel in CHANNELS


def test_hints():
    assert unit_hint("terrain") == "terrain takes no unit"
    assert all("takes" in unit_hint(name) for name in CHANNELS)
    assert sum(c.dimension == LABEL for c in CHANNELS.values()) == 3
