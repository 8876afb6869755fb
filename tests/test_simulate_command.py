"""`terrain-est simulate` as users run it: files, their bytes, what they are worth, and riddles."""

from __future__ import annotations

import csv
import io
import json
import math
import tomllib
from pathlib import Path

import numpy as np
import pytest

from terrain_cli import effects, telemetry
from terrain_cli import rover as rovers
from terrain_cli.simulation.drive_file import PRESETS
from terrain_cli.simulation.scenario import START

PAGE = (Path(__file__).resolve().parent.parent / "docs" / "simulate.md").read_text("utf-8")
KINDS = ["csv", "csv.gz", "csv.bz2", "csv.zst", "parquet", "bag", "mcap", "db3", "mcap/", "db3/"]
SHORT = ("--duration", "20")


def read(folder, name):
    return telemetry.read(str(folder / name), rovers.load(folder / "rover.toml"))


@pytest.fixture
def simulate(terrain_est_here, tmp_path):
    """Return a function that simulates into a folder, and fails where the command does."""

    def run(*args, folder=tmp_path, output="run.csv"):
        done = terrain_est_here("simulate", "-o", f"{folder}/{output}", *args)
        assert (done.returncode, done.stdout) == (0, ""), done.stderr
        return done.stderr

    return run


@pytest.mark.parametrize("kind", KINDS)
def test_same_seed_same_bytes(kind, simulate, tmp_path):
    content = []
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        args = (
            *SHORT,
            "--noise",
            "3%",
            "--wheels",
            "2",
            "--seed",
            "5",
            "--truth",
            tmp_path / folder / "truth.json",
        )
        simulate(*args, folder=tmp_path / folder, output=f"run.{kind}")
        files = sorted(path for path in (tmp_path / folder).rglob("*") if path.is_file())
        content.append({str(path.relative_to(tmp_path / folder)): path.read_bytes() for path in files})
    assert content[0] == content[1]
    assert {"rover.toml", "truth.json"} < content[0].keys()


def test_other_seed_other_noise(simulate, tmp_path):
    for seed in ("1", "2"):
        simulate(*SHORT, "--noise", "3%", "--seed", seed, output=f"{seed}.csv")
    assert (tmp_path / "1.csv").read_bytes() != (tmp_path / "2.csv").read_bytes()


@pytest.mark.parametrize("kind", KINDS)
def test_estimate_reads_it_at_once(kind, simulate, terrain_est_here, tmp_path):
    simulate("--drive", "load-steps", "--wheels", "2", "--noise", "1%", output=f"run.{kind}")
    done = terrain_est_here("estimate", tmp_path / f"run.{kind}", "--segments", "none")
    assert done.returncode == 0, done.stderr
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert [row["wheel"] for row in rows] == ["front-left", "front-right"]
    assert all(abs(float(row["phi_deg"]) - 28.0) < 8.0 for row in rows)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_inspect_uses_every_topic(kind, simulate, terrain_est_here, tmp_path):
    simulate(*SHORT, "--wheels", "4", output=f"run.{kind}")
    done = terrain_est_here("inspect", tmp_path / f"run.{kind}", "--json")
    (found,) = json.loads(done.stdout)["inputs"]
    assert found["rover_toml"] == ""
    assert len(found["wheels"]) == 4
    for wheel in found["wheels"]:
        assert not wheel["undecided"]
        assert not wheel["missing"]
        assert {
            *("load", "torque", "sinkage", "angular_velocity", "velocity", "drawbar_pull", "pitch", "roll"),
            *(
                "x",
                "y",
                "elevation",
                "yaw_rate",
                "acceleration",
                "slip_angle",
                "motor_temperature",
                "pass_number",
            ),
        } == wheel["channels"].keys()
    used = json.dumps([wheel["channels"] for wheel in found["wheels"]])
    assert all(f"{stream['topic']} " in used for stream in found["streams"])
    assert len({round(stream["rate_Hz"], 3) for stream in found["streams"]}) >= 4


