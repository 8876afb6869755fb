"""`terrain-est init`: what it drafts is TOML, and once it is filled in `estimate` works with it."""

from __future__ import annotations

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import pytest

from terrain_cli import rover as rovers

ROOT = Path(__file__).resolve().parent.parent
SAMPLE = ROOT / "sample_data"
BAGS = ROOT.parent / "shared" / "data" / "bags"
GEOMETRY = {"radius": "0.125", "width": "0.1", "shear_modulus": "0.018"}


def filled(text):
    """Fill in what a draft asks for, as its first lines say: the sizes, the soil, and effort as torque."""
    for name, value in GEOMETRY.items():
        text, found = re.subn(rf"# {name} = …", f"{name} = {value}", text)
        assert found == 1, name
    return text.replace("# torque = {", "torque = {")


@pytest.fixture
def draft(terrain_est_here):
    def run(log, *args):
        done = terrain_est_here("init", log, *args)
        assert done.returncode == 0, done.stderr
        tomllib.loads(done.stdout)
        return done.stdout, done.stderr

    return run


@pytest.mark.parametrize("name", ["run.csv", "run.parquet", "run.bag", "run.mcap"])
def test_filled_in_it_gives_the_estimates_of_a_file_by_hand(name, draft, terrain_est_here, tmp_path):
    text, told = draft(SAMPLE / name)
    bag = name in {"run.bag", "run.mcap"}
    rest = ", position of each wheel, torque" if bag else ""
    assert told == f"still to fill in: radius, width, shear_modulus{rest}\n"
    (tmp_path / "rover.toml").write_text(filled(text), "utf-8")
    assert len(rovers.load(tmp_path / "rover.toml").wheels) == 2
    args = ("estimate", SAMPLE / name, "--method", "least-squares")
    ours = terrain_est_here(*args, "--rover", tmp_path / "rover.toml")
    by_hand = terrain_est_here(*args)
    assert (ours.returncode, by_hand.returncode) == (0, 0)
    # By hand the wheels have other names than their topics.
    assert ours.stdout.replace("front_", "front-") == by_hand.stdout
    assert by_hand.stdout.count("\n") > 5


def test_a_column_that_may_be_the_drawbar_pull_is_shown(draft, tmp_path):
    path = tmp_path / "rig.csv"
    path.write_text("time,load,torque,sinkage_mm,slip,Fx_tractive_N\n0,80,2,5,0.1,7\n1,81,2.1,5,0.1,7.2\n")
    line = 'drawbar_pull = { column = "Fx_tractive_N", unit = "N" }'
    text = draft(path)[0]
    assert f"# keep one of these lines if it is the drawbar pull:\n# {line}\n" in text
    assert tomllib.loads(text.replace(f"# {line}", line))["channels"]["drawbar_pull"]["unit"] == "N"
    path.write_text("time,load,torque,sinkage_mm,slip,drawbar_pull\n0,80,2,5,0.1,7\n")
    assert "# drawbar_pull" not in draft(path)[0]


def test_as_it_is_the_geometry_is_missed(draft, terrain_est_here, tmp_path):
    (tmp_path / "rover.toml").write_text(draft(SAMPLE / "run.csv")[0], "utf-8")
    done = terrain_est_here("estimate", SAMPLE / "run.csv", "--rover", tmp_path / "rover.toml")
    assert done.returncode == 78
    assert "does not give the radius and width of the wheel and the shear modulus of the soil" in done.stderr


def test_a_unit_that_the_header_states_is_written_and_no_other(draft, tmp_path):
    log = tmp_path / "points.csv"
    log.write_text("slip,depth,sinkage_mm,Fz [kN],T\n0.1,1,10,0.1,2\n0.2,1,11,0.1,3\n")
    lines = draft(log)[0].splitlines()
    assert 'sinkage = { column = "sinkage_mm", unit = "mm" }  # 0.01 … 0.011 m' in lines
    assert 'load = { column = "Fz [kN]", unit = "kN" }  # 100 N' in lines
    (torque,) = (line for line in lines if line.startswith("torque"))
    assert torque.startswith('torque = { column = "T" }  # 2 … 3 N m; no unit is stated: taken as N m')
    assert 'slip = { column = "slip" }  # 0.1 … 0.2' in lines
    assert "# the columns that are left: depth" in lines


def test_effort_is_left_to_the_user(draft):
    lines = draft(SAMPLE / "run.bag")[0].splitlines()
    own = lines[lines.index("[wheels.front_left.channels]") : lines.index("[wheels.front_right]")]
    place = 'topic = "/joint_states", field = "effort", name = "front_left_wheel"'
    asked = own.index(f'# torque = {{ {place}, unit = "N m" }}')
    assert "effort may be the torque at the wheel, or the current" in own[asked - 1]
    assert own[asked + 1].startswith(f'# motor_current = {{ {place}, unit = "A" }}')
    assert 'topic = "/front_left/sinkage" }  # 0.00492 … 0.02296 m; no unit is stated' in "\n".join(own)


