"""A rover in soft soil, to judge the program by: its own equations, its own code.

Nothing here may import `terrain_cli` or `formats`: a mistake shared with the program would be
one that no test can see. Wheel mechanics are scalar and integrated adaptively; only `tables`
interpolates them, so that a long drive takes a second.

>>> from simulator import DRY_SAND, UPLAND_SANDY_LOAM, one_wheel, simulate
>>> run = simulate(one_wheel([(DRY_SAND, 30.0), (UPLAND_SANDY_LOAM, 30.0)], noise=0.03, seed=1))
>>> log = run.wheels["wheel"]
>>> sorted(log.aligned())
['angular_velocity', 'load', 'sinkage', 'slip', 'time', 'torque', 'velocity', 'x', 'y']
>>> log.boundaries
(30.0,)

Physical effects come by their ids, with SI parameters; soils here have θm of their own, and
`base_contact` gives them that of a model without effects:

>>> soil = base_contact(DRY_SAND)
>>> drive = Drive([Track("wheel", [(soil, 30.0)])], effects={"drivetrain-friction": {"Tc": 0.5}})
>>> log = simulate(drive).wheels["wheel"]
>>> float((log.measured["torque"].values - log.truth["torque"]).mean().round(6))
0.5
"""

from simulator.drive import CHANNELS, FURTHER, Drive, Track, one_wheel
from simulator.effects import KNOWN as EFFECTS
from simulator.effects import base_contact
from simulator.noise import Clock, Sensor
from simulator.profiles import Profile, constant, scatter, steps, sweep, undulation, wave
from simulator.run import Run, Series, Stretch, WheelLog, simulate
from simulator.soils import (
    CLAYEY_SOIL,
    DRY_SAND,
    LETE_SAND,
    LUNAR_SOIL,
    NORTH_GOWER_CLAYEY_LOAM,
    RUBICON_SANDY_LOAM,
    SANDY_LOAM,
    SNOW,
    SOILS,
    UPLAND_SANDY_LOAM,
    WET_CLAYEY_SOIL,
    Soil,
)
from simulator.wheel import Forces, Wheel, forces, mean_stress, sinkage_under

__all__ = [
    "CHANNELS",
    "CLAYEY_SOIL",
    "DRY_SAND",
    "EFFECTS",
    "FURTHER",
    "LETE_SAND",
    "LUNAR_SOIL",
    "NORTH_GOWER_CLAYEY_LOAM",
    "RUBICON_SANDY_LOAM",
    "SANDY_LOAM",
    "SNOW",
    "SOILS",
    "UPLAND_SANDY_LOAM",
    "WET_CLAYEY_SOIL",
    "Clock",
    "Drive",
    "Forces",
    "Profile",
    "Run",
    "Sensor",
    "Series",
    "Soil",
    "Stretch",
    "Track",
    "Wheel",
    "WheelLog",
    "base_contact",
    "constant",
    "forces",
    "mean_stress",
    "one_wheel",
    "scatter",
    "simulate",
    "sinkage_under",
    "steps",
    "sweep",
    "undulation",
    "wave",
]
