"""TOML made to do harm: rover, model and effect files are told in one line what is wrong, at once."""

from __future__ import annotations

import time

import pytest

from terrain_cli import rover
from terrain_cli.errors import ConfigurationError
from terrain_cli.vocabulary import toml_files


@pytest.fixture(autouse=True)
def _at_once():
    began = time.perf_counter()
    yield
    assert time.perf_counter() - began < 20.0


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a." * 200_000 + "b = 1", "a key has more than 40 parts"),
        ('"a" . ' * 41 + "b = 1", "a key has more than 40 parts"),
        ("'a'." * 41 + "b = 1", "a key has more than 40 parts"),
        ("[" + "a." * 100_000 + "b]\nx = 1", "a key has more than 40 parts"),
        ("x = {" + "a." * 60 + "b = 1}", "a key has more than 40 parts"),
        ("a = " + "[" * 100_000, "nested too deep"),
        ("a = " + "{a = " * 100_000, "nested too deep"),
        ("a = " + "9" * 100_000, "not TOML"),
        ("-" * 3_000_000, "not TOML"),
        ('"' * 1_000_000, "not TOML"),
        ("a" * 5_000_000, "longer than 4,194,304 characters"),
    ],
    ids=range(11),
)
def test_what_would_take_long(text, says):
    with pytest.raises(ConfigurationError, match=says) as caught:
        toml_files.parse(text, "rover.toml")
    assert len(str(caught.value)) < 300
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text",
    [
        "a." * 39 + "b = 1",
        'reference = "Wong, J. Y. (2001). Theory of Ground Vehicles, 3rd ed., ch. 2.4.1"',
        "a" * 100_000 + " = 1",
        "\n".join(f"[a{i}]\nb.c.d = {i}.5" for i in range(2_000)),
    ],
    ids=range(4),
)
def test_what_is_long_and_well(text):
    assert toml_files.parse(text, "rover.toml")


def test_a_name_that_no_file_has(tmp_path):
    (tmp_path / "rover.toml").write_text('[estimate]\nplaces = "a\\u0000b"')
    with pytest.raises(ConfigurationError, match=r"estimate\.places: must be text, not 'a\\x00b'"):
        rover.load(tmp_path / "rover.toml")


def test_a_file_without_end():
    with pytest.raises(ConfigurationError, match=r"/dev/zero: is a device, not a file"):
        rover.load("/dev/zero")
