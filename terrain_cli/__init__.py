"""Soil cohesion and friction angle from rover wheel telemetry.

The steps of the command line are functions here, for a notebook:

    import terrain_cli as terrain

    wheels = terrain.read("run.bag")
    windows = [terrain.segment(wheel) for wheel in wheels]
    terrain.estimate(windows)[["wheel", "c_kPa", "phi_deg", "status"]]
    terrain.compare(windows).failures
    found = terrain.diagnose(windows)
    trial = terrain.add_effect("wong-reece", found.effect, windows)

Data
    read, from_frame        a log, or a DataFrame, as the samples of each wheel
    segment                 the windows of one wheel, each of one soil
    load_rover, load_model  rover.toml; a model file
    simulate                telemetry of a known truth

Soil
    estimate                c, φ and strength of every window
    posterior               c and φ together, and the covariance of all parameters
    trace                   c and φ sample by sample
    summarise               the windows of each terrain pooled

Model
    compare                 errors of a model, and where it fails
    diagnose                the effect that it lacks
    add_effect              an effect added, if held-out data speak for it
    report                  one page of HTML

Functions that take data take windows, samples, the path of a log or a DataFrame, one or several. Results of
`compare`, `diagnose`, `add_effect` and `simulate` have DataFrames, `plot()`, and `to_json()`, which is what
the command writes. Errors that a user can cause are `terrain_cli.errors.TerrainError` and
`formats.errors.FormatError`; each has a `hint`.
"""

# ruff: noqa: F403, F405
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from terrain_cli.version import __version__ as __version__

if TYPE_CHECKING:
    # For type checkers; see __getattr__.
    from terrain_cli.api import *

__all__ = [
    "ComparisonResult",
    "DiagnosisResult",
    "EffectTrial",
    "ModelFile",
    "Samples",
    "SimulatedDrive",
    "Windows",
    "add_effect",
    "compare",
    "diagnose",
    "estimate",
    "from_frame",
    "load_model",
    "load_rover",
    "posterior",
    "read",
    "report",
    "segment",
    "simulate",
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
        It is a file or a folder of the working folder, for instance.
    """
    found = find_spec("formats")
    # A folder without __init__.py has no origin.
    place = found and (found.origin or next(iter(found.submodule_search_locations or ()), None))
    if place and Path(place).resolve() != Path(__file__).resolve().parent.parent / "formats" / "__init__.py":
        raise ForeignFormatsError(f"{place}: stands in the way of the package formats of terrain-est")


def __dir__() -> list[str]:
    # help() and completion show what is not imported yet.
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    # `terrain-est --help` must not wait for the import of pandas.
    if name in __all__:
        check_formats()
        from terrain_cli import api

        return getattr(api, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