def test_effort_of_a_table_is_left_to_the_user_too(draft, terrain_est_here, tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("time,load,effort,sinkage,slip\n0,80,3,0.01,0.1\n1,81,3,0.01,0.2\n")
    lines = draft(log)[0].splitlines()
    asked = lines.index('# torque = { column = "effort", unit = "N m" }')
    assert "effort may be the torque at the wheel, or the current" in lines[asked - 1]
    instead = 'motor_current = { column = "effort", unit = "A" }  # instead, if that is what effort is here'
    assert lines[asked + 1].startswith(f"# {instead}")
    sizes = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
    (tmp_path / "rover.toml").write_text(sizes)
    assert f"# {instead}" in terrain_est_here("estimate", log).stderr
    log.write_text("time,load,effort_left,effort_right,tractive_effort,sinkage,slip\n0,80,3,4,5,0.01,0.1\n")
    assert 'torque = { column = "…", unit = "N m" }  # one of: effort_left, effort_right' in draft(log)[0]


@pytest.mark.skipif(not BAGS.is_dir(), reason="the measured data are not here")
@pytest.mark.parametrize(
    ("name", "missing"),
    [
        ("plotjuggler_fake_joint_state.bag", "load, sinkage and slip"),
        ("robot_localization_test1.bag", "load, torque, sinkage and slip"),
    ],
)
def test_of_a_bag_that_lacks_channels_the_others_are_read(name, missing, draft, terrain_est_here, tmp_path):
    text, _ = draft(BAGS / name)
    (tmp_path / "rover.toml").write_text(
        filled(text).replace('torque = { topic = "…"', "# torque = {"), "utf-8"
    )
    done = terrain_est_here("estimate", BAGS / name, "--rover", tmp_path / "rover.toml")
    assert done.returncode == 65
    assert f"{missing} are neither measured nor derived" in done.stderr
    assert terrain_est_here("inspect", BAGS / name, "--rover", tmp_path / "rover.toml").returncode == 0


def test_what_contradicts_itself_is_told_in_the_draft(draft, tmp_path):
    log = tmp_path / "points.csv"
    log.write_text("slip,Fz,W\n0.1,1,10\n")
    text, told = draft(log)
    assert (
        "columns 'Fz' and 'W' can all be load\n# choose one in rover.toml: [channels] load = \"Fz\"" in text
    )
    assert told == "still to fill in: radius, width, shear_modulus, the channels\n"


@pytest.mark.parametrize("name", ['Kraft "N"\\', "a\x1bb", "Breite, m", "τ"])
def test_any_header_gives_toml(name, draft, tmp_path):
    log = tmp_path / "points.csv"
    quoted = name.replace('"', '""')
    log.write_text(
        f'slip,load,torque,sinkage,wheel,"{quoted}"\n0.1,1,1,1,"{quoted}",1\n0.1,2,1,1,r,2\n', "utf-8"
    )
    wheels = tomllib.loads(filled(draft(log)[0]))["wheels"]
    assert set(wheels) == {name, "r"}


def test_a_file_is_replaced_by_force_only(draft, terrain_est_here, tmp_path):
    shutil.copy(SAMPLE / "run.csv", tmp_path)
    log, target = tmp_path / "run.csv", tmp_path / "rover.toml"
    assert draft(log, "-o", target, "-q") == ("", "")
    first = target.read_text("utf-8")
    assert first == draft(log)[0]
    target.write_text("mine")
    refused = terrain_est_here("init", log, "-o", target)
    assert (refused.returncode, target.read_text()) == (73, "mine")
    # What is there is not read, or it would be an error.
    draft(log, "-o", target, "--force")
    assert target.read_text("utf-8") == first


def test_one_log_at_a_time(terrain_est_here, tmp_path):
    for name in ("a.csv", "b.csv"):
        shutil.copy(SAMPLE / "run.csv", tmp_path / name)
    done = terrain_est_here("init", tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "stands for 2 logs" in done.stderr


def test_inspect_ends_with_a_hint_that_works(terrain_est_here, tmp_path):
    folder = tmp_path / "day 1"
    folder.mkdir()
    shutil.copy(SAMPLE / "run.csv", folder)
    hint = terrain_est_here("inspect", folder / "run.csv").stdout.splitlines()[-1]
    name, *args = shlex.split(hint.removeprefix("draft a rover.toml: "))
    assert (name, args[0]) == ("terrain-est", "init")
    assert terrain_est_here(*args).returncode == 0
    assert "draft a rover.toml" not in terrain_est_here("inspect", folder / "run.csv").stdout


def test_a_time_of_two_columns_needs_no_line(draft, terrain_est_here, tmp_path):
    log = tmp_path / "run.csv"
    rows = (SAMPLE / "run.csv").read_text().splitlines()[:200]
    head, *cells = (row.partition(",")[::2] for row in rows if "front-right" not in row)
    lines = [f"stamp_secs,stamp_nsecs,{head[1]}"]
    lines += [f"{int(float(time))},{round(float(time) % 1 * 1e9)},{rest}" for time, rest in cells]
    log.write_text("\n".join(lines) + "\n")
    text, _ = draft(log)
    assert "# time: stamp_secs + stamp_nsecs, found without a line here" in text.splitlines()
    (tmp_path / "rover.toml").write_text(filled(text), "utf-8")
    done = terrain_est_here("estimate", log, "--method", "least-squares", "--segments", "none", "-q")
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1].split(",")[4].startswith("17540000")
