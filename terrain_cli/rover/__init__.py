"""rover.toml: the wheels, where their channels are found, and what missing ones derive from."""

from __future__ import annotations

from terrain_cli.rover.rover_file import find, load
from terrain_cli.rover.vehicle import NOISY, Entry, Motor, Noise, Rover, Vehicle, Wheel

__all__ = ["NOISY", "Entry", "Motor", "Noise", "Rover", "Vehicle", "Wheel", "find", "load"]
