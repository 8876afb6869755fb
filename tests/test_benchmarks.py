"""The benchmarks run, check what they compare, and tell slower from noisy."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest
from pages import ROOT
from simulator import paper

from benchmarks import criteria_study, flips_study, growth, harness, wheel_truth
from benchmarks.compare import judge
from benchmarks.stages import MISSING, STAGES
from terrain_cli.diagnosis import diagnosis_criteria


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    return tmp_path_factory.mktemp("inputs")


@pytest.fixture(autouse=True)
def folders(inputs, tmp_path, monkeypatch):
    monkeypatch.setenv("TERRAIN_EST_BENCH", str(inputs))
    monkeypatch.setattr(harness, "RESULTS", tmp_path / "results")
    # One round of each way: what it takes is no matter here.
    monkeypatch.setattr(harness, "SETTLED", 0.0)


def test_every_row_of_the_targets_has_a_stage():
    assert not MISSING
    for stage in STAGES.values():
        better = stage.aim < stage.least if stage.within else stage.aim > stage.least
        assert better, stage.name
    assert len(STAGES) == 20


#: As the paper prints it: kPa, degrees, m.
TABLE_II = {
    "exponent": (0.5, 1.2, 1.0),
    "friction_angle": (20.0, 40.0, np.pi / 180.0),
    "cohesion": (0.0, 10.0, 1e3),
    "cohesive_modulus": (10.0, 100.0, 1e3),
    "frictional_modulus": (1000.0, 5000.0, 1e3),
    "shear_modulus": (0.01, 0.03, 1.0),
}


def test_every_stage_is_found_from_the_root():
    """In a process of its own: here the folders of the tests are found whatever the stages do."""
    command = [sys.executable, "-m", "benchmarks", "none"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "cannot be measured" not in done.stderr
    assert "no such stage" in done.stderr


def test_the_soils_of_the_accuracy_study_are_those_of_the_paper():
    assert {
        name: pytest.approx((low * unit, high * unit)) for name, (low, high, unit) in TABLE_II.items()
    } == paper.TABLE_II
    assert (paper.WHEEL.radius, paper.WHEEL.width, paper.LOAD, paper.VARIATION) == (0.1, 0.1, 98.1, 0.15)
    assert [tuple(claim) for claim in paper.CLAIMS] == [
        (5, 0.0, 0.21, 1.62),
        (10, 0.1, 1.57, 4.12),
        (30, 0.1, 0.63, 2.11),
    ]
    soils = wheel_truth.table()
    assert len(soils.cohesion) == 15_625
    # kc/b + kφ, with b = 0.1 m.
    ends = [(0.0, 10e3), (np.tan(np.pi / 9), np.tan(np.pi / 4.5)), (0.01, 0.03), (1.1e6, 6e6), (0.5, 1.2)]
    assert [(column.min(), column.max()) for column in soils] == [pytest.approx(pair) for pair in ends]


def test_the_table_of_changed_bits_is_the_one_recorded():
    recorded = flips_study.RESULT.read_text(encoding="utf-8").splitlines()
    page = (flips_study.ROOT / "docs" / "damage.md").read_text(encoding="utf-8").splitlines()
    assert len(recorded) == 19
    assert {*recorded} <= {*page}


def test_changed_bits_are_sorted_by_what_becomes_of_them(tmp_path):
    found = flips_study.files(tmp_path)
    path = found["CSV"]
    digit, comma = path.read_bytes().rindex(b"8"), path.read_bytes().rindex(b",")
    flips = [(digit, 0), (comma, 5), (0, 0)]
    fates = flips_study.study(path, flips, salvage=False)
    assert fates["wrong"] == 1
    assert fates["renamed"] == 1
    assert fates["refused"] + fates["told"] == 1
    path = found["Parquet, checksums"]
    assert flips_study.study(path, [(path.stat().st_size - 1, 0)], salvage=False) == {"refused": 1}


#: Their peers take 8 s and more.
LONG = {"estimate bag", "segmentation 3,000", "scores of effects"}


@pytest.mark.parametrize("name", sorted(LONG))
def test_a_long_stage_can_be_run(name):
    assert STAGES[name].make("small", harness.inputs_folder()).ours() is not None


@pytest.mark.parametrize("name", [name for name in STAGES if name not in LONG])
def test_a_stage_checks_that_both_answers_are_equal(name):
    case = STAGES[name].make("small", harness.inputs_folder())
    assert case.check(case.ours(), case.peer and case.peer())


@pytest.mark.parametrize("name", ["csv", "help"])
def test_a_stage_is_measured_and_written_down(name):
    row = harness.measure(STAGES[name], "small", 1, memory=False)
    assert row["ratio"] > 0.0
    assert row["agreement"]
    text = harness.table([row])
    assert name in text
    harness.write("one", text, row)
    assert json.loads((harness.RESULTS / "one.json").read_text())["stage"] == name


@pytest.mark.parametrize("name", ["csv", "stresses x, y"])
def test_a_wrong_answer_is_no_result(name, monkeypatch):
    stage = STAGES[name]
    case = stage.make("small", harness.inputs_folder())
    peer = case.peer()

    def off(columns):
        return (
            {k: v * 1.001 for k, v in columns.items()}
            if isinstance(columns, dict)
            else [1.001 * v for v in columns]
        )

    with pytest.raises(AssertionError, match="differ by"):
        case.check(case.ours(), off(peer))


def test_peak_memory_is_that_of_the_stage_alone():
    ballast = np.ones(40_000_000)
    peak = harness.peak_memory("stresses x, y", "small", "ours")
    assert 30.0 < peak < 8e-6 * len(ballast)


@pytest.mark.parametrize(("factor", "verdict"), [(1.0, ""), (1.02, ""), (1.1, "slower"), (0.8, "faster")])
def test_slower_is_told_from_noise(factor, verdict):
    rng = np.random.default_rng(4)
    old = 0.1 * np.exp(0.02 * rng.standard_normal(15))
    new = factor * 0.1 * np.exp(0.02 * rng.standard_normal(15))
    found = judge(list(old), list(new))
    assert found["verdict"] == verdict
    assert found["low"] <= found["ratio"] <= found["high"]


def test_noise_alone_is_seldom_called_a_change():
    rng = np.random.default_rng(5)
    told = sum(
        judge(list(np.exp(0.1 * rng.standard_normal(9))), list(np.exp(0.1 * rng.standard_normal(9))))[
            "verdict"
        ]
        != ""
        for _ in range(200)
    )
    assert told <= 14  # 5 % would be 10; the sign test of nine pairs allows 3.9 %


def test_growth_tells_the_exponent(tmp_path):
    sizes = [10.0**k for k in range(3, 7)]
    rows = [
        {
            "size": n,
            "seconds": 1e-3 + 1e-7 * n**1.5,
            "processor_seconds": 1e-3 + 1e-7 * n**1.5,
            "peak_MB": 50.0,
        }
        for n in sizes
    ]
    result = {"stage": "made up", "unit": "rows", "sizes": rows, "exponent": growth._exponent(rows)}
    assert result["exponent"] == pytest.approx(1.5, abs=0.01)
    assert "1.50" in growth.table([result])
    growth.draw([result], tmp_path / "growth.png")
    assert (tmp_path / "growth.png").stat().st_size > 5_000


@pytest.mark.parametrize(
    ("value", "halved", "doubled"),
    [(8, 4, 16), (1, 1, 2), (0.01, 0.005, 0.02), (0.9, 0.95, 0.8), (1.5, 1.25, 2.0), (2.0, 1.0, 4.0)],
)
def test_criteria_are_moved_both_ways(value, halved, doubled):
    found = criteria_study.moved(value)
    assert found == pytest.approx([halved, doubled])
    assert [type(one) for one in found] == [type(value)] * 2


def test_a_moved_criterion_is_read_as_moved_and_comes_back():
    """On the drive of the study that takes least time, and without processes of its own."""
    (drive,) = criteria_study.drives(1)
    plain = criteria_study.run({**drive, "criterion": None})
    assert criteria_study.told(plain) == "none"
    assert {"LEVEL", "FEWEST_BLOCKS", "SMALLEST_FINDING"} <= {*plain["found"]["read"]}
    assert not {"BLOCKS_OF_CHANGE", "MOST_EFFECTS"} & {*plain["found"]["read"]}
    moved = criteria_study.run({**drive, "criterion": "LEVEL", "value": 0.02})
    assert (moved["found"]["level"], plain["found"]["level"]) == (0.02, 0.01)
    assert diagnosis_criteria.LEVEL == 0.01
    other = {**moved, "found": {**moved["found"], "verdict": "family", "family": ["slope", "side-slip"]}}
    runs = {"LEVEL": ([moved, other], 2), "GAINED": ([moved], 1), "NOISE": ([], 0), "TIED": ([moved], 2)}
    text = [*criteria_study.table([plain], runs)]
    assert "LEVEL 0.01 → 0.02: drive 2000: one of slope, side-slip" in text
    assert [line.partition(": ")[2] for line in text[-3:]] == ["GAINED", "NOISE", "TIED"]
