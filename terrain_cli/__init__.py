"""Soil cohesion and friction angle from wheel telemetry.

The steps of the command line are here for a notebook: `read`, `from_frame`, `segment`, `estimate`,
`trace` and `summarise`; see `terrain_cli.api`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

#: The one place where the version stands: packaging and `--version` read it here.
__version__ = "0.1.0"

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


def __getattr__(name: str) -> Any:
    # pandas takes half a second to import, which `terrain-est --help` must not wait for.
    if name in __all__:
        from terrain_cli import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
