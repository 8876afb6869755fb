"""`estimate --posterior`: the joint posterior of c and φ, as data and as a picture."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import terrain_cli as terrain

SAMPLE = Path(__file__).parent.parent / "sample_data"
KEY = ["source", "wheel", "segment"]


@pytest.fixture
def estimate(terrain_est_here, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows = pd.read_csv(SAMPLE / "run.csv")
    rows[(rows["wheel"] == "front-left") & (rows["time"] < rows["time"].min() + 19.0)].to_csv(
        "run.csv", index=False
    )
    (tmp_path / "rover.toml").write_bytes((SAMPLE / "rover.toml").read_bytes())

    def run(*options):
        return terrain_est_here("estimate", "run.csv", "-o", "soil.csv", *options)

    return run


def moments(grid):
    """Return mean and deviation of c and φ, and their correlation, as anyone would."""
    weight = grid["probability"].to_numpy()
    c, phi = grid["c_kPa"].to_numpy(), grid["phi_deg"].to_numpy()
    spread = np.cov([c, phi], aweights=weight, ddof=0)
    c_se, phi_se = np.sqrt(np.diagonal(spread))
    return weight @ c, c_se, weight @ phi, phi_se, spread[0, 1] / c_se / phi_se


def test_the_grid_and_the_covariance_are_those_of_the_table(estimate):
    done = estimate("--posterior", "posterior.parquet", "--summary", "soil.json", "--plot", "pictures")
    assert done.returncode == 0, done.stderr
    picture = Path("pictures/valley.svg").read_text("utf-8")
    for words in ("cohesion c (kPa)", "friction angle φ (°)", "segment 1", "68 %", "95 %", "pivot stress"):
        assert words in picture
    table, posterior = pd.read_csv("soil.csv"), pd.read_parquet("posterior.parquet")
    (row,) = table.itertuples()
    assert row.status == "ok"
    grid = posterior[posterior["kind"] == "grid"]
    assert len(grid) == 41 * 41
    assert grid["probability"].sum() == pytest.approx(1.0)
    assert grid["log_posterior"].max() == 0.0
    square = grid.pivot_table(index="phi_deg", columns="strength_kPa", values="log_posterior")
    assert square.shape == (41, 41)
    assert square.notna().all(axis=None)
    c, c_se, phi, phi_se, corr = moments(grid)
    assert abs(c - row.c_kPa) < 0.05 * row.c_se_kPa
    assert abs(phi - row.phi_deg) < 0.05 * row.phi_se_deg
    assert c_se == pytest.approx(row.c_se_kPa, rel=0.08)
    assert phi_se == pytest.approx(row.phi_se_deg, rel=0.08)
    assert corr == pytest.approx(row.corr_c_phi, abs=0.05)

    pairs = posterior[posterior["kind"] == "parameter"]
    covariance = pairs.pivot_table(index="parameter", columns="other", values="covariance")
    assert covariance.shape == (8, 8)
    assert (np.linalg.eigvalsh(covariance / np.outer(*[np.sqrt(np.diagonal(covariance))] * 2)) > 0.0).all()
    own = pairs[pairs["parameter"] == pairs["other"]].set_index("parameter")
    assert own.loc["cohesion", "se"] == pytest.approx(1e3 * row.c_se_kPa)
    assert own.loc["cohesion", "prior_sd"] == 5000.0
    # Of k, in metres, the median and the standard error of it: within a factor of two.
    assert own.loc["shear_modulus", "prior"] == pytest.approx(0.018)
    assert own.loc["shear_modulus", "prior_sd"] == pytest.approx(0.018 * np.log(2.0))
    both = pairs[(pairs["parameter"] == "cohesion") & (pairs["other"] == "tan_phi")]
    assert both["correlation"].item() == pytest.approx(row.corr_c_phi)
    (segment,) = json.loads(Path("soil.json").read_text("utf-8"))["inputs"][0]["wheels"][0]["model"][
        "segments"
    ]
    assert own.loc["shear_modulus", "value"] == pytest.approx(1e-3 * segment["k_mm"])
    assert own.loc["rear-contact.c3", "se"] == pytest.approx(segment["rear-contact.c3_se"])


@pytest.mark.parametrize("options", [("--model", "linear"), ("--method", "recursive"), ("--method", "ridge")])
def test_of_a_line_it_is_the_normal_distribution_of_the_table(estimate, options):
    assert estimate("--posterior", "posterior.csv", *options).returncode == 0
    table, posterior = pd.read_csv("soil.csv"), pd.read_csv("posterior.csv")
    for row in table.itertuples():
        part = posterior[posterior["segment"] == row.segment]
        c, c_se, phi, phi_se, _ = moments(part[part["kind"] == "grid"])
        assert c == pytest.approx(row.c_kPa, abs=0.01 * row.c_se_kPa)
        assert c_se == pytest.approx(row.c_se_kPa, rel=0.01)
        # Normal is tan φ, not φ.
        assert phi == pytest.approx(row.phi_deg, abs=0.2 * row.phi_se_deg)
        assert phi_se == pytest.approx(row.phi_se_deg, rel=0.1)
        assert len(part[part["kind"] == "parameter"]) == 4


def test_what_holds_phi_leaves_the_covariance_alone(estimate):
    Path("model.toml").write_text(
        'format = "terrain-est/model/1"\nbase = "wong-reece"\n[fixed]\ntan_phi = 0.53\n', "utf-8"
    )
    assert estimate("--posterior", "posterior.csv", "--model", "model.toml").returncode == 0
    posterior = pd.read_csv("posterior.csv")
    assert set(posterior["kind"]) == {"parameter"}
    assert "tan_phi" not in set(posterior["parameter"])


def test_a_notebook_gets_the_same(estimate):
    assert estimate("--posterior", "posterior.csv", "--model", "linear").returncode == 0
    (wheel,) = terrain.read("run.csv")
    found = terrain.posterior(terrain.segment(wheel), model="linear")
    written = pd.read_csv("posterior.csv")
    assert list(found) == list(written)
    np.testing.assert_allclose(found["log_posterior"], written["log_posterior"])


@pytest.mark.parametrize(
    ("name", "code"), [("run.csv", 2), ("soil.csv", 2), ("posterior.txt", 73), ("none/posterior.csv", 73)]
)
def test_where_it_cannot_go(estimate, name, code):
    before = Path("run.csv").read_bytes()
    done = estimate("--posterior", name, "--model", "linear")
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert Path("run.csv").read_bytes() == before
