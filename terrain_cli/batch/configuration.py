"""The settings that decide on the numbers of an estimate, and their hash in the manifest."""

from __future__ import annotations

import json
import platform
from dataclasses import asdict, dataclass, replace
from hashlib import sha256
from importlib.metadata import entry_points, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrain_cli import effects, models
from terrain_cli.estimation import estimators
from terrain_cli.version import __version__
from terrain_cli.vocabulary import toml_files

if TYPE_CHECKING:
    from terrain_cli.models import ModelFile
    from terrain_cli.rover import Rover
    from terrain_cli.run.settings import Settings

FORMAT = "terrain-est/batch-configuration/1"
_LIBRARIES = ("numpy", "scipy", "pandas", "pyarrow", "rosbags")


@dataclass(frozen=True)
class Configuration:
    """What is the same for all inputs of a batch."""

    rover: Rover
    settings: Settings  # As they were given
    # The model that `settings` name, read once: a file that is changed during a batch changes nothing of it
    model: ModelFile | None
    crs: str | None
    document: dict[str, Any]  # All that decides on the numbers, for JSON

    @property
    def hash(self) -> str:
        """Stands for `document`."""
        return _hash(self.document)

    @property
    def twin(self) -> str:
        """The hash if the answer to --salvage were the other one."""
        options = self.document["options"]
        return _hash({**self.document, "options": {**options, "salvage": not options["salvage"]}})

    @property
    def resolved(self) -> Settings:
        """The settings with the model itself in place of its path."""
        return self.settings if self.model is None else replace(self.settings, model=self.model)


def gather(rover: Rover, settings: Settings, crs: str | None) -> Configuration:
    """Read all that decides on the numbers."""
    file = estimators.choose(settings.method, settings.model, robust=settings.robust)
    model = None
    if file is not None:
        model = {
            "base": file.model.base,
            "text": file.text,
            "effects": {name: _effect(name, file) for name in file.effects},
        }
    document = {
        "format": FORMAT,
        "terrain-est": __version__,
        # A file is told by what it says, not by where it lies.
        "options": {**asdict(replace(settings, model=None, places=None)), "crs": crs},
        "places": settings.places.digest if settings.places else None,
        "rover": toml_files.read_text(rover.path) if rover.path else None,
        "model": model,
    }
    return Configuration(rover, settings, file, crs, document)


def _effect(name: str, file: ModelFile) -> str:
    """Return what an effect is: the text of its file, or the package it comes from."""
    if models.is_path(name):
        folder = file.path.parent if file.path else Path()
        return toml_files.read_text(folder / name)
    if name in effects.NAMES:
        return f"terrain-est {__version__}"
    packages = {
        point.dist.name: point.dist.version for point in entry_points(group=effects.GROUP) if point.dist
    }
    return ", ".join(f"{package} {number}" for package, number in sorted(packages.items()))


def _hash(document: dict[str, Any]) -> str:
    text = json.dumps(document, sort_keys=True, ensure_ascii=True, allow_nan=False)
    return sha256(text.encode()).hexdigest()[:16]


def versions() -> dict[str, str]:
    """Return the versions of this program and of what it computes with."""
    return {
        "terrain-est": __version__,
        "python": platform.python_version(),
        **{name: version(name) for name in _LIBRARIES},
    }
