"""Telemetry of drives whose truth is known: to practise on, and to test with."""

from __future__ import annotations

from terrain_cli.simulation.hidden import draw
from terrain_cli.simulation.log import Log, simulate, table, truth_table
from terrain_cli.simulation.reader import COMMAND_LINE, read
from terrain_cli.simulation.scenario import Scenario

__all__ = ["COMMAND_LINE", "Log", "Scenario", "draw", "read", "simulate", "table", "truth_table"]
