"""Every error a user can cause, and the exit code it ends with.

TerrainError             1
├── InputError          65   the data cannot give what was asked
├── ConfigurationError  78   rover.toml, a model or an effect file is wrong
├── UsageError           2   options that contradict each other
├── SchedulerError      66   no cluster there, or none that can be used (batch/cluster.py)
└── InterruptedBatchError  130  Ctrl-C, or the system's wish to end

`formats.errors` draws the tree of what can go wrong with a file (66, 65, 73).
"""

from collections.abc import Iterable


class TerrainError(Exception):
    """An error told to a person in one line: where, and what is wrong; the hint says what to do about it."""

    exit_code = 1

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class InputError(TerrainError):
    """The data cannot give what was asked."""

    exit_code = 65


class ConfigurationError(TerrainError):
    """A rover, model or effect file is wrong."""

    exit_code = 78


class UsageError(TerrainError):
    """Options that contradict each other or the data."""

    exit_code = 2


class UnfinishedError(TerrainError):
    """Part of a batch failed; the same command does that part again."""

    exit_code = 75


class InterruptedBatchError(TerrainError):
    """A batch was asked to stop; what it had finished is kept."""

    exit_code = 130


def nearest(name: str, known: Iterable[str]) -> str:
    """Return "; did you mean …?" with the known name nearest to an unknown one, or nothing."""
    from difflib import get_close_matches

    close = get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else ""