def test_formats_agree(simulate, tmp_path):
    """Without noise a bag says, at unequal rates, what the table says."""
    for output in ("run.csv", "run.bag", "run.mcap", "run.parquet"):
        simulate(*SHORT, "--wheels", "2", output=output)
    table = read(tmp_path, "run.csv")
    for other in ("run.bag", "run.mcap", "run.parquet"):
        for one, two in zip(table, read(tmp_path, other), strict=True):
            assert one.wheel == two.wheel
            np.testing.assert_allclose(one.time, two.time, atol=2e-6)
            for name in ("load", "torque", "sinkage", "slip", "x"):
                difference = np.abs(one.channels[name] - two.channels[name])
                assert np.nanmax(difference) < 5e-3 * np.nanmax(np.abs(one.channels[name])), (other, name)


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_gives_samples(preset, simulate, tmp_path):
    simulate("--drive", preset, "--rate", "5")
    for samples in read(tmp_path, "run.csv"):
        assert len(samples.usable) > 0.7 * len(samples)
        assert not samples.remarks


def test_drives_one_after_another(simulate, tmp_path):
    told = simulate(
        "--drive",
        "slip-sweep",
        "--drive",
        "load-steps",
        "--rate",
        "5",
        "--soil",
        "dry-sand",
        "--soil",
        "snow",
    )
    assert "120 s, 1 wheel" in told
    assert "dry-sand, snow" in told
    assert len(read(tmp_path, "run.csv")[0]) == 600


@pytest.mark.parametrize(("soil", "c", "phi"), [("dry-sand", 1.04, 28.0), ("sandy-loam", 1.72, 29.0)])
def test_linear_model_gives_the_soil_back(soil, c, phi, simulate, terrain_est_here, tmp_path):
    simulate("--model", "linear", "--soil", soil, "--drive", "load-steps", "--drive", "slip-sweep")
    done = terrain_est_here(
        "estimate", "--method", "least-squares", "--segments", "none", tmp_path / "run.csv"
    )
    (row,) = csv.DictReader(io.StringIO(done.stdout))
    # What is left is that the line drops κ3 of the paper.
    assert float(row["c_kPa"]) == pytest.approx(c, abs=0.06)
    assert float(row["phi_deg"]) == pytest.approx(phi, abs=0.3)


class TestTruth:
    def test_document(self, simulate, tmp_path):
        truth = tmp_path / "truth.json"
        soils = ("--soil", "dry-sand", "--soil", "sandy-loam")
        simulate(
            *SHORT, *soils, "--effect", "slip-sinkage:n1=0.4", "--noise", "torque=0.02", "--truth", truth
        )
        document = json.loads(truth.read_text("utf-8"))
        assert document["format"] == "terrain-est/truth/1"
        (effect,) = document["model"]["effects"]
        sizes = {"n1": 0.4, "n2": 0.0, "S": 0.5, "bend": 0.0}
        assert effect["parameters"] == {name: {"value": v, "unit": "1"} for name, v in sizes.items()}
        assert effect["hidden"] is False
        assert document["soils"]["dry-sand"]["c_kPa"] == pytest.approx(1.04)
        assert document["soils"]["dry-sand"]["phi_deg"] == pytest.approx(28.0)
        assert document["noise"]["torque"]["white"]["absolute"] == 0.02
        (wheel,) = document["wheels"]
        assert [part["soil"] for part in wheel["soils"]] == ["dry-sand", "sandy-loam"]
        assert (wheel["soils"][0]["t_start_s"], wheel["soils"][1]["t_end_s"]) == (START, START + 20.0)
        channels = document["channels"]
        assert len(channels["time"]) == len(channels["true_sinkage"]) == 400
        np.testing.assert_allclose(channels["slip"], channels["true_slip"])

    def test_table(self, simulate, tmp_path):
        simulate(*SHORT, "--effect", "slope", "--truth", tmp_path / "truth.csv")
        with (tmp_path / "truth.csv").open() as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == 400
        assert {row["soil"] for row in rows} == {"dry-sand"}
        assert {row["slope.factor"] for row in rows} == {"1.0"}
        assert math.isclose(float(rows[0]["cohesion_Pa"]), 1040.0)

    def test_none_unless_asked_for(self, simulate, tmp_path):
        simulate(*SHORT)
        assert sorted(path.name for path in tmp_path.iterdir()) == ["rover.toml", "run.csv"]

    def test_is_described(self, simulate, tmp_path):
        simulate(*SHORT, "--truth", tmp_path / "truth.json")
        described = PAGE.partition("## The truth")[2]
        document = json.loads((tmp_path / "truth.json").read_text("utf-8"))
        for key in (*document, *document["wheels"][0], *document["soils"]["dry-sand"], *document["wheel"]):
            assert f'"{key}"' in described or f"`{key}`" in described, key


