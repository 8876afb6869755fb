"""Hints that add libraries fit the way the program was installed."""

from __future__ import annotations

import shlex

import pytest

from terrain_cli import version


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """Return an environment with a space in its path, and pip in it."""
    folder = tmp_path / "my env"
    (folder / "bin").mkdir(parents=True)
    (folder / "bin" / "pip").touch()
    monkeypatch.setattr("sys.prefix", str(folder))
    monkeypatch.delenv("VIRTUAL_ENV", raising=False)
    return folder


def words():
    return shlex.split(version.command_for("report"))


def test_an_active_environment(prefix, monkeypatch):
    monkeypatch.setenv("VIRTUAL_ENV", str(prefix))
    assert words() == ["pip", "install", "terrain-est[report]"]


def test_an_environment_that_is_not_active(prefix):
    assert words() == [str(prefix / "bin" / "pip"), "install", "terrain-est[report]"]


@pytest.mark.parametrize("receipt", ["uv-receipt.toml", None])
def test_uv(receipt, prefix):
    if receipt:
        (prefix / receipt).touch()
    else:
        (prefix / "bin" / "pip").unlink()
    assert words() == ["uv", "pip", "install", "--python", str(prefix), "terrain-est[report]"]
    assert "uv" in version.details()


def test_pipx(prefix):
    (prefix / "pipx_metadata.json").touch()
    assert words() == ["pipx", "runpip", "terrain-est", "install", "terrain-est[report]"]
    assert version.details().endswith("(pipx)")


def test_no_environment(prefix, monkeypatch):
    monkeypatch.setattr("sys.base_prefix", str(prefix))
    assert words() == ["pip", "install", "terrain-est[report]"]
