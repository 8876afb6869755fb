"""What decides what is said of a model beside measurements; read as ``comparison_criteria.NAME``."""

from terrain_cli.vocabulary.choices import criterion

"""How many blocks are enough?
An alarm and a change of a model need fewer, without evidence; each has a second condition."""
FEWEST_BLOCKS = criterion(
    8,
    "blocks needed: with fewer, compare reports no finding, diagnose gives no single name and stops "
    "joining blocks, and model add cuts the blocks anew by the better model; as many stretches are kept "
    "aside, and compare stops joining at twice as many",
)
MOST_BLOCKS = criterion(
    40, "largest number of blocks at the start, so that a slow change stays within one block"
)
ENOUGH_RUNS = criterion(12, "runs needed to use each run as one block; fewer runs are cut further")

"""How long is an independent stretch?
The lengths differ without evidence: a block is tested, a misfit is averaged, a soil is fitted."""
BLOCK_MEMORIES = criterion(8, "shortest block, in correlation times of the noise")
BLOCK_SAMPLES = criterion(10, "shortest block, or shortest part of a log that is left out, in samples")
MISFIT_SAMPLES = criterion(24, "samples in each block over which the misfit of a fit is averaged")

"""When are neighbouring blocks independent?
The values of diagnose and compare differ without evidence."""
UNRELATED_BLOCKS = criterion(
    0.05, "largest correlation of the scores of neighbouring blocks that compare treats as none"
)

"""When is an error more than noise?
Ratios of errors, except two that are ratios of mean squares. The consequence differs: a fit is tried
again, a sentence is printed, or a misfit is reported in any case. No study compares the values."""
NOTICED = criterion(
    1.1, "mean square of a channel's residual over that of its noise, above which another fit is tried"
)
ABOVE_NOISE = criterion(
    1.15, "held-out error of a channel over its noise, above which the error is called larger than noise"
)
ASTRAY = criterion(1.5, "mean square of all residuals over that of the noise, above which a fit has failed")
INTERPOLATION_OFF = criterion(
    1.25, "largest difference between a channel and its interpolation, in units of its noise"
)
SMALLEST_FINDING = criterion(
    0.1, "smallest finding, as a share of the noise: with many samples even tiny findings are significant"
)

"""How many standard errors are significant?
The more is tried, or the stronger the statement, the more are required. The values are judged."""
AS_GOOD = criterion(
    1.0,
    "a model within this distance is as good as the other; so is one soil instead of several, and a wider "
    "gap between samples and the neighbours they are interpolated from",
)
MOVED = criterion(3.0, "c, φ or a parameter has moved between two models if it differs by more")
ANSWERS_TO_LOAD = criterion(4.0, "test points calibrate the load only if they respond to it by more")

"""When is a result too rare to be chance?
A finding is reported by itself, so it needs the stricter level. An alarm also needs a gain on held-out
blocks."""
FINDING_LEVEL = criterion(
    0.005,
    "how often chance gives a finding this strong, over all drivers and shapes; with about 20 blocks the "
    "bootstrap counts 2 to 5 times too few",
    "finding_study, 1: with it 1 of 300 clean drives has a finding",
)

"""How much of a term must remain when everything else is refitted?
Shares of its sum of squares. They differ by up to 50 times, without evidence."""
TERM_SURVIVES = criterion(0.005, "a term is tested as a finding only if this much of it remains")

"""How much more must the more complex explanation explain?
Shares of what is explained, except a cosine, a correlation and a gain. They differ without evidence."""
PLAINER_SHAPE = criterion(0.05, "a simpler shape is preferred unless another explains this much more")
USUAL_DRIVER = criterion(
    0.3, "slip or load is preferred to a driver that varies alike unless that driver explains this much more"
)
FURTHER_FINDING = criterion(0.03, "a further finding must explain this share of what the first one explains")
SAME_DRIVER = criterion(0.99, "rank correlation above which two drivers count as the same")
ALIKE = criterion(0.9, "cosine between two terms above which one may be mistaken for the other")

"""How many are considered?
These bound the time as much as the result."""
MOST_FINDINGS = criterion(6, "largest number of findings of a comparison")

"""How is the noise estimated?"""
LEAST_NOISE_OF_SCALE = criterion(0.2, "smallest noise used as a weight, as a share of the residual")
LEAST_NOISE = criterion(
    0.02,
    "smallest noise used to whiten residuals, as a share of the residual; differs from 0.2 without evidence",
)
NOISE_OF_POINTS = criterion(
    0.05, "noise assumed for test points that were not repeated, as a share of the channel"
)
NOISE_OF_JUMPS = criterion(0.9, "smallest noise, as a share of the noise that second differences show")
FORGOTTEN = criterion(0.1, "correlation of the noise below which it counts as independent")
MEMORY_BELIEVED = criterion(
    25.0,
    "drop in the misfit of the variogram above which the noise counts as correlated in time",
    "simulated noise: below 10 for white noise, above 100 for noise whose correlation halves in three "
    "samples",
)
LONGEST_MEMORY = criterion(
    25,
    "longest correlation time, in samples, that is learnt from neighbouring samples; 1 s if that is more",
)
NOISE_SAMPLES = criterion(30, "samples, or pairs of samples, needed to estimate a noise or a correlation")
NOISE_POINTS = criterion(
    10, "test points needed to estimate a noise; fewer than samples, because test points are few"
)
POINTS_OF_LOAD = criterion(8, "test points needed to estimate how sinkage and torque respond to the load")
SAME_CONDITIONS = criterion(
    0.03, "two test points have the same conditions if they differ by less than this share of the range"
)
SCATTERED_CONDITIONS = criterion(0.15, "the same share for conditions that scatter about one value")
EQUAL_PAIRS = criterion(6, "pairs of test points under the same conditions needed to estimate the noise")
POINTS_BETWEEN = criterion(
    4, "test points with neighbours on both sides needed to estimate the noise where none is repeated"
)
LARGE_DIFFERENCE = criterion(
    1.5, "unit for differences of load or sinkage between test points, over their largest value"
)
JUMP = criterion(
    6.0,
    "load or slip is not smoothed if it changes by more than this many times the median change that "
    "noise makes",
)

"""How many predictions may be missing?
Shares of samples. A note and a loss are a matter of choice; a fit is rejected earlier, without evidence."""
UNPREDICTED = criterion(
    0.05, "samples without a prediction that cause a note; a change that loses more is not made"
)
FIT_UNPREDICTED = criterion(0.02, "samples without a prediction above which a fit has failed")

"""What is reported beside a verdict?"""
HIDDEN = criterion(
    0.3, "share of a finding's size that must show in a picture of the residuals; else a note says why"
)
