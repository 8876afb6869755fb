"""What decides whether a change of a model pays; read as ``improvement_criteria.NAME``."""

from __future__ import annotations

from terrain_cli.vocabulary.criterion import criterion

"""How many blocks are enough?"""
BLOCKS_OF_CHANGE = criterion(3, "fewer: a change of a model is not tested")

"""When is an error more than noise?"""
NOISE = criterion(1.05, "error of a channel over its noise that a model which misses nothing may come to")

"""How many standard errors are beyond doubt?"""
DOUBTED = criterion(
    2.0,
    "by which a parameter may lie where nature has none; a diagnosis grants more, as it tries many effects",
    "simulated drives: of 20 right effects none came out on the wrong side at all",
)

"""How many are looked at?"""
MOST_EFFECTS = criterion(8, "effects after which it is no longer the model that is at fault")

"""By how much does an error change?"""
LEAST_CHANGE = criterion(0.02, "share of a channel's error that counts: sensors' noise feigns less in a fit")
MUCH = criterion(
    0.05,
    "share of a rise that may outweigh another's fall: a soil that the better model takes back may have "
    "hidden what is missing besides",
)
TRADED = criterion(0.25, "part of that fall that it has to be, both as logarithms")
PLAIN = criterion(0.9, "ratio of errors whose 95 % interval, below it, says so by itself")
CERTAIN = criterion(1.5, "times the reach of its 95 % interval by which a channel's fall says so by itself")
