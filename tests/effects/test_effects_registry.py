"""The registry: what it imports, what it does with a name, and what other packages add to it."""

from __future__ import annotations

import subprocess
import sys
from importlib import metadata

import pytest

from terrain_cli import effects
from terrain_cli.effects import Effect, Parameter
from terrain_cli.errors import ConfigurationError, UsageError

CABLE = Effect(
    id="cable-drag",
    title="An umbilical drags",
    kind="force",
    parameters=(Parameter("cd", "N s/rad", 0.0, 10.0),),
    laws={"drawbar_pull": lambda q: q["drawbar_pull"] - q["cd"] * q["yaw_rate"]},
    needs=("yaw_rate",),
)


def cable():
    return CABLE


def raises():
    raise OSError("no licence file\nsee the manual")


class Wrong:
    """Called, it gives no effect."""


@pytest.fixture
def points(monkeypatch):
    """Return a function that has a package register what this module has under some names."""

    def register(**names):
        listed = [
            metadata.EntryPoint(name, f"{__name__}:{value}", effects.GROUP) for name, value in names.items()
        ]
        monkeypatch.setattr(
            metadata, "entry_points", lambda group: listed if group == effects.GROUP else pytest.fail(group)
        )

    return register


def test_import_takes_no_numpy():
    code = "import sys, terrain_cli.effects; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_find_says_what_there_is():
    assert effects.find("hardpan").id == "hardpan"
    with pytest.raises(
        UsageError, match="there is no effect 'slip-sinkag'; did you mean slip-sinkage"
    ) as caught:
        effects.find("slip-sinkag")
    assert all(name in caught.value.hint for name in effects.NAMES)


@pytest.mark.parametrize("value", ["CABLE", "cable"])
def test_a_package_adds_an_effect_or_a_function_that_returns_one(points, value):
    points(cable=value)
    found = effects.find("cable-drag")
    assert found == CABLE
    assert found.origin == "entry point cable of terrain_est.effects"
    assert list(effects.catalogue()) == [*effects.NAMES, "cable-drag"]


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("nothing_there", "AttributeError: .*nothing_there"),
        ("raises", "OSError: no licence file$"),
        ("Wrong", "it gives a Wrong, not an Effect"),
        ("__name__", "it gives a str, not an Effect"),
    ],
)
def test_a_broken_package_is_named(points, value, reason):
    points(good="CABLE", broken=value)
    with pytest.raises(
        ConfigurationError, match=rf"entry point broken of terrain_est\.effects .* {reason}"
    ) as caught:
        effects.catalogue()
    assert caught.value.exit_code == 78
    # What the program has itself does not depend on it.
    assert effects.find("crust").id == "crust"


def test_an_id_is_given_once(points, monkeypatch):
    points(one="CABLE", two="cable")
    with pytest.raises(
        ConfigurationError, match=r"entry point two .*: the id cable-drag is taken \(entry point one"
    ):
        effects.catalogue()
    mimic = effects.find("slope")
    monkeypatch.setattr(sys.modules[__name__], "CABLE", mimic)
    points(one="CABLE")
    with pytest.raises(ConfigurationError, match=r"the id slope is taken \(catalogue\)"):
        effects.catalogue()
