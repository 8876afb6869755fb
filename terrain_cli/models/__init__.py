"""Model files: the base, the effects added to it, and what is known of their parameters."""

from __future__ import annotations

from terrain_cli.models.assumptions import (
    ASSUMPTIONS,
    MODULUS,
    STRESSES,
    Assumption,
    imposed,
    lifted,
    made_by,
)
from terrain_cli.models.model_change import Changed, added, folder_of, moved, named_from, recorded, removed
from terrain_cli.models.model_file import FORMAT, ModelFile, Prior
from terrain_cli.models.model_reader import build, find_effect, is_path, load, parameter, resolve
from terrain_cli.models.model_writer import new, save

__all__ = [
    "ASSUMPTIONS",
    "FORMAT",
    "MODULUS",
    "STRESSES",
    "Assumption",
    "Changed",
    "ModelFile",
    "Prior",
    "added",
    "build",
    "find_effect",
    "folder_of",
    "imposed",
    "is_path",
    "lifted",
    "load",
    "made_by",
    "moved",
    "named_from",
    "new",
    "parameter",
    "recorded",
    "removed",
    "resolve",
    "save",
]
