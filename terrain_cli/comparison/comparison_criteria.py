"""What decides what is said of a model beside measurements; read as ``comparison_criteria.NAME``."""

from __future__ import annotations

from terrain_cli.vocabulary.criterion import criterion

"""How many blocks are enough?
Those of an alarm and of a change are lower, without evidence; each has a second condition."""
FEWEST_BLOCKS = criterion(
    8,
    "fewer: compare finds nothing, diagnose gives no single name and joins no more blocks, and a change of a "
    "model is doubted for the misfit's memory; so as many stretches are kept aside",
)
FEWEST_JOINED_BLOCKS = criterion(
    16, "blocks are joined as long as so many are left: twice what a finding needs"
)
MOST_BLOCKS = criterion(40, "blocks at first, at most: what changes slowly is to be within one")
ENOUGH_RUNS = criterion(12, "runs from which on they are the blocks; fewer are cut further")

"""How long is a stretch that stands for itself?
The shortest differ without evidence: a block is tested, a misfit averaged, a soil fitted."""
BLOCK_MEMORIES = criterion(8, "memories of the noise that a block has at least")
BLOCK_SAMPLES = criterion(10, "samples that a block, or a part of a log that is left out, has at least")
MISFIT_SAMPLES = criterion(24, "samples for each block over which the misfit of a fit is averaged")

"""When are neighbouring blocks independent?
That of diagnose differs from that of compare without evidence."""
UNRELATED_BLOCKS = criterion(0.05, "correlation of neighbouring blocks' scores that compare still calls none")

"""When is an error more than noise?
Ratios of errors, but for two mean squares, as said. What follows differs (a fit is tried again, a sentence
is said, a misfit is told whatever else is known), but no study compares the values."""
NOTICED = criterion(1.1, "mean square of a channel over the noise's, from which on another fit is tried")
ABOVE_NOISE = criterion(1.15, "held-out error of a channel over its noise that is said to be more")
ASTRAY = criterion(1.5, "mean square of all residuals over the noise's, from which on a fit is astray")
INTERPOLATION_OFF = criterion(1.25, "times its noise by which a channel may differ from its interpolation")
SMALLEST_FINDING = criterion(
    0.1, "part of the noise that a finding exceeds: with many samples all is beyond chance"
)

"""How many standard errors are beyond doubt?
The more is tried, or the more is said, the more are asked for; the values are judged."""
AS_GOOD = criterion(1.0, "within which a model is as good as another, and one soil as several")
MOVED = criterion(3.0, "beyond which c, φ or a parameter has moved from one model to the other")
ANSWERS_TO_LOAD = criterion(4.0, "by which test points have to answer to a load that they calibrate")

"""How rare is what chance does not give?
A finding is told by itself, an alarm only with a gain on held-out blocks; so the first asks for more."""
FINDING_LEVEL = criterion(
    0.005,
    "share of cases in which chance gives a finding as strong, anywhere; with some 20 blocks the bootstrap "
    "counts too few, by 2 to 5 times",
    "finding_study, 1: with it 1 of 300 clean drives has a finding",
)

"""How much of itself must a term keep when all else is fitted anew?
Shares of its square. They differ 50 times without evidence."""
TERM_SURVIVES = criterion(0.005, "a term of a finding is tested")

"""How much more must the less plain explanation explain?
Shares of what is explained, but for a cosine and a gain. They differ without evidence."""
PLAINER_SHAPE = criterion(0.05, "a simpler shape of a finding comes before one that explains this share more")
USUAL_DRIVER = criterion(0.3, "slip or load comes before what varied alike and explains this share more")
FURTHER_FINDING = criterion(0.03, "part of what the first finding explains that a further one has to")
SAME_DRIVER = criterion(0.99, "rank correlation from which on one driver is a function of another")
ALIKE = criterion(0.9, "cosine between terms from which on one could be the other")

"""How many are looked at?
They bound time as much as they decide."""
MOST_FINDINGS = criterion(6, "findings of a comparison")

"""What is noise, and what tells it?"""
LEAST_NOISE_OF_SCALE = criterion(0.2, "part of the residual that noise is at least where it weighs one")
LEAST_NOISE = criterion(0.02, "the same where residuals are whitened; differs from 0.2 without evidence")
NOISE_OF_POINTS = criterion(0.05, "noise of test points that nobody repeated, as a share of the channel")
NOISE_OF_JUMPS = criterion(0.9, "part of what second differences say that the noise is at least")
FORGOTTEN = criterion(0.1, "share of the noise that counts as forgotten")
MEMORY_BELIEVED = criterion(
    25.0,
    "drop of the variogram's misfit from which on noise has a memory",
    "simulated noise: white, below 10; that forgets half in three samples, above 100",
)
LONGEST_MEMORY = criterion(25, "samples of memory beyond which neighbours tell too little to wait for")
NOISE_SAMPLES = criterion(30, "samples, or pairs of them, that tell a noise or a correlation")
NOISE_POINTS = criterion(10, "test points that tell a noise; fewer than samples, as few are driven")
POINTS_OF_LOAD = criterion(8, "test points that tell how sinkage and torque answer to the load")
SAME_CONDITIONS = criterion(0.03, "share of their range within which conditions of test points are the same")
SCATTERED_CONDITIONS = criterion(0.15, "the same of those that scatter about one value")
EQUAL_PAIRS = criterion(6, "pairs of equal test points that tell the noise")
POINTS_BETWEEN = criterion(4, "test points between others that tell it where none are equal")
LARGE_DIFFERENCE = criterion(1.5, "differences of load or sinkage, in terms of their size, that are large")
JUMP = criterion(6.0, "medians of what noise does from which on load or slip change too fast to be smoothed")

"""How many predictions may be missing?
Shares of samples. What is told or lost is a choice; a fit is mistrusted earlier, without evidence."""
UNPREDICTED = criterion(0.05, "without a prediction, worth a word; and lost by a change that is not made")
FIT_UNPREDICTED = criterion(0.02, "without a prediction by a fit that is astray")

"""What is said beside a verdict?"""
HIDDEN = criterion(
    0.3, "part of a finding's size that a picture of the residuals must show, or a note says why"
)
