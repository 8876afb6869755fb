"""The version of this program, and how it was installed: for `--version`, and hints that add a library."""

import os
import platform
import shlex
import sys
from pathlib import Path

__version__ = "0.1.0"
NAME = "terrain-est"


def details() -> str:
    """Say which Python runs the program, on what, and where it lies."""
    folder = Path(__file__).resolve().parent
    return (
        f"Python {platform.python_version()} on {platform.platform()}\ninstalled in {folder} ({_manner()[0]})"
    )


def command_for(extra: str) -> str:
    """Write the command that adds the libraries of an extra to this installation."""
    return f"{_manner()[1]} '{NAME}[{extra}]'"


def _manner() -> tuple[str, str]:
    """Return the tool that made the environment, and its command that adds to it."""
    prefix = Path(sys.prefix)
    into = f"uv pip install --python {shlex.quote(str(prefix))}"
    if (prefix / "pipx_metadata.json").is_file():
        return "pipx", f"pipx runpip {NAME} install"
    if (prefix / "uv-receipt.toml").is_file():
        return "uv tool", into
    if sys.prefix == sys.base_prefix:
        return "no virtual environment", "pip install"
    pip = prefix / ("Scripts" if os.name == "nt" else "bin") / ("pip.exe" if os.name == "nt" else "pip")
    if not pip.is_file():
        return "a virtual environment of uv", into
    # Of an environment that is not active, pip alone would be another one.
    active = os.environ.get("VIRTUAL_ENV") == sys.prefix
    return "a virtual environment", f"{'pip' if active else shlex.quote(str(pip))} install"
