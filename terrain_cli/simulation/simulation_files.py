"""Writes what was simulated: the log, the truth, and the rover file."""

from __future__ import annotations

import json
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import formats
from formats.output.text_writer import PACKINGS, write_packed
from terrain_cli.simulation import matching_rover
from terrain_cli.simulation import simulated_log as logs
from terrain_cli.simulation import truth as truths

if TYPE_CHECKING:
    from terrain_cli.simulation.simulated_log import SimulatedLog

Kind = Literal["csv", "parquet", "ros1", "mcap", "db3"]
_KINDS: dict[str, Kind] = {
    ".csv": "csv",
    ".parquet": "parquet",
    ".bag": "ros1",
    ".mcap": "mcap",
    ".db3": "db3",
}
BAGS = frozenset({"ros1", "mcap", "db3"})


def kind_of(destination: str) -> Kind:
    """Tell from its name how a log is to be written.

    Parameters
    ----------
    destination : str
        "-" is the standard output, which takes CSV, as do pipes and devices.

    Returns
    -------
    {"csv", "parquet", "ros1", "mcap", "db3"}

    Raises
    ------
    CannotWriteError
        An ending that is not known.
    """
    path = Path(destination)
    folder = destination.endswith("/")
    packed = path.suffix.lower() in PACKINGS
    kind = _KINDS.get(Path(path.stem).suffix.lower() if packed else path.suffix.lower())
    if kind is None and (destination == "-" or path.is_fifo() or path.is_char_device()):
        return "csv"
    if kind is None or (packed and kind != "csv") or (folder and kind not in {"mcap", "db3"}):
        raise formats.CannotWriteError(
            destination,
            f"the ending {path.suffix!r} is not known" if kind is None else "cannot be written so",
            hint=f"known are {', '.join(_KINDS)}, .csv{', .csv'.join(PACKINGS)}, "
            "and .mcap/ and .db3/ for the folder of a ROS 2 recording",
        )
    return kind


def write_log(log: SimulatedLog, destination: str) -> None:
    """Write the telemetry, whole or not at all.

    Parameters
    ----------
    log : SimulatedLog
        Simulated for a bag where the destination is one.
    """
    kind = kind_of(destination)
    if kind in BAGS:
        from formats.output.bag_writer import write_bag
        from terrain_cli.simulation.bag_messages import topics

        write_bag(topics(log), destination, kind)
    elif Path(destination).suffix.lower() in PACKINGS:
        write_packed(logs.table(log), destination)
    else:
        formats.write_table(logs.table(log), destination, kind=kind)


def write(log: SimulatedLog, destination: str, *, truth: str | None = None, rover: str | None = None) -> None:
    """Write the log, and what belongs to it: all of them, or none.

    Parameters
    ----------
    log : SimulatedLog
        Simulated for a bag where the destination is one.
    truth : str, optional
        Takes a table where it ends in .csv or .parquet, else everything as JSON.

    Raises
    ------
    CannotWriteError
        No space, no permission, no such folder.
    """
    with ExitStack() as stack:
        if truth:
            _write_truth(log, stack.enter_context(formats.replacing(truth)))
        if rover:
            temporary = stack.enter_context(formats.replacing(rover))
            Path(temporary).write_text(matching_rover.text(log.scenario), encoding="utf-8")
        write_log(log, destination)


def _write_truth(log: SimulatedLog, path: str) -> None:
    if Path(path).suffix.lower() in {".csv", ".parquet"}:
        formats.write_table(logs.truth_table(log), path)
        return
    text = json.dumps(truths.document(log), ensure_ascii=False, indent=1, allow_nan=False)
    Path(path).write_text(text + "\n", encoding="utf-8")


def rover_is_in_the_way(destination: Path) -> bool:
    """Tell whether a rover file is there that was not written by this program."""
    try:
        return not destination.read_text("utf-8").startswith(matching_rover.HEADER)
    except FileNotFoundError:
        return False
    except (OSError, UnicodeDecodeError):
        return True
