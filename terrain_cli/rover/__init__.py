"""rover.toml: the wheels, where their channels are found, and what missing ones derive from."""

from __future__ import annotations

from terrain_cli.rover.parts import NOISY, Entry, Motor, Noise, Rover, Vehicle, Wheel
from terrain_cli.rover.reader import find, load

__all__ = ["NOISY", "Entry", "Motor", "Noise", "Rover", "Vehicle", "Wheel", "find", "load"]
