"""Model files: the base, the effects added to it, and what is known of their parameters."""

from __future__ import annotations

from terrain_cli.models.model_change import (
    ASSUMPTIONS,
    MODULUS,
    STRESSES,
    Assumption,
    Changed,
    added,
    imposed,
    lifted,
    made_by,
    recorded,
    removed,
)
from terrain_cli.models.model_file import (
    FORMAT,
    ModelFile,
    Prior,
    build,
    find_effect,
    is_path,
    load,
    parameter,
    resolve,
)
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
    "imposed",
    "is_path",
    "lifted",
    "load",
    "made_by",
    "new",
    "parameter",
    "recorded",
    "removed",
    "resolve",
    "save",
]