class TestHide:
    @pytest.fixture
    def riddle(self, simulate, tmp_path):
        def make(seed, output="run.csv"):
            told = simulate(
                *("--drive", "mixed", *SHORT, "--noise", "3%", "--hide", "--seed", seed, "--force"),
                output=output,
            )
            sealed = json.loads((tmp_path / f"{output.rstrip('/')}.sealed.json").read_text("utf-8"))
            (effect,) = sealed["model"]["effects"]
            assert effect["hidden"]
            return told, effect

        return make

    @pytest.mark.parametrize("output", ["run.csv", "run.parquet", "run.bag", "run.mcap", "run.db3"])
    def test_name_is_only_in_the_sealed_file(self, output, riddle, tmp_path):
        told, effect = riddle(3, output)
        secrets = {
            effect["effect"],
            effect["title"],
            *(f"{effect['effect']}.{p}" for p in effect["parameters"]),
        }
        for path in tmp_path.iterdir():
            if not path.name.endswith(".sealed.json"):
                content = path.read_bytes().decode("utf-8", "ignore")
                assert not [secret for secret in secrets if secret in content], path
        assert not [name for name in (*secrets, *effects.NAMES) if name in told]
        assert f"{output}.sealed.json" in told

    def test_columns_and_rover_tell_nothing(self, riddle, tmp_path):
        seen = set()
        names = set()
        for seed in range(4):
            _, effect = riddle(seed)
            names.add(effect["effect"])
            header = (tmp_path / "run.csv").read_text().partition("\n")[0]
            seen.add((header, (tmp_path / "rover.toml").read_text("utf-8")))
        assert len(names) > 1
        assert len(seen) == 1

    def test_without_a_seed_each_is_another(self, simulate, tmp_path):
        seeds = set()
        for _ in range(2):
            simulate(*SHORT, "--hide", "--truth", tmp_path / "sealed.json", "--force")
            seeds.add(json.loads((tmp_path / "sealed.json").read_text("utf-8"))["seed"])
        assert len(seeds) == 2

    def test_seed_of_a_file_counts(self, simulate, tmp_path):
        (tmp_path / "drive.toml").write_text("seed = 11\nduration = 20\n")
        simulate(tmp_path / "drive.toml", "--hide", "--truth", tmp_path / "sealed.json")
        assert json.loads((tmp_path / "sealed.json").read_text("utf-8"))["seed"] == 11

    def test_needs_a_file(self, terrain_est_here):
        done = terrain_est_here("simulate", "--hide")
        assert (done.returncode, done.stdout) == (2, "")
        assert "--truth" in done.stderr


class TestRoverFile:
    def test_fits(self, simulate, tmp_path):
        simulate(*SHORT, "--wheels", "2")
        content = tomllib.loads((tmp_path / "rover.toml").read_text("utf-8"))
        assert content["wheel"]["radius"] == 0.125
        assert content["soil"]["shear_modulus"] == 0.018
        assert content["wheels"]["front-left"]["position"] == [0.0, 0.3, 0.0]

    def test_of_a_user_is_left_alone(self, simulate, tmp_path):
        (tmp_path / "rover.toml").write_text("[wheel]\nradius = 1.0\n")
        told = simulate(*SHORT)
        assert "left as it is" in told
        assert (tmp_path / "rover.toml").read_text() == "[wheel]\nradius = 1.0\n"

    def test_own_is_replaced(self, simulate, tmp_path):
        simulate(*SHORT, "--wheels", "2")
        simulate(*SHORT, "--wheels", "4", output="other.csv")
        assert len(rovers.load(tmp_path / "rover.toml").wheels) == 4

    def test_elsewhere(self, simulate, tmp_path, terrain_est_here):
        simulate(*SHORT, "--rover", tmp_path / "other.toml")
        assert not (tmp_path / "rover.toml").exists()
        assert rovers.load(tmp_path / "other.toml").wheels
        (tmp_path / "mine.toml").write_text("[wheel]\n")
        done = terrain_est_here("simulate", "-o", tmp_path / "x.csv", "--rover", tmp_path / "mine.toml")
        assert done.returncode == 73
        assert not (tmp_path / "x.csv").exists()


