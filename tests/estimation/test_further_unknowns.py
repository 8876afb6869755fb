"""A stated error of a sensor or of the wheel is an unknown of the full model, and an error of the line."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from wheel_samples import WHEEL, free

import terrain_cli as terrain
from terrain_cli.estimation import estimators

WINDOWS, SAMPLES, OFFSET, GAIN = 12, 60, 0.04, 0.15
#: Of the radius and the width of rover.toml, as shares: the wheel is smaller than it says.
WRONG = 0.05


@pytest.fixture(scope="module")
def truth():
    return free(WINDOWS, SAMPLES, 11)


@pytest.fixture(scope="module")
def off(truth, tmp_path_factory):
    """Return how many standard errors c and φ are off, and the errors, with some rows of [noise]."""
    labels = np.repeat([f"soil {j:02d}" for j in range(WINDOWS)], SAMPLES)
    time = np.arange(WINDOWS * SAMPLES) / 10.0
    right = truth.measured(3, 0.01) | {"time": time, "terrain": labels}
    tables = {
        "slip": pd.DataFrame(right | {"slip": right["slip"] + OFFSET}),
        "load": pd.DataFrame(right | {"load": right["load"] * (1.0 + GAIN)}),
    }
    folder = tmp_path_factory.mktemp("offset")

    def estimate(noise, method, wrong="slip"):
        (folder / "rover.toml").write_text(
            f"[wheel]\nradius = {WHEEL.radius}\nwidth = {WHEEL.width}\n"
            f"[soil]\nshear_modulus = 0.02\n[noise]\n{noise}\n"
        )
        (samples,) = terrain.from_frame(tables[wrong], folder / "rover.toml")
        windows = terrain.segment(samples, "terrain")
        found = terrain.estimate(windows, method)
        c = (found["c_kPa"] - truth.cohesion / 1e3) / found["c_se_kPa"]
        phi = (found["phi_deg"] - np.degrees(truth.phi)) / found["phi_se_deg"]
        return c, phi, found["phi_se_deg"], windows

    return estimate


@pytest.mark.parametrize(
    ("wrong", "stated"),
    [("slip", f"slip = {{ offset = {OFFSET} }}"), ("load", f"load = {{ gain = {GAIN} }}")],
)
def test_the_errors_of_the_full_model_hold_with_it(off, wrong, stated):
    c, phi, *_ = off("", "auto", wrong)
    unsaid = np.mean((np.abs(c) < 2.0) & (np.abs(phi) < 2.0))
    c, phi, *_ = off(stated, "auto", wrong)
    said = np.mean((np.abs(c) < 2.0) & (np.abs(phi) < 2.0))
    assert unsaid < 0.6
    assert said >= 0.75


@pytest.mark.parametrize("load", ["offset = 10, unit = 'N'", "gain = 0.1"])
@pytest.mark.parametrize("method", ["least-squares", "ridge", "recursive"])
def test_it_widens_the_errors_of_the_line(off, method, load):
    *_, narrow, _ = off("", method)
    *_, wide, _ = off(f"slip = {{ offset = {OFFSET} }}\nload = {{ {load} }}", method)
    assert (wide > narrow).all()


@pytest.fixture(scope="module")
def of_another_wheel(truth, tmp_path_factory):
    """Return how many standard errors c and φ are off where rover.toml has a larger wheel, and the errors."""
    folder, time = tmp_path_factory.mktemp("wheel"), np.arange(WINDOWS * SAMPLES) / 10.0
    labels = np.repeat([f"soil {j:02d}" for j in range(WINDOWS)], SAMPLES)
    right = truth.measured(4, 0.01) | {"time": time, "terrain": labels}
    speed = {"velocity": WHEEL.radius * (1.0 - right["slip"]), "angular_velocity": np.ones(len(time))}
    tables = {"recorded": pd.DataFrame(right), "derived": pd.DataFrame(right | speed).drop(columns="slip")}

    def estimate(slip, method, **errors):
        sizes = {"radius": WHEEL.radius * (1.0 + WRONG), "width": WHEEL.width * (1.0 + WRONG)}
        told = {
            name: f"{{ value = {size}, error = {errors[name] * size} }}" if name in errors else size
            for name, size in sizes.items()
        }
        (folder / "rover.toml").write_text(
            f"[wheel]\nradius = {told['radius']}\nwidth = {told['width']}\n[soil]\nshear_modulus = 0.02\n"
        )
        (samples,) = terrain.from_frame(tables[slip], folder / "rover.toml")
        found = terrain.estimate(terrain.segment(samples, "terrain"), method)
        c = (found["c_kPa"] - truth.cohesion / 1e3) / found["c_se_kPa"]
        phi = (found["phi_deg"] - np.degrees(truth.phi)) / found["phi_se_deg"]
        return np.abs(c), np.abs(phi), found[["c_se_kPa", "phi_se_deg"]]

    return estimate


@pytest.mark.parametrize("slip", ["recorded", "derived"])
def test_errors_of_the_full_model_hold_with_a_wrong_wheel_of_stated_error(of_another_wheel, slip):
    c, phi, _ = of_another_wheel(slip, "auto")
    assert np.mean((c < 2.0) & (phi < 2.0)) < 0.75
    c, phi, _ = of_another_wheel(slip, "auto", radius=WRONG, width=WRONG)
    assert np.mean((c < 2.0) & (phi < 2.0)) >= 0.75


@pytest.mark.parametrize("method", ["least-squares", "ridge", "recursive"])
@pytest.mark.parametrize("size", ["radius", "width"])
def test_a_stated_error_of_the_wheel_widens_the_errors_of_the_line(of_another_wheel, method, size):
    *_, narrow = of_another_wheel("recorded", method)
    *_, wide = of_another_wheel("recorded", method, **{size: WRONG})
    assert (wide["c_se_kPa"] > narrow["c_se_kPa"]).all()
    if size == "width":
        # All stresses have one factor, which is in no slope.
        assert wide["phi_se_deg"].to_numpy() == pytest.approx(narrow["phi_se_deg"].to_numpy(), rel=1e-6)


def test_noise_is_learnt_where_only_an_offset_is_stated(off):
    *_, windows = off(f"slip = {{ offset = {OFFSET} }}", "auto")
    model = estimators.estimate(windows, file=estimators.full_model()).account
    assert not any(entry["given"] for entry in model["noise"].values())
    assert all("slip-offset.offset" in segment for segment in model["segments"])


def test_errors_allow_for_an_effect_that_data_did_not_tell_from_the_models(truth, tmp_path):
    right = truth.measured(5, 0.01) | {"time": np.arange(WINDOWS * SAMPLES) / 10.0}
    labels = np.repeat([f"soil {j:02d}" for j in range(WINDOWS)], SAMPLES)
    frame = pd.DataFrame(right | {"load": right["load"] * (1.0 + GAIN), "terrain": labels})
    (tmp_path / "rover.toml").write_text(
        f"[wheel]\nradius = {WHEEL.radius}\nwidth = {WHEEL.width}\n[soil]\nshear_modulus = 0.02\n"
    )
    model = tmp_path / "model.toml"
    written = 'format = "terrain-est/model/1"\nbase = "wong-reece"\neffects = ["gear-efficiency"]\n'
    doubt = '[[history]]\naction = "add"\nchanged = ["gear-efficiency"]\nrivals = ["load-bias", "slope"]\n'
    (samples,) = terrain.from_frame(frame, tmp_path / "rover.toml")
    windows = terrain.segment(samples, "terrain")

    def off(history):
        model.write_text(written + history)
        found = terrain.estimate(windows, model=model)
        return np.abs(found["c_kPa"] - truth.cohesion / 1e3) / found["c_se_kPa"]

    assert off("").max() > 4.0
    assert off(doubt).max() < 2.0
    found = estimators.estimate(windows, file=terrain.load_model(model)).account
    # The pitch was not measured, without which a slope has no part in any sample.
    assert found["rivals"] == ["load-bias"]
    assert found["parameters"]["load-bias.gain"]["value"] == pytest.approx(1.0 + GAIN, abs=0.05)
