"""What can go wrong with a file, and the exit code it ends with.

FormatError          65   not what its name or content promises
├── NotFoundError    66   no such file, or no permission to read it
├── DamagedError     65   cut off, corrupt, without index
└── CannotWriteError 73   no space, no permission, no such folder
"""

import os


def shown(path: str) -> str:
    r"""Return a path as text: bytes of a name that are none become ``\x..``.

    Parameters
    ----------
    path : str

    Returns
    -------
    str
    """
    return os.fsencode(path).decode("utf-8", "backslashreplace")


class FormatError(Exception):
    """A file that cannot be read or written, told in one line.

    Parameters
    ----------
    path : str
        The file as the user named it.
    message : str
        What is wrong with it.
    hint : str, optional
        What to do about it.
    """

    exit_code = 65

    def __init__(self, path: str, message: str, *, hint: str = "") -> None:
        self.path, self.message = shown(path), message
        super().__init__(f"{self.path}: {message}")
        self.hint = hint


class NotFoundError(FormatError):
    """There is no such file, or it may not be read."""

    exit_code = 66


class DamagedError(FormatError):
    """A file that is cut off, corrupt or without its index."""


class CannotWriteError(FormatError):
    """No space, no permission or no such folder."""

    exit_code = 73