def test_standard_output(terrain_est, tmp_path):
    done = terrain_est("simulate", *SHORT, cwd=tmp_path)
    assert done.returncode == 0
    assert done.stdout.startswith("time,wheel,load,torque,sinkage,")
    assert len(done.stdout.splitlines()) == 401
    assert list(tmp_path.iterdir()) == []


def test_quiet(simulate):
    assert simulate(*SHORT, "--hide", "--quiet") == ""


def test_noise_of_the_command_line(simulate, tmp_path):
    args = (
        "--noise",
        "sinkage=1mm,dropouts=10%",
        "--noise",
        "torque=5%",
        "--noise",
        "load=0.5,quantum=2",
        "--rate",
        "50",
    )
    simulate(*args, "--truth", tmp_path / "truth.json")
    noise = json.loads((tmp_path / "truth.json").read_text("utf-8"))["noise"]
    assert noise == {
        "sinkage": {"white": {"share": 0.0, "absolute": 0.001}, "dropouts": 0.1},
        "torque": {"white": {"share": 0.05, "absolute": 0.0}},
        "load": {"white": {"share": 0.0, "absolute": 0.5}, "quantum": 2.0},
    }
    (samples,) = read(tmp_path, "run.csv")
    missing = np.isnan(samples.channels["sinkage"])
    assert np.mean(missing) == pytest.approx(0.1, abs=0.03)
    assert set(np.mod(samples.channels["load"], 2.0)) == {0.0}


@pytest.mark.parametrize(
    ("args", "code", "message"),
    [
        (["--noise", "3"], 2, "a share"),
        (["--noise", "torq=3%"], 2, "did you mean torque"),
        (["--noise", "torque=3mm"], 2, "no amount of torque"),
        (["--soil", "snw"], 2, "did you mean snow"),
        (["--drive", "slip-swep"], 2, "did you mean slip-sweep"),
        (["--drive", "fast"], 2, "--drive: must be one of slip-sweep, load-steps,"),
        (["--effect", "slip-snkage"], 2, "did you mean slip-sinkage"),
        (["--effect", "slip-sinkage:n1=x"], 2, "is no value"),
        (["--effect", "slip-sinkage:n9=1"], 2, "no parameter 'n9'"),
        (["--effect", "no.toml"], 66, "no.toml: no such file"),
        (["--wheels", "0"], 2, "from 1 to 20"),
        (["--rate", "slip=3"], 2, "--rate.slip: unknown key"),
        (["--truth", "-"], 2, "--truth"),
        (["no.toml"], 78, "no.toml: no such file"),
        (["--load", "1000"], 65, "dry-sand does not carry"),
        (["-o", "run.xls"], 73, "'.xls' is not known"),
        (["-o", "run.bag.gz"], 73, "cannot be written so"),
        (["-o", "no/run.csv"], 73, "no/run.csv: no such folder"),
        (["-o", "run.csv", "--truth", "no/t.json"], 73, "no/t.json: no such folder"),
    ],
)
def test_refused_in_one_line(args, code, message, terrain_est_here, tmp_path):
    done = terrain_est_here("simulate", *args, cwd=tmp_path)
    assert done.returncode == code, done.stderr
    assert message in done.stderr.splitlines()[0]
    assert done.stdout == ""
    assert list(tmp_path.iterdir()) == []
