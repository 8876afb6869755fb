"""Libraries that only pictures and reports need, with one clear error where one is missing."""

from __future__ import annotations

from importlib.util import find_spec

from terrain_cli import version
from terrain_cli.errors import ConfigurationError

#: Extra of the package → what it brings.
LIBRARIES = {"plot": ("matplotlib",), "report": ("altair", "jinja2", "vl_convert")}


def need(extra: str) -> None:
    """Check, before the work, that what a picture ("plot") or a report needs is installed."""
    missing = [name for name in LIBRARIES[extra] if find_spec(name) is None]
    if missing:
        what = {"plot": "pictures need", "report": "a report needs"}[extra]
        raise ConfigurationError(
            f"{what} {' and '.join(missing)}, which {'is' if len(missing) == 1 else 'are'} not installed",
            hint=version.command_for(extra),
        )
