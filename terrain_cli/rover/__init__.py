"""rover.toml: the wheels, where their channels are found, and what missing ones derive from."""

from __future__ import annotations

from terrain_cli.rover.parts import Entry, Motor, Rover, Vehicle, Wheel
from terrain_cli.rover.reader import find, load

__all__ = ["Entry", "Motor", "Rover", "Vehicle", "Wheel", "find", "load"]
