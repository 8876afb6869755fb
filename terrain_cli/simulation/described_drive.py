"""A drive from its description to what was measured."""

from __future__ import annotations

import secrets
from typing import TYPE_CHECKING, Any

from terrain_cli.errors import ConfigurationError, UsageError
from terrain_cli.simulation import drive_file, hidden_effect
from terrain_cli.simulation.simulated_log import SimulatedLog, simulate

if TYPE_CHECKING:
    from collections.abc import Mapping


def drive(
    path: str | None,
    options: Mapping[str, Any],
    *,
    label: str = drive_file.COMMAND_LINE,
    hide: bool = False,
    bag: bool = False,
) -> SimulatedLog:
    """Simulate what a file and options describe.

    Parameters
    ----------
    path : str or None
        A TOML file.
    options : mapping
        As for `drive_file.read`.
    label : str
        What messages call the options.
    hide : bool
        Add an effect drawn at random; without a seed, by a new one.
    bag : bool
        As for `simulate`.

    Raises
    ------
    UsageError
        An option has an unknown name or an impossible value.
    ConfigurationError
        The same of the file, or an effect needs what the drive does not have.
    InputError
        A soil does not carry the load, the effects contradict each other, or none to be hidden shows.
    """
    # A riddle that comes again is none.
    seed = secrets.randbits(31) if hide else 0
    try:
        scenario = drive_file.read(path, options, seed=seed, label=label)
    except ConfigurationError as error:
        if str(error).startswith(label):
            raise UsageError(str(error), hint=error.hint) from None
        raise
    return simulate(hidden_effect.draw(scenario) if hide else scenario, bag=bag)
