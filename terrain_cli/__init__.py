"""Soil cohesion and friction angle from wheel telemetry.

The steps of the command line are here for a notebook: `read`, `from_frame`, `segment`, `estimate`,
`trace` and `summarise`; see `terrain_cli.api`.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrain_cli.version import __version__ as __version__

if TYPE_CHECKING:
    from terrain_cli.api import (
        ModelFile,
        Samples,
        Windows,
        estimate,
        from_frame,
        load_model,
        load_rover,
        read,
        segment,
        summarise,
        trace,
    )

__all__ = [
    "ModelFile",
    "Samples",
    "Windows",
    "estimate",
    "from_frame",
    "load_model",
    "load_rover",
    "read",
    "segment",
    "summarise",
    "trace",
]


class ForeignFormatsError(ImportError):
    """Another module is called `formats`, and stands where Python looks first."""


def check_formats() -> None:
    """Make sure that `formats` is the one that comes with this package.

    Raises
    ------
    ForeignFormatsError
        It is a file of the working folder, for instance.
    """
    found = find_spec("formats")
    place = found.origin if found else None
    if place and Path(place).resolve() != Path(__file__).resolve().parent.parent / "formats" / "__init__.py":
        raise ForeignFormatsError(f"{place}: stands in the way of the package formats of terrain-est")


def __getattr__(name: str) -> Any:
    # pandas takes half a second to import, which `terrain-est --help` must not wait for.
    if name in __all__:
        check_formats()
        from terrain_cli import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
