"""docs/conventions.md names every channel, unit, key and status; its rover.toml has every key."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from terrain_cli import rover, summary, units
from terrain_cli.channels import CHANNELS
from terrain_cli.errors import ConfigurationError

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "conventions.md").read_text("utf-8")
EXAMPLE = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)[1]


def table(heading):
    return PAGE.partition(heading)[2].partition("\n\n")[0]


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


@pytest.mark.parametrize("name", ["", "wheel", "soil", "motor", "vehicle", "sampling", "estimate"])
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


def test_every_status_is_explained():
    assert set(re.findall(r"^\| `([a-z-]+)`", table("| status | meaning |"), re.MULTILINE)) == {
        "ok",
        *summary.MEANINGS,
    }


def test_summary_is_described(terrain_est, tmp_path):
    done = terrain_est(
        "estimate", ROOT / "sample_data" / "run.csv", "--summary", tmp_path / "s.json", "--quiet"
    )
    assert done.returncode == 0, done.stderr
    described = PAGE.partition("## Summary")[2]

    def check(value):
        if isinstance(value, list):
            for element in value:
                check(element)
        elif isinstance(value, dict):
            for key, inner in value.items():
                assert f'"{key}"' in described
                if key not in {"status", "set_aside", "channels"}:
                    check(inner)

    document = json.loads((tmp_path / "s.json").read_text("utf-8"))
    assert f'"{document["format"]}"' in described
    check(document)
