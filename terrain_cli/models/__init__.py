"""Model files: the base, the effects added to it, and what is known of their parameters."""

from __future__ import annotations

from terrain_cli.models.parts import FORMAT, ModelFile, Prior
from terrain_cli.models.reader import build, find_effect, is_path, load, parameter, resolve
from terrain_cli.models.writer import new, save

__all__ = [
    "FORMAT",
    "ModelFile",
    "Prior",
    "build",
    "find_effect",
    "is_path",
    "load",
    "new",
    "parameter",
    "resolve",
    "save",
]
