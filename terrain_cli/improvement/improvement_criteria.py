"""What decides whether a change of a model pays; read as ``improvement_criteria.NAME``."""

from terrain_cli.vocabulary.choices import criterion

"""How many blocks are enough?"""
BLOCKS_OF_CHANGE = criterion(3, "blocks needed to test a change of a model")

"""When is an error more than noise?"""
NOISE = criterion(1.05, "error of a channel over its noise up to which a model counts as complete")

"""How many standard errors are significant?"""
DOUBTED = criterion(
    2.0,
    "a parameter may be physically impossible by this much; diagnose allows more, because it tries many "
    "effects",
    "simulated drives: none of 20 right effects came out impossible at all",
)

"""How many are considered?"""
MOST_EFFECTS = criterion(
    8, "largest number of effects in a model; if more seem to be missing, something else is wrong"
)

"""Which change of an error counts?"""
LEAST_CHANGE = criterion(
    0.02, "smallest change of a channel's error that counts: in a fit, sensor noise causes less"
)
MUCH = criterion(
    0.05,
    "rise of a channel's error that counts against the fall of another; a smaller one is allowed: a "
    "wrong soil in the old model may have hidden another missing effect",
)
TRADED = criterion(0.25, "share of the fall that such a rise may reach, both as logarithms")
PLAIN = criterion(0.9, "ratio of errors: a 95 % interval below it is proof enough")
CERTAIN = criterion(1.5, "a fall of this many times the half-width of its 95 % interval is proof enough")
