"""The wheel has what the program reads and what a shell and man look for."""

from __future__ import annotations

import tomllib
from pathlib import Path

from man import generate

ROOT = Path(__file__).resolve().parent.parent
SETUPTOOLS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]


def test_every_file_of_a_package_is_packed():
    packed = {
        path
        for package, patterns in SETUPTOOLS["package-data"].items()
        for pattern in patterns
        for path in (ROOT / package).glob(pattern)
    }
    files = {
        path
        for package in ("terrain_cli", "formats")
        for path in (ROOT / package).rglob("*")
        if path.is_file() and path.suffix not in {".py", ".pyc"}
    }
    assert files == packed


def test_man_pages_and_completions_are_packed():
    packed = {
        folder: {path for pattern in patterns for path in ROOT.glob(pattern)}
        for folder, patterns in SETUPTOOLS["data-files"].items()
    }
    assert {path.name for path in packed.pop("share/man/man1")} == generate.pages("2026-01-01").keys()
    assert set.union(*packed.values()) == generate.scripts().keys()
