"""`terrain-est estimate` with the full model and with model files, on logs of the simulator.

The simulator integrates its own equations adaptively, one sample at a time; with the contact of
the base, θm = θ1/2, the truth is in the model.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from io import StringIO

import numpy as np
import pandas as pd
import pytest
from simulator import (
    CHANNELS,
    DRY_SAND,
    UPLAND_SANDY_LOAM,
    Drive,
    Sensor,
    Track,
    simulate,
    steps,
    undulation,
    wave,
)
from simulator.effects import base_contact
from simulator.logs import write_csv, write_parquet, write_ros1, write_ros2

import terrain_cli as terrain
from terrain_cli.errors import UsageError

ROVER = """\
[wheel]
radius = 0.125
width = 0.1
[soil]
shear_modulus = 0.025      # 0.018 in truth
[channels]
torque = { topic = "/joint_states", field = "effort", unit = "N m" }
sinkage = { topic = "/wheel/sinkage", field = "data", unit = "m" }
"""
SOILS = [base_contact(DRY_SAND), base_contact(UPLAND_SANDY_LOAM)]
NOISE = 0.01
EFFECTS = {"slip-sinkage": {"n1": 0.4}, "drivetrain-friction": {"Tc": 0.5, "Bv": 0.0}}
MODEL = 'format = "terrain-est/model/1"\nbase = "wong-reece"\n'
FITTED = ("--segments", "terrain", "--model", "model.toml", "--summary", "s.json")


def drive(effects=(), seed=1, seconds=15.0):
    track = Track(
        "wheel",
        [(soil, seconds) for soil in SOILS],
        load=undulation(80.0, 0.3, 6.0, seed=3),
        slip=wave(0.35, 0.7, 7.0),
    )
    noisy = ("load", "torque", "sinkage", "slip", "drawbar_pull")
    return Drive(
        [track],
        rate=10.0,
        sensors={channel: Sensor(relative=NOISE) for channel in noisy},
        channels=(*CHANNELS, "slip", "drawbar_pull"),
        effects={name: EFFECTS[name] for name in effects},
        speed=steps([(0.1, seconds / 2.0), (0.15, seconds)]),
        seed=seed,
    )


@pytest.fixture(scope="module")
def plain():
    return simulate(drive())


@pytest.fixture(scope="module")
def affected():
    return simulate(drive(EFFECTS))


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rover.toml").write_text(ROVER, "utf-8")
    return tmp_path


def table(done):
    assert done.returncode == 0, done.stderr
    return pd.read_csv(StringIO(done.stdout))


def summary(path="s.json"):
    with open(path, encoding="utf-8") as file:  # noqa: PTH123
        return json.load(file)


def by_wheel(document):
    return document["inputs"][0]["wheels"][0]["model"]


def test_the_full_model_is_closer_to_the_truth_than_the_line(terrain_est_here, here, plain):
    write_csv(plain, here / "run.csv", terrain=True)
    options = ("--segments", "terrain", "--method", "wong-reece", "--summary", "s.json")
    rows = table(terrain_est_here("estimate", "run.csv", *options))
    assert rows["method"].tolist() == ["wong-reece"] * 2
    assert rows["status"].tolist() == ["ok"] * 2
    for row, soil in zip(rows.itertuples(), SOILS, strict=True):
        c, phi = soil.cohesion / 1e3, math.degrees(soil.friction_angle)
        assert abs(row.c_kPa - c) < 3.0 * row.c_se_kPa
        assert abs(row.phi_deg - phi) < 3.0 * row.phi_se_deg
        assert abs(row.c_kPa - c) < abs(row.c_ls_kPa - c)
        assert abs(row.phi_deg - phi) < abs(row.phi_ls_deg - phi)
        assert row.k_mm == pytest.approx(18.0, rel=0.2)
        strength = soil.strength(row.sigma_star_kPa * 1e3) / 1e3
        assert abs(row.strength_kPa - strength) < 3.0 * row.strength_se_kPa
        # What the noise of load, sinkage and slip does to the torque included.
        assert row.torque_rmse_Nm < 0.2

    document = summary()
    assert (document["settings"]["method"], document["settings"]["model"]) == ("wong-reece", None)
    model = by_wheel(document)
    assert (model["base"], model["effects"], model["parameters"]) == (
        "wong-reece",
        ["max-stress-angle", "rear-contact"],
        {},
    )
    for entry, soil in zip(document["terrains"], SOILS, strict=True):
        assert entry["terrain"] == soil.name
        assert entry["k_mm"]["mean"] == pytest.approx(18.0, rel=0.2)
        assert entry["n"]["mean"] == pytest.approx(soil.exponent, abs=0.1)
        assert entry["keq_kPa_per_m_n"]["mean"] == pytest.approx(soil.stiffness(0.1) / 1e3, rel=0.5)


def test_parameters_of_effects_are_recovered(terrain_est_here, here, affected):
    write_csv(affected, here / "run.csv", terrain=True)
    new = ("--effect", "slip-sinkage", "--effect", "drivetrain-friction")
    assert terrain_est_here("model", "new", "model.toml", *new).returncode == 0
    done = terrain_est_here("estimate", "run.csv", *FITTED)
    rows = table(done)
    model = by_wheel(summary())
    # The shape of the contact is sought whatever the effects.
    assert model["effects"] == ["slip-sinkage", "drivetrain-friction", "max-stress-angle", "rear-contact"]
    assert summary()["settings"]["model"] == "model.toml"
    for name, truth in (
        ("slip-sinkage.n1", 0.4),
        ("drivetrain-friction.Tc", 0.5),
        ("drivetrain-friction.Bv", 0.0),
    ):
        entry = model["parameters"][name]
        assert abs(entry["value"] - truth) < 3.0 * entry["se"]
        assert name in done.stderr
    assert model["parameters"]["slip-sinkage.n1"]["fixed_by_data"]
    assert model["parameters"]["slip-sinkage.n1"]["unit"] == "1"
    for row, soil in zip(rows.itertuples(), SOILS, strict=True):
        assert abs(row.c_kPa - soil.cohesion / 1e3) < 3.0 * row.c_se_kPa
        assert abs(row.phi_deg - math.degrees(soil.friction_angle)) < 3.0 * row.phi_se_deg


def test_it_is_told_of_which_speed_c_and_phi_are(terrain_est_here, here, plain):
    write_csv(plain, here / "run.csv", terrain=True)
    new = ("--effect", "rate-dependence", "--effect", "drivetrain-friction")
    assert terrain_est_here("model", "new", "model.toml", *new).returncode == 0
    told = terrain_est_here("estimate", "run.csv", *FITTED).stderr
    law = "τ = τ0 (1 + β ln(V/V0)), V0 = 0.1 m/s: c and tan φ both by that factor"
    assert f"c and φ are as in the law of rate-dependence: {law}\n" in told
    # Friction of the drive leaves the strength as it is.
    assert by_wheel(summary())["strength"] == {"rate-dependence": law}


def test_held_parameters_are_as_they_were_given(terrain_est_here, here, affected):
    write_csv(affected, here / "run.csv", terrain=True)
    (here / "model.toml").write_text(
        MODEL + 'effects = ["slip-sinkage", "drivetrain-friction"]\nshared = ["sinkage_exponent"]\n'
        "[fixed]\nshear_modulus = 0.018\nslip-sinkage.n1 = 0.4\n",
        "utf-8",
    )
    rows = table(terrain_est_here("estimate", "run.csv", *FITTED))
    np.testing.assert_allclose(rows["k_mm"], 18.0)
    parameters = by_wheel(summary())["parameters"]
    assert parameters["slip-sinkage.n1"] == {
        "value": 0.4, "se": None, "unit": "1", "held": True, "because": None, "fixed_by_data": None,
    }  # fmt: skip
    assert parameters["sinkage_exponent"]["value"] == pytest.approx(SOILS[0].exponent, abs=0.2)


FORMATS = [(write_csv, "r.csv"), (write_parquet, "r.parquet"), (write_ros1, "r.bag"), (write_ros2, "r.mcap")]


def test_every_format_gives_one_answer(terrain_est_here, here, affected):
    (here / "model.toml").write_text(MODEL + 'effects = ["drivetrain-friction"]\n', "utf-8")
    answers = []
    for write, name in FORMATS:
        write(affected, here / name)
        options = ("--model", "model.toml", "--segments", "none", "--where", "time < 15", "--quiet")
        answers.append(table(terrain_est_here("estimate", name, *options)))
    csv, parquet, ros1, ros2 = answers
    # Bags have no channel for the slip, and derive it.
    for one, other in ((csv, parquet), (ros1, ros2)):
        for name in ("c_kPa", "phi_deg", "k_mm", "strength_kPa"):
            np.testing.assert_allclose(one[name], other[name], rtol=1e-6)
    assert abs(csv["strength_kPa"] - ros1["strength_kPa"])[0] < csv["strength_se_kPa"][0]


def test_an_effect_of_the_user(terrain_est_here, here, affected):
    write_csv(affected, here / "run.csv", terrain=True)
    (here / "drag.toml").write_text(
        """
        id = "constant-drag"
        title = "A seal rubs on the axle"
        changes = "torque"
        law = "torque + drag * tanh(angular_velocity / w0)"
        needs = ["angular_velocity"]
        [parameters.drag]
        unit = "N cm"
        null = 0.0
        scale = 10.0
        [parameters.w0]
        unit = "rad/s"
        null = 0.01
        scale = 0.01
        lower = 0.001
        """,
        "utf-8",
    )
    (here / "model.toml").write_text(
        MODEL + 'effects = ["slip-sinkage", "drag.toml"]\n[fixed]\nconstant-drag.w0 = 0.01\n', "utf-8"
    )
    table(terrain_est_here("estimate", "run.csv", *FITTED))
    drag = by_wheel(summary())["parameters"]["constant-drag.drag"]
    assert drag["unit"] == "N cm"
    assert abs(drag["value"] - 50.0) < 3.0 * drag["se"] < 75.0


def test_what_a_parameter_needs_may_be_missing(terrain_est_here, here):
    # Steady test points, whose slip is known and whose speed is not.
    channels = ("load", "torque", "sinkage", "slip")
    columns = simulate(replace(drive(EFFECTS), channels=channels)).columns(terrain=True)
    pd.DataFrame(columns).drop(columns=["time", "wheel"]).to_csv(here / "bench.csv", index=False)
    new = ("--effect", "slip-sinkage", "--effect", "drivetrain-friction")
    assert terrain_est_here("model", "new", "model.toml", *new).returncode == 0
    done = terrain_est_here("estimate", "bench.csv", "--model", "model.toml", "--summary", "s.json")
    rows = table(done)
    assert rows["terrain"].tolist() == sorted(soil.name for soil in SOILS)
    parameters = by_wheel(summary())["parameters"]
    assert parameters["drivetrain-friction.Bv"] == {
        "value": 0.0,
        "se": None,
        "unit": "N m s/rad",
        "held": True,
        "because": "angular_velocity not measured",
        "fixed_by_data": None,
    }
    assert "drivetrain-friction.Bv = 0 N m s/rad, held: angular_velocity not measured" in done.stderr
    assert abs(parameters["slip-sinkage.n1"]["value"] - 0.4) < 3.0 * parameters["slip-sinkage.n1"]["se"]


def test_each_wheel_and_input_is_fitted_on_its_own(terrain_est_here, here, plain, affected):
    write_csv(plain, here / "a.csv", terrain=True)
    write_csv(affected, here / "b.csv", terrain=True)
    # One drive hardly tells n1 from S.
    held = 'effects = ["slip-sinkage"]\n[fixed]\n"slip-sinkage.S" = 0.0\n'
    (here / "model.toml").write_text(MODEL + held, "utf-8")
    options = ("--segments", "terrain", "--model", "model.toml", "--quiet")
    both = table(
        terrain_est_here("estimate", "a.csv", "b.csv", "--jobs", "2", *options, "--summary", "s.json")
    )
    alone = [table(terrain_est_here("estimate", name, *options)) for name in ("a.csv", "b.csv")]
    pd.testing.assert_frame_equal(both, pd.concat(alone, ignore_index=True))
    models = [entry["wheels"][0]["model"] for entry in summary()["inputs"]]
    assert [m["parameters"]["slip-sinkage.n1"]["value"] for m in models] == pytest.approx([0.0, 0.4], abs=0.1)


def test_effects_on_the_linear_base(terrain_est_here, here, affected):
    write_csv(affected, here / "run.csv", terrain=True)
    (here / "model.toml").write_text(
        MODEL.replace("wong-reece", "linear") + 'effects = ["drivetrain-friction"]\n', "utf-8"
    )
    rows = table(terrain_est_here("estimate", "run.csv", *FITTED))
    assert rows["method"].tolist() == ["linear"] * 2
    # k is assumed, as the other estimators of the linear model do.
    np.testing.assert_allclose(rows["k_mm"], 25.0)
    assert set(by_wheel(summary())["parameters"]) == {"drivetrain-friction.Tc", "drivetrain-friction.Bv"}


def test_the_linear_model_is_the_line(terrain_est_here, here, plain):
    write_csv(plain, here / "run.csv")
    line = terrain_est_here("estimate", "run.csv", "--quiet", "--model", "linear")
    assert line.returncode == 0
    assert set(table(line)["method"]) <= {"least-squares", "ridge"}
    (here / "line.toml").write_text(MODEL.replace("wong-reece", "linear"), "utf-8")
    assert terrain_est_here("estimate", "run.csv", "--quiet", "--model", "line.toml").stdout == line.stdout
    assert terrain_est_here("estimate", "run.csv", "--quiet").stdout != line.stdout


def test_model_and_method_say_the_same(terrain_est_here, here, plain):
    write_csv(plain, here / "run.csv")
    options = ("estimate", "run.csv", "--quiet", "--segments", "none")
    default = terrain_est_here(*options)
    assert default.returncode == 0, default.stderr
    assert terrain_est_here(*options, "--method", "wong-reece").stdout == default.stdout
    base = terrain_est_here(*options, "--model", "wong-reece")
    assert base.stdout == default.stdout
    (here / "rover.toml").write_text(ROVER + '[estimate]\nmodel = "full.toml"\n', "utf-8")
    (here / "full.toml").write_text(MODEL, "utf-8")
    assert terrain_est_here(*options).stdout == base.stdout
    assert terrain_est_here(*options, env={"TERRAIN_EST_MODEL": "linear"}).stdout != base.stdout


def test_known_noise_is_used(terrain_est_here, here, plain):
    write_csv(plain, here / "run.csv", terrain=True)
    given = "".join(f"{name} = {{ relative = 0.01 }}\n" for name in ("load", "torque", "sinkage", "slip"))
    (here / "rover.toml").write_text(ROVER + f"[noise]\n{given}", "utf-8")
    options = ("estimate", "run.csv", *FITTED[:2], "--method", "wong-reece", *FITTED[4:])
    table(terrain_est_here(*options))
    noise = by_wheel(summary())["noise"]
    assert noise["torque"] == {"relative": 0.01, "absolute": 0.0, "unit": "N m", "given": True}
    assert not noise["drawbar_pull"]["given"]
    (here / "rover.toml").write_text(ROVER, "utf-8")
    table(terrain_est_here(*options))
    noise = by_wheel(summary())["noise"]
    assert not noise["torque"]["given"]
    assert noise["torque"]["relative"] == pytest.approx(NOISE, rel=0.5)


def test_wild_samples_do_little_harm(terrain_est_here, here):
    sensors = {**drive().sensors, "torque": Sensor(relative=NOISE, outliers=0.05, outlier_size=3.0)}
    write_csv(simulate(replace(drive(), sensors=sensors)), here / "run.csv", terrain=True)
    options = ("estimate", "run.csv", "--segments", "terrain", "--method", "wong-reece", "--quiet")
    truth = [math.degrees(soil.friction_angle) for soil in SOILS]
    # Without --robust the torque is learnt to be noisy, and says less: both ways hold.
    for robust in (False, True):
        rows = table(terrain_est_here(*options, *["--robust"] * robust))
        off = np.abs(rows["phi_deg"] - truth)
        assert off.max() < 1.0
        assert np.all(off < 4.0 * rows["phi_se_deg"])


def test_few_samples_are_told(terrain_est_here, here, plain):
    write_csv(plain, here / "run.csv")
    options = ["--method", "wong-reece", "--segments", "fixed", "--window-samples", "4", "--where"]
    rows = table(terrain_est_here("estimate", "run.csv", *options, "time < 2"))
    assert set(rows["status"]) == {"too-few-samples"}


def test_in_a_notebook(here, plain):
    write_csv(plain, here / "run.csv", terrain=True)
    (here / "model.toml").write_text(MODEL + 'effects = ["drivetrain-friction"]\n', "utf-8")
    model = terrain.load_model("model.toml")
    (wheel,) = terrain.read("run.csv", model=model)
    cut = terrain.segment(wheel, "terrain")
    rows = terrain.estimate(cut, model=model)
    assert rows["method"].tolist() == ["wong-reece"] * 2
    again = terrain.estimate(cut, "wong-reece", model="model.toml")
    pd.testing.assert_frame_equal(again, rows)
    with pytest.raises(UsageError, match="estimator of the line"):
        terrain.estimate(cut, "ridge", model=model)
    (entry, _) = terrain.summarise(cut, model=model)
    assert entry["k_mm"]["mean"] == pytest.approx(18.0, rel=0.2)


def test_strengths_are_compared_at_the_stress_that_is_asked_for(terrain_est_here, here, plain):
    write_csv(plain, here / "run.csv", terrain=True)
    options = ("estimate", "run.csv", "--segments", "terrain")
    rows = table(terrain_est_here(*options, "--at-stress", "7"))
    (here / "rover.toml").write_text(ROVER + "[estimate]\nat-stress = 7\n", "utf-8")
    pd.testing.assert_frame_equal(table(terrain_est_here(*options)), rows)
    assert set(rows["stress_kPa"]) == {7.0}
    for row, soil in zip(rows.itertuples(), SOILS, strict=True):
        off = row.strength_at_stress_kPa - soil.strength(7e3) / 1e3
        assert abs(off) < 3.0 * row.strength_at_stress_se_kPa
    done = terrain_est_here(*options, "--at-stress", "-1")
    assert done.returncode == 2


def test_what_the_data_do_not_tell_is_left_empty(terrain_est_here, here, plain):
    # Two soils taken for one: what is left is so large that the data tell less than was known beforehand.
    write_csv(plain, here / "run.csv")
    done = terrain_est_here("estimate", "run.csv", "--segments", "none")
    (row,) = table(done).itertuples()
    assert row.status == "prior-bound"
    assert math.isnan(row.phi_deg)
    assert math.isnan(row.phi_se_deg)
    assert 0.0 < row.strength_kPa < 15.0
    assert "prior-bound: the data do not determine c or φ (left empty)" in done.stderr


def test_who_is_sent_to_a_diagnosis_can_paste_the_command(terrain_est_here, here, affected):
    """With the inputs, the model and the cutting: a diagnosis of another model names what that one has."""
    write_csv(affected, here / "run.csv", terrain=True)
    (here / "model.toml").write_text(MODEL + 'effects = ["drivetrain-friction"]\n', "utf-8")
    cut = ("--segments", "terrain")
    done = terrain_est_here("estimate", "run.csv", *cut, "--model", "model.toml")
    assert set(table(done)["status"]) & {"model-misses", "at-bound"}
    command = "terrain-est diagnose run.csv --model model.toml --segments terrain"
    assert done.stderr.splitlines()[-1] == f"Next: {command}"
    told = terrain_est_here(*command.split()[1:])
    assert told.returncode == 0
    (here / "model.toml").write_text(MODEL + 'effects = ["drivetrain-friction", "slip-sinkage"]\n', "utf-8")
    assert "Next" not in terrain_est_here("estimate", "run.csv", *cut, "--model", "model.toml").stderr
