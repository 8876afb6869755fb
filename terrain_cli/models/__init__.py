"""Model files: the base, the effects added to it, and what is known of their parameters."""

from __future__ import annotations

from terrain_cli.mechanics.effect import Prior
from terrain_cli.models.model_change import (
    ASSUMPTIONS,
    MODULUS,
    STRESSES,
    Assumption,
    Changed,
    Refused,
    added,
    folder_of,
    moved,
    named_from,
    recorded,
    refused,
    removed,
)
from terrain_cli.models.model_file import ModelFile, build, find_effect, is_path, load, resolve, save

__all__ = [
    "ASSUMPTIONS",
    "MODULUS",
    "STRESSES",
    "Assumption",
    "Changed",
    "ModelFile",
    "Prior",
    "Refused",
    "added",
    "build",
    "find_effect",
    "folder_of",
    "is_path",
    "load",
    "moved",
    "named_from",
    "recorded",
    "refused",
    "removed",
    "resolve",
    "save",
]
