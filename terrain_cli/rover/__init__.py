"""rover.toml: the wheels, where their channels are found, and what missing ones derive from."""

from terrain_cli.rover.rover_file import find, load, of_text
from terrain_cli.rover.vehicle import NOISY, Motor, Rover, SensorNoise, Vehicle, Wheel

__all__ = ["NOISY", "Motor", "Rover", "SensorNoise", "Vehicle", "Wheel", "find", "load", "of_text"]
