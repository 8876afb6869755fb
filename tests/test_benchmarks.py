"""The benchmarks run, check what they compare, and tell slower from noisy."""

from __future__ import annotations

import json

import numpy as np
import pytest

from benchmarks import growth, harness
from benchmarks.compare import judge
from benchmarks.stages import MISSING, STAGES


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


#: Their peers take 8 s and more.
LONG = {"estimate bag", "segmentation 3,000", "scores of effects"}


@pytest.mark.parametrize("name", sorted(LONG))
def test_a_long_stage_can_be_run(name):
    assert STAGES[name].make("small", harness.inputs_folder()).ours() is not None


@pytest.mark.parametrize("name", [name for name in STAGES if name not in LONG])
def test_a_stage_checks_that_both_answers_are_equal(name):
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
