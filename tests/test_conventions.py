"""The reference pages name every channel, unit and key; their rover.toml has every key."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pages
import pytest
from own_effects import CABLE

from terrain_cli import models, rover
from terrain_cli.errors import ConfigurationError
from terrain_cli.estimation.wheel_fit import DEFAULT
from terrain_cli.models.model_file import SOIL_UNITS
from terrain_cli.vocabulary import choices, units
from terrain_cli.vocabulary.channels import CHANNELS

ROOT = Path(__file__).resolve().parent.parent
PAGE = pages.text_of("conventions.md")
MODEL_PAGE = pages.text_of("wheel-model.md")
FILE_PAGE = pages.text_of("model.md").partition("## The model file")[2]
EXAMPLE = re.search(r"```toml\n(.*?)```", pages.text_of("rover.md"), re.DOTALL)[1]


def table(heading, page=PAGE):
    return page.partition(heading)[2].partition("\n\n")[0]


def known_keys(tmp_path, header):
    """Return the keys that a table of rover.toml knows, as the program says them."""
    path = tmp_path / "rover.toml"
    path.write_text(f"{header}\nno_such_key = 1\n")
    with pytest.raises(ConfigurationError) as error:
        rover.load(path)
    return set(error.value.hint.removeprefix("known here: ").split(", "))


@pytest.mark.parametrize("channel", CHANNELS.values(), ids=lambda channel: channel.name)
def test_channel_has_its_symbol_and_unit(channel):
    (row,) = (row for row in table("| channel |").splitlines() if f"`{channel.name}`" in row)
    _, _, symbols, units_, *_ = (cell.strip() for cell in row.split("|"))
    assert (channel.unit.symbol if channel.unit else "label") in units_.split(", ")
    assert channel.symbol in symbols.split(", ") or not channel.symbol


def test_every_unit_of_a_channel_is_named():
    named = PAGE.partition("Units: ")[2].partition("Anything else")[0]
    for dimension in {channel.dimension for channel in CHANNELS.values()} - {"label", "coordinate"}:
        assert re.search(rf"{dimension} {re.escape(', '.join(units.symbols(dimension)))}[;.]", named)


def test_example_of_rover_toml_loads(tmp_path):
    (tmp_path / "rover.toml").write_text(EXAMPLE, "utf-8")
    loaded = rover.load(tmp_path / "rover.toml")
    assert loaded.wheel("front-left").radius == 0.130
    assert loaded.wheel("front-left").width == 0.100


@pytest.mark.parametrize("name", ["", "wheel", "soil", "motor", "vehicle", "sampling", "noise", "estimate"])
def test_example_has_every_key(name, tmp_path):
    content = tomllib.loads(EXAMPLE)
    shown = content[name] if name else content
    assert shown.keys() == known_keys(tmp_path, f"[{name}]" if name else "")


def test_example_has_every_key_of_a_wheel_and_of_a_channel(tmp_path):
    content = tomllib.loads(EXAMPLE)
    wheel = content["wheels"]["front-left"].keys() | content["wheel"].keys()
    assert wheel == known_keys(tmp_path, "[wheels.front-left]")
    entries = [entry for entry in content["channels"].values() if isinstance(entry, dict)]
    assert set().union(*entries) == known_keys(tmp_path, "[channels.torque]")


def test_example_has_every_key_of_a_noise(tmp_path):
    entries = tomllib.loads(EXAMPLE)["noise"].values()
    assert set().union(*entries) == known_keys(tmp_path, "[noise.torque]")


def test_example_of_a_model_file_loads(tmp_path):
    text = re.search(r"```\n(format = .*?)```", FILE_PAGE, re.DOTALL)[1]
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "cable-drag.toml").write_text(CABLE, "utf-8")
    (tmp_path / "model.toml").write_text(text, "utf-8")
    file = models.load(tmp_path / "model.toml")
    assert file.fixed == {"sinkage_exponent": 1.1, "slip-sinkage.n1": 0.4}
    assert tomllib.loads(text).keys() == {
        "format", "base", "effects", "shared", "fixed", "priors", "history",
    }  # fmt: skip


def test_parameters_of_the_soil_have_their_units():
    rows = re.findall(
        r"^\| \S.* \| `(\w+)` \| (\S+) \|", table("| symbol | parameter |", MODEL_PAGE), re.MULTILINE
    )
    assert dict(rows) == SOIL_UNITS


def test_priors_are_those_of_the_estimator():
    for name, text, scale in (("cohesion", "c {:g} ± {:g} kPa", 1e-3), ("tan_phi", "tan φ {:g} ± {:g}", 1.0)):
        assert text.format(DEFAULT[name].mean * scale, DEFAULT[name].sd * scale) in FILE_PAGE
    assert (
        "n {:g} ± {:g}".format(DEFAULT["sinkage_exponent"].mean, DEFAULT["sinkage_exponent"].sd) in FILE_PAGE
    )
    middle, spread = np.exp(DEFAULT["stiffness"].of_logarithm())
    assert f"keq within a factor of {spread:.3g} of {middle * 1e-6:.3g} MPa/m^n" in FILE_PAGE
    assert choices.K_FACTOR == 2.0


@pytest.mark.parametrize("model", [None, "model.toml"])
def test_summary_is_described(model, terrain_est_here, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    sample = ROOT / "sample_data" / "run.csv"
    if model:
        assert terrain_est_here("model", "new", model, "--effect", "drivetrain-friction").returncode == 0
    options = ("--summary", "s.json", "--quiet", *(["--model", model] if model else []))
    done = terrain_est_here("estimate", sample, *options)
    assert done.returncode == 0, done.stderr
    described = pages.text_of("output.md").partition("## Summary")[2]

    def check(value, *, named=False):
        if isinstance(value, list):
            for element in value:
                check(element)
        elif isinstance(value, dict):
            for key, inner in value.items():
                assert named or f'"{key}"' in described
                check(inner, named=key in {"status", "set_aside", "channels", "parameters", "noise"})

    document = json.loads((tmp_path / "s.json").read_text("utf-8"))
    assert f'"{document["format"]}"' in described
    check(document)
