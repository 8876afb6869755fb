"""Wrong units are told or refused, with the line that mends them; right ones raise no doubt."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from wheel_bags import GEOMETRY

from formats import open_source
from terrain_cli import rover as rovers
from terrain_cli import telemetry
from terrain_cli.app import main
from terrain_cli.errors import InputError
from terrain_cli.simulation.drive_file import PRESETS
from terrain_cli.simulation.scenario import SOILS
from terrain_cli.telemetry import assembly, long_logs, mapping, raw_channels
from terrain_cli.telemetry.unit_doubts import Doubt, ImplausibleError
from terrain_cli.vocabulary.channels import CHANNELS

ROOT = Path(__file__).resolve().parents[2]
RADIUS = 0.125


@pytest.fixture(scope="module")
def drive():
    """Return some seconds of one wheel of the sample drive, with its slip and entry angle."""
    table = pd.read_csv(ROOT / "sample_data" / "run.csv")
    table = table[(table["wheel"] == "front-left") & (table["angular_velocity"] > 0.0)]
    # On whole milliseconds, and not since 1970.
    table = table.assign(time=(table["time"] - table["time"].iloc[0]).round(3))
    return table.drop(columns="wheel").iloc[:500].reset_index(drop=True)


def slip_of(table):
    return 1.0 - table["velocity"] / (RADIUS * table["angular_velocity"])


def angle_of(table):
    return np.arccos(1.0 - table["sinkage"] / RADIUS)


def without(table, *names):
    return table.drop(columns=[name for name in names if name in table])


SLOPE = 8.0 * np.sin(np.arange(500) / 50.0)
#: What is wrong: what is done to a good drive, what is said, and the unit that mends it.
WRONG = {
    "time ms": (lambda d: d.assign(time=d["time"] * 1e3 + 0.25), "of a track of", "error", "ms"),
    "time µs": (lambda d: d.assign(time=d["time"] * 1e6 + 0.25), "of a track of", "error", "µs"),
    "time ns": (lambda d: d.assign(time=d["time"] * 1e9 + 0.25), "of a track of", "error", "ns"),
    "time min": (lambda d: d.assign(time=d["time"] / 60.0), "of a track of", "error", "min"),
    "time h": (lambda d: d.assign(time=d["time"] / 3600.0), "of a track of", "error", "h"),
    "time ms, by longitude": (
        lambda d: without(
            d.assign(time=d["time"] * 1e3 + 0.25, longitude=d["x"] / 111e3, latitude=d["y"] / 111e3), "x", "y"
        ),
        "of a track of",
        "error",
        "ms",
    ),
    "time ms, no track": (
        lambda d: without(d.assign(time=(d["time"] * 1e3).round()), "x", "y"),
        "can hardly be seconds",
        "error",
        "ms",
    ),
    "time ms, no track, not whole": (
        lambda d: without(d.assign(time=d["time"] * 1e3 + 0.25), "x", "y"),
        "s apart, in which the wheel drives",
        "doubt",
        "ms",
    ),
    "x, y mm": (lambda d: d.assign(x=d["x"] * 1e3, y=d["y"] * 1e3), "of a track of", "error", "mm"),
    "x, y cm": (lambda d: d.assign(x=d["x"] * 1e2, y=d["y"] * 1e2), "of a track of", "error", "cm"),
    "ω deg/s": (
        lambda d: d.assign(angular_velocity=np.degrees(d["angular_velocity"])), "times V", "error", "deg/s"
    ),
    "ω rpm": (
        lambda d: d.assign(angular_velocity=d["angular_velocity"] * 30.0 / np.pi), "times V", "doubt", "rpm"
    ),
    "ω rev/s": (
        lambda d: d.assign(angular_velocity=d["angular_velocity"] / (2.0 * np.pi)),
        "as if the wheel skidded",
        "doubt",
        "rev/s",
    ),
    "ω rpm, slip measured": (
        lambda d: d.assign(slip=slip_of(d), angular_velocity=d["angular_velocity"] * 30.0 / np.pi),
        "but by ω, V and the wheel's radius",
        "error",
        "rpm",
    ),
    "V cm/s": (
        lambda d: without(d, "x", "y").assign(velocity=d["velocity"] * 1e2), "skidded", "error", "cm/s"
    ),
    "V mm/s": (
        lambda d: without(d, "x", "y").assign(velocity=d["velocity"] * 1e3), "skidded", "error", "mm/s"
    ),
    "V km/h": (lambda d: d.assign(velocity=d["velocity"] * 3.6), "skidded", "doubt", "km/h"),
    "slip %": (
        lambda d: without(d.assign(slip=1e2 * slip_of(d)), "angular_velocity", "velocity"),
        "slip is beyond ±1 in 100% of the samples",
        "error",
        "%",
    ),
    "load kN": (lambda d: d.assign(load=d["load"] / 1e3), "any soil can resist", "error", "kN"),
    "load mN": (lambda d: d.assign(load=d["load"] * 1e3), "times load times wheel radius", "error", "mN"),
    "load kg": (lambda d: d.assign(load=d["load"] / 9.80665), "any soil can resist", "doubt", "kgf"),
    "load g": (lambda d: d.assign(load=d["load"] / 9.80665e-3), "wheel radius at a slip", "doubt", "kgf"),
    "torque N mm": (lambda d: d.assign(torque=d["torque"] * 1e3), "any soil can resist", "error", "N mm"),
    "torque N cm": (lambda d: d.assign(torque=d["torque"] * 1e2), "any soil can resist", "error", "N cm"),
    "torque kN m": (lambda d: d.assign(torque=d["torque"] / 1e3), "radius at a slip", "error", "kN m"),
    "torque, other sign": (lambda d: d.assign(torque=-d["torque"]), "negative", "doubt", "N m"),
    "sinkage mm": (lambda d: d.assign(sinkage=d["sinkage"] * 1e3), "beyond the radius", "error", "mm"),
    "sinkage cm": (lambda d: d.assign(sinkage=d["sinkage"] * 1e2), "beyond the radius", "error", "cm"),
    "sinkage in": (lambda d: d.assign(sinkage=d["sinkage"] / 0.0254), "beyond the radius", "error", "in"),
    "sinkage km": (lambda d: d.assign(sinkage=d["sinkage"] / 1e3), "less than a sensor", "doubt", ""),
    "entry angle deg": (
        lambda d: without(d.assign(entry_angle=np.degrees(angle_of(d))), "sinkage"),
        "entry_angle is beyond a right angle",
        "error",
        "deg",
    ),
    "pitch deg": (lambda d: d.assign(pitch=SLOPE), "pitch reaches", "doubt", "deg"),
    "roll deg": (lambda d: d.assign(roll=SLOPE), "roll reaches", "doubt", "deg"),
    "torque stuck": (lambda d: d.assign(torque=3.107), "torque is 3.107 in every sample", "doubt", ""),
    "torque cut off": (
        lambda d: d.assign(torque=d["torque"].clip(upper=d["torque"].quantile(0.9))),
        "in 10% of the samples, and never more: a sensor, or what reads it, may be at its limit",
        "doubt",
        "",
    ),
    "sinkage stuck": (lambda d: d.assign(sinkage=0.0207), "sinkage is 0.0207 in every", "doubt", ""),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_unit_is_told_with_the_line_that_mends_it(name, drive, judged):
    spoil, says, kind, unit = WRONG[name]
    table = spoil(drive)
    if kind == "error":
        with pytest.raises(InputError, match=re.escape(says)) as error:
            judged(table)
        *_, line = error.value.hint.splitlines()
    else:
        (line,) = judged(table)
        assert says in line
        assert "\n" not in line
        line = line.partition(", ")[2] if unit else ""
    if not unit:
        return
    written = {"µs": "us"}.get(unit, unit) if "no track" in name else unit
    entry = re.search(r'\w+ = \{ column = "(\w+)", unit = "([^"]*)".*? \}', line)
    assert (entry[1] in table.columns, entry[2]) == (True, written)
    # The line is enough.
    lines = [] if kind == "doubt" else error.value.hint.partition("[channels]\n")[2].splitlines()
    mended = judged(table, f"{GEOMETRY}[channels]\n" + "\n".join(lines or [entry[0]]))
    assert mended == []


@pytest.mark.parametrize(("end", "share"), [("upper", 0.9), ("lower", 0.1)])
def test_the_samples_below_a_limit_are_those_that_its_condition_keeps(drive, judged, end, share):
    limit = drive["torque"].quantile(share)
    table = drive.assign(torque=drive["torque"].clip(**{end: limit}))
    kept = table.query(judged(table)[0].beyond)
    assert (len(kept), judged(kept)) == (int((table["torque"] != limit).sum()), [])


#: The same of what changes together, each with the line that mends it.
CHANGES = {
    "pull kN": (lambda d: d.assign(drawbar_pull=d["drawbar_pull"] / 1e3), "drawbar_pull", "kN"),
    "pull kg": (lambda d: d.assign(drawbar_pull=d["drawbar_pull"] / 9.80665), "drawbar_pull", "kgf"),
    "pull g": (lambda d: d.assign(drawbar_pull=d["drawbar_pull"] / 9.80665e-3), "drawbar_pull", "kgf"),
    "pull lbf": (lambda d: d.assign(drawbar_pull=d["drawbar_pull"] / 4.44822), "drawbar_pull", "lbf"),
    "pull mN": (lambda d: d.assign(drawbar_pull=d["drawbar_pull"] * 1e3), "drawbar_pull", "mN"),
    "pull, other sign": (lambda d: d.assign(drawbar_pull=-d["drawbar_pull"]), "drawbar_pull", "N"),
    "torque lbf ft": (lambda d: d.assign(torque=d["torque"] / 1.355818), "torque", "lbf ft"),
}


@pytest.fixture(scope="module")
def pulling(tmp_path_factory):
    """Return a drive whose slip varies, with its drawbar pull."""
    path = tmp_path_factory.mktemp("pulling") / "run.csv"
    given = ("--soil", "clayey-loam", "--noise", "2%", "--duration", "30", "--rate", "20")
    with pytest.raises(SystemExit):
        main(["simulate", "-q", "-o", str(path), *given])
    return pd.read_csv(path).drop(columns="wheel")


@pytest.mark.parametrize("name", CHANGES)
def test_a_pull_changes_as_the_torque_over_the_radius(name, pulling, judged):
    spoil, channel, unit = CHANGES[name]
    (line,) = judged(spoil(pulling), effects=(), compared=True)
    assert " of what torque over wheel radius changes by, at the same load: if " in line
    entry = re.search(r'(\w+) = \{ column = "\w+", unit = "([^"]*)".*? \}', line)
    assert (entry[1], entry[2]) == (channel, unit)
    assert line.of == f"the {'sign' if 'sign' in name else 'unit'} of {channel.replace('_', ' ')}"
    assert judged(spoil(pulling), f"{GEOMETRY}[channels]\n{entry[0]}", effects=(), compared=True) == []


def test_noise_does_not_hide_the_sign_of_a_pull(pulling, judged):
    """Stretch by stretch a noisy torque tells nothing; the whole drive does, by how deep the wheel is."""
    noise = 0.6 * pulling["torque"].std() * np.random.default_rng(79_990_011).standard_normal(len(pulling))
    noisy = pulling.assign(torque=pulling["torque"] + noise)
    assert judged(noisy, effects=(), compared=True) == []
    (line,) = judged(noisy.assign(drawbar_pull=-noisy["drawbar_pull"]), effects=(), compared=True)
    assert "drawbar_pull falls where torque over wheel radius, less what the soil resists, rises" in line
    assert line.of == "the sign of drawbar pull"


def test_a_torque_of_the_other_sign_leaves_the_pull_alone(pulling, judged):
    """Mended too, the pull would be of the wrong sign."""
    (line,) = judged(pulling.assign(torque=-pulling["torque"]), effects=(), compared=True)
    assert line.of == "the sign of torque"


def test_a_sign_that_rover_toml_states_is_settled(pulling, judged):
    """Said to be right it is doubted all the same, and nobody is asked again."""
    stated = '[channels]\ndrawbar_pull = { column = "drawbar_pull", unit = "N" }'
    wrong = pulling.assign(drawbar_pull=-pulling["drawbar_pull"])
    (line,) = judged(wrong, f"{GEOMETRY}{stated}", effects=(), compared=True)
    assert line.of == ""


def test_a_pull_that_falls_as_the_wheel_digs_in_is_no_pull_in_pounds(pulling, judged):
    """With slip-sinkage on wet clay the pull changes by 0.35 of what it does on firm ground."""
    digging = pulling.assign(drawbar_pull=0.37 * pulling["drawbar_pull"])
    assert judged(digging, effects=(), compared=True) == []


def test_a_drag_that_comes_and_goes_is_no_torque_in_pounds(pulling, judged):
    """A wrong unit makes the pull change by too much all the time."""
    more = 0.4 * pulling["torque"] / 0.125
    late = pulling.index > 0.3 * len(pulling)
    for there, doubts in ((late, 0), (True, 1)):
        pulled = pulling.assign(drawbar_pull=pulling["drawbar_pull"] + there * more)
        assert len(judged(pulled, effects=(), compared=True)) == doubts


@pytest.mark.parametrize("name", ["torque", "drawbar_pull", "load", "sinkage"])
def test_a_channel_that_is_frozen_for_a_part(name, pulling, judged):
    frozen = pulling.copy()
    frozen.loc[100:450, name] = frozen.loc[100, name]
    (told,) = judged(frozen, effects=(), compared=True)
    assert re.search(rf"{name} is [\d.]+ in 58% of the samples, one after another, while slip goes", told)
    # The others have the condition that every verb proposes.
    assert len(frozen.query(told.partition("these out: --where ")[2].strip("'"))) == len(frozen) - 351
    # Held until the next value comes, or rounded: so all the time, not for a part.
    for whole in (
        pulling[name].where(pulling.index % 100 == 0).ffill(),
        pulling[name].round(3 if name == "sinkage" else 2),
    ):
        assert judged(pulling.assign(**{name: whole}), effects=(), compared=True) == []


@pytest.mark.parametrize(
    "name", [name for name, wrong in WRONG.items() if wrong[2] == "error" and "hardly" not in wrong[1]]
)
def test_what_rover_toml_states_is_believed_and_doubted(name, drive, judged):
    spoil, says, _, _ = WRONG[name]
    table = spoil(drive)
    with pytest.raises(ImplausibleError) as error:
        judged(table)
    lines = error.value.hint.partition("[channels]\n")[2]
    channel = CHANNELS[lines.partition(" = ")[0]]
    stated = re.sub(r'unit = "[^"]*"', f'unit = "{channel.unit.symbol}"', lines)
    assert any(says in doubt for doubt in judged(table, f"{GEOMETRY}[channels]\n{stated}"))


def test_a_velocity_that_was_derived_is_wrong_with_its_slip(drive, judged):
    with pytest.raises(ImplausibleError, match="slip is beyond ±1") as error:
        judged(without(drive.assign(slip=1e2 * slip_of(drive)), "velocity"))
    assert "\nslip = {" in error.value.hint


def test_a_header_states_a_unit_too(drive, judged):
    (doubt,) = judged(drive.assign(torque=1e3 * drive["torque"]).rename(columns={"torque": "torque_Nm"}))
    assert 'if torque is in N mm, torque = { column = "torque_Nm", unit = "N mm" }' in doubt
    # Metres under a header that says millimetres.
    (doubt,) = judged(drive.assign(load=drive["load"]).rename(columns={"torque": "torque [kN m]"}))
    assert 'if torque is in N m, torque = { column = "torque [kN m]", unit = "N m" }' in doubt


def test_a_constant_of_rover_toml_is_mended_there(drive, judged):
    given = f'{GEOMETRY}[channels]\nload = {{ constant = 8.3, unit = "N" }}\n'
    (doubt,) = judged(without(drive, "load"), given)
    assert 'if load is in kg, load = { constant = 8.3, unit = "kgf" } under [channels]' in doubt


@pytest.mark.parametrize(
    ("soil", "preset"),
    [
        *(("dry-sand", preset) for preset in PRESETS),
        *((soil, "mixed") for soil in SOILS),
        ("snow", "slip-sweep"),
    ],
)
@pytest.mark.parametrize("noise", ["0%", "5%"])
def test_no_drive_of_any_soil_is_doubted(soil, preset, noise, tmp_path):
    given = ("--soil", soil, "--drive", preset, "--noise", noise, "--duration", "20", "--rate", "5")
    with pytest.raises(SystemExit) as end:
        main(["simulate", "-q", "-o", str(tmp_path / "run.csv"), *given])
    assert not end.value.code
    rover = rovers.load(tmp_path / "rover.toml")
    for wheels in (
        telemetry.read(str(tmp_path / "run.csv"), rover),
        telemetry.read(str(tmp_path / "run.csv"), rover, effects=(), compared=True),
    ):
        assert [r for one in wheels for r in one.remarks if isinstance(r, Doubt)] == []


def test_an_entry_angle_beyond_half_a_turn_is_no_depth(drive, judged, tmp_path):
    angle = angle_of(drive).to_numpy().copy()
    # Its cosine is that of 0.5.
    angle[40] = 4.0 * np.pi + 0.5
    assert judged(without(drive.assign(entry_angle=angle), "sinkage")) == []
    (wheel,) = telemetry.read(str(tmp_path / "run.csv"), rovers.load(tmp_path / "rover.toml"))
    assert wheel.reasons() == {"sinkage beyond the wheel radius": 1}


def in_parts(path, rover):
    source = open_source(path)
    layout = mapping.plan(source, rover)
    request = assembly.Request(layout=layout, rover=rover, extras=layout.extras)
    batches = source.read("", raw_channels.fields(request)[""], 50)
    return list(long_logs.in_parts(request, batches))


def test_a_long_log_is_doubted_as_a_whole(drive, judged, monkeypatch, tmp_path):
    monkeypatch.setattr(long_logs, "ROWS", 120)
    monkeypatch.setattr(long_logs, "BESIDE", 40)
    path, rover = str(tmp_path / "run.csv"), tmp_path / "rover.toml"

    def told():
        found = in_parts(path, rovers.load(rover))
        assert len(found) > 2
        return [remark for remark in found[0].remarks if isinstance(remark, Doubt)]

    whole = judged(drive.assign(torque=3.107, pitch=SLOPE))
    assert [doubt.partition(" in every sample")[0] for doubt in whole] == [
        doubt.partition(" in every sample")[0] for doubt in told()
    ]
    # It is not stuck: it moves in the last part alone.
    torque = np.where(np.arange(500) < 450, 3.107, 3.2)
    assert judged(drive.assign(torque=torque)) == told() == []
    with pytest.raises(ImplausibleError):
        judged(drive.assign(torque=1e3 * drive["torque"]))
    with pytest.raises(ImplausibleError, match="more than any soil can resist"):
        told()


def test_a_bag_is_mended_by_topic_and_field(tmp_path):
    text = (ROOT / "sample_data" / "rover.toml").read_text("utf-8")
    (tmp_path / "rover.toml").write_text(text.replace('unit = "N m"', 'unit = "kN m"', 1), encoding="utf-8")
    left, right = telemetry.read(str(ROOT / "sample_data" / "run.bag"), rovers.load(tmp_path / "rover.toml"))
    (doubt,) = (remark for remark in left.remarks if isinstance(remark, Doubt))
    assert doubt.startswith("wheel front-left: torque is ")
    assert doubt.endswith(
        'if torque is in N m, torque = { topic = "/joint_states", field = "effort", '
        'name = "front_left_wheel", unit = "N m" } under [wheels.front-left.channels] of rover.toml'
    )
    assert not [remark for remark in right.remarks if isinstance(remark, Doubt)]


@pytest.mark.parametrize(
    "command",
    [
        ("estimate", "run.csv"),
        ("inspect", "run.csv"),
        ("compare", "run.csv", "--model", "linear"),
    ],
    ids=lambda command: command[0],
)
def test_a_command_tells_a_doubt_and_an_error(command, drive, tmp_path, monkeypatch, capfd):
    # diagnose, report and model add read as compare does, batch as estimate does.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.toml").write_text(GEOMETRY, encoding="utf-8")

    def run(table):
        table.to_csv("run.csv", index=False)
        with pytest.raises(SystemExit) as end:
            main(list(command))
        out, err = capfd.readouterr()
        return end.value.code, out, err

    told = " rad: if pitch is in deg, pitch = { column = "
    code, out, err = run(drive.iloc[:60].assign(pitch=SLOPE[90:150]))
    assert not code
    assert told in (err if command[0] == "estimate" else out)
    code, out, err = run(drive.iloc[:60].assign(torque=1e3 * drive["torque"]))
    assert code == (0 if command[0] == "inspect" else 65)
    assert "times load times wheel radius, more than any soil can resist" in out + err
    assert 'torque = { column = "torque", unit = "N mm" }' in out + err
