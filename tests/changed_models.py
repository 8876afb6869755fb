"""Logs of which it is known what a model without effects lacks, for tests that change models."""

from __future__ import annotations

from simulator import CHANNELS, DRY_SAND, Drive, Sensor, Track, simulate, steps, undulation, wave
from simulator.effects import base_contact
from simulator.logs import write_csv

ROVER = "[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n"
#: A model file as a user would keep it.
MODEL = """\
# The left front wheel, as of last summer.
format = "terrain-est/model/1"
base = "wong-reece"        # not linear: too much slip
effects = []               # none yet
[fixed]                    # nothing
# end of what we know
"""
#: An effect of a user that does what slip-sinkage does.
DIGS = """\
id = "digs-itself-in"
title = "The wheel digs itself in"
changes = "sinkage_exponent"
law = "sinkage_exponent + dig * abs(slip)"
needs = []
[parameters.dig]
unit = "1"
null = 0.0
scale = 0.5
lower = -1.0
upper = 3.0
"""


def write_log(path, effects=None, seed=1, seconds=48.0, soils=(DRY_SAND,)):
    """Drive over dry sand at two speeds with slip and load that vary, and write what was measured."""
    track = Track(
        "wheel",
        [(base_contact(soil), seconds / len(soils)) for soil in soils],
        load=undulation(80.0, 0.2, 5.0, seed=5),
        slip=wave(0.35, 0.6, 9.0),
    )
    noisy = ("load", "torque", "sinkage", "slip", "drawbar_pull")
    drive = Drive(
        [track],
        rate=10.0,
        sensors={channel: Sensor(relative=0.02) for channel in noisy},
        channels=(*CHANNELS, "slip", "drawbar_pull"),
        effects=effects or {},
        speed=steps([(0.1, seconds / 2.0), (0.15, seconds / 2.0)]),
        seed=seed,
    )
    write_csv(simulate(drive), path)


def write_all(folder):
    """Write rover.toml, an effect of a user, a clean log, and one of a wheel that sinks as it slips."""
    (folder / "rover.toml").write_text(ROVER, "utf-8")
    (folder / "digs.toml").write_text(DIGS, "utf-8")
    write_log(folder / "clean.csv")
    write_log(folder / "sinks.csv", {"slip-sinkage": {"n1": 0.4}}, seed=2)


def once(function):
    """Return a function of windows and a model that works once for each model, then says the same again."""
    results = {}

    def again(wheels, file, **options):
        key = file.model.base, *(effect.id for effect in file.model.effects)
        if key not in results:
            results[key] = function(wheels, file, **options)
        return results[key]

    return again
