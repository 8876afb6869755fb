"""Telemetry of a known truth, for a notebook."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd

from terrain_cli import rover as rovers
from terrain_cli import simulation
from terrain_cli.api import result_tables
from terrain_cli.api.logs import from_frame
from terrain_cli.rover import Rover
from terrain_cli.simulation import SimulatedLog
from terrain_cli.simulation import simulation_files as truths
from terrain_cli.telemetry import Samples

_LABEL = "simulate()"  # What the messages of errors call the arguments


@dataclass(frozen=True, repr=False)
class SimulatedDrive(result_tables.Result):
    """What `simulate` measured, and the truth behind it.

    Parameters
    ----------
    log : SimulatedLog
        Everything: the scenario, and each channel of each wheel on its own clock.
    """

    log: SimulatedLog

    @cached_property
    def frame(self) -> pd.DataFrame:
        """The log as a table: a row for each time and wheel, SI units, NaN where nothing was measured.

        ``frame.to_csv("run.csv", index=False)`` writes what the commands read.
        """
        return pd.DataFrame(simulation.table(self.log))

    @cached_property
    def truth(self) -> pd.DataFrame:
        """The truth for each row of `frame`, in SI units.

        What perfect sensors show; ``true_load``, ``true_slip`` and ``true_sinkage``, which the soil has;
        the parameters of the soil and of the effects.
        """
        return pd.DataFrame(simulation.truth_table(self.log))

    @cached_property
    def rover(self) -> Rover:
        """The rover, as its file would say."""
        return rovers.of_text(truths.rover_text(self.log.scenario))

    @cached_property
    def samples(self) -> list[Samples]:
        """One for each wheel, as `read` returns them."""
        return from_frame(self.frame, self.rover, source="simulated")

    @cached_property
    def _document(self) -> dict[str, Any]:
        return truths.document(self.log)

    @property
    def _picture(self) -> result_tables.Picture:
        return self.log, "measured"

    def __str__(self) -> str:
        return self.log.scenario.summary

    def __repr__(self) -> str:
        return f"<SimulatedDrive: {self}>"

    def _repr_html_(self) -> str:
        return result_tables.html([str(self)], {"Measured": self.frame.head()})


def simulate(
    drive_file: str | Path | None = None,
    *,
    drive: str | Sequence[str] | None = None,
    soil: str | Sequence[str] | None = None,
    effects: str | Sequence[str] | Mapping[str, Mapping[str, float]] | None = None,
    noise: str | Mapping[str, Any] | None = None,
    duration: float | None = None,
    rate: float | None = None,
    wheels: int | None = None,
    load: float | None = None,
    speed: float | None = None,
    model: str | None = None,
    seed: int | None = None,
    hide: bool = False,
    **further: Any,
) -> SimulatedDrive:
    """Simulate the telemetry of a drive whose soils, effects and noise are known.

    Arguments are the keys of a drive file, and take precedence over those of `drive_file`.

    Parameters
    ----------
    drive_file : str or Path, optional
        A TOML file, as docs/simulate.md describes it.
    drive : str or sequence of str, optional
        How to drive, one after another: "mixed" (the default), "slip-sweep", "load-steps", "slope",
        "speed-steps", "turns", "passes", "reverse", "multi".
    soil : str or sequence of str, optional
        Soils, one after another over equal distances, such as "dry-sand" (the default) and "snow".
    effects : str, sequence of str, or mapping, optional
        Ids or TOML files, whose parameters have their typical size; or the parameters of each, in SI
        units: ``{"slip-sinkage": {"n1": 0.4}}``.
    noise : str or mapping, optional
        White noise of all usual channels, such as ``"3%"``; or by channel, such as
        ``{"torque": "2%", "sinkage": "1 mm"}``. None by default.
    duration : float, optional
        Of the whole drive in s; 60 s for each `drive` by default.
    rate : float, optional
        Samples in a second, in Hz; 20 by default.
    wheels : int, optional
        Number of wheels; 1 by default.
    load : float, optional
        Mean load of each wheel in N; 80, or less where the soil is weak, by default.
    speed : float, optional
        Mean speed in m/s; 0.1 by default.
    model : str, optional
        Where the truth comes from: "wong-reece" (the default), "linear", or a model file.
    seed : int, optional
        The same seed gives the same numbers; 0 by default, a new one if an effect is hidden.
    hide : bool
        Add an effect of the catalogue, drawn at random with its size. Only the truth names it.
    **further
        Other keys of a drive file: part, soils, wheel, rates, gravity, drawbar_pull, start.

    Returns
    -------
    SimulatedDrive
        With the log as ``frame`` and as ``samples``, the ``truth``, and the ``rover``.

    Raises
    ------
    UsageError
        An argument has an unknown name or an impossible value.
    ConfigurationError
        The same of the drive file, or an effect needs what the drive does not have.
    InputError
        The soil does not carry the load, or the effects contradict each other.

    Examples
    --------
    >>> drive = terrain.simulate(effects="slip-sinkage", noise="3%", seed=1)
    >>> terrain.diagnose(drive.samples).effect
    'slip-sinkage'
    """
    if isinstance(effects, str):
        effects = [effects]
    if effects is not None and not hasattr(effects, "keys"):
        effects = {name: {} for name in effects}
    named = {
        "drive": _listed(drive),
        "soil": _listed(soil),
        "effects": effects,
        "noise": noise,
        "duration": duration,
        "rate": rate,
        "wheels": wheels,
        "load": load,
        "speed": speed,
        "model": model,
        "seed": seed,
    }
    settings = {key: value for key, value in named.items() if value is not None}
    path = None if drive_file is None else str(drive_file)
    return SimulatedDrive(simulation.drive(path, {**settings, **further}, label=_LABEL, hide=hide))


def _listed(names: str | Sequence[str] | None) -> str | list[str] | None:
    return names if names is None or isinstance(names, str) else list(names)
