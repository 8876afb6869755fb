"""Telemetry of drives whose truth is known: to practise on, and to test with."""

from terrain_cli.simulation.drive_file import read
from terrain_cli.simulation.simulated_log import SimulatedLog, draw, drive, simulate, table, truth_table

__all__ = ["SimulatedLog", "draw", "drive", "read", "simulate", "table", "truth_table"]
