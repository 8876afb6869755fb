"""What decides what a model is said to lack; read as ``diagnosis_criteria.NAME``."""

from __future__ import annotations

from terrain_cli.vocabulary.criterion import criterion

"""How many blocks are enough?"""
BLOCKS_OF_ALARM = criterion(5, "fewer: no alarm is raised")

"""How long is a stretch that stands for itself?"""
SOIL_SAMPLES = criterion(40, "samples of a soil on either side of a step, of those that are fitted")

"""When are neighbouring blocks independent?"""
UNRELATED_SCORES = criterion(0.2, "correlation of neighbouring blocks' scores that diagnose calls none")

"""What is large enough to be worth a word?"""
SMALLEST_SHARE = criterion(
    0.003,
    "share of a channel's root mean square that what is missing has in some channel, for an alarm; a user "
    "sets it with --smallest-share",
    "arithmetic: at the 3 % of noise of diagnosis_study a gain of 0.004 noise variances is a share of 0.0019",
)

"""How many standard errors are beyond doubt?"""
BETTER = criterion(2.0, "by which a model is better than another")
TESTABLE = criterion(2.0, "that an effect stands out, of three times its typical size, to be tested")
SURE_OF_BENT_LAWS = criterion(4.0, "margin of a next drive that is sure even of somewhat other laws")

"""How rare is what chance does not give?"""
LEVEL = criterion(
    0.01,
    "share of cases in which chance gives a score as strong, or an effect's parameters as far from null",
    "with both, false alarms on clean logs: 0.5 to 4.2 % (diagnosis_study), 0 of 150 (alarm_study)",
)
GAINED = criterion(
    0.03,
    "the same of the gain on held-out blocks; what acts in a few blocks gains there alone, and no test of "
    "the mean finds that sure",
    "with both, false alarms on clean logs: 0.5 to 4.2 % (diagnosis_study), 0 of 150 (alarm_study)",
)
GAINED_STEADY = criterion(
    0.016,
    "the same of steady test points, whose scores are beyond chance too often",
    "arithmetic: six of six that gain do so in one case of 64",
)
TIED = criterion(0.05, "share of draws in which another effect is as good, so that it is of the family")
RULED_OUT = criterion(
    0.02,
    "a rival is ruled out that is mistaken for the best, by as much as now, less often",
    "diagnosis_study, goals: with it the true effect is in the family in 98.1 % of those detected",
)
EARNED = criterion(
    0.9,
    "share of draws that has to name an effect right",
    "diagnosis_study, goals: with it 0.2 % wrong single names",
)

"""How much of itself must a term keep when all else is fitted anew?"""
SIGNATURE_SURVIVES = criterion(0.0002, "an effect's signature is tested")
REST_SURVIVES = criterion(0.01, "a shape of what an effect leaves is tested")

"""How much more must the less plain explanation explain?"""
PLAINER_DRAFT = criterion(
    0.03, "a plainer draft, or one of a channel, before one that explains this share more"
)
FURTHER_PARAMETER = criterion(
    6.0, "gain in the sum of squares that a further parameter of a draft has to bring"
)

"""How much of the misfit?
Parts of what a model leaves, or of what the best one takes off; each weighs something else."""
DRAFT_LEFT = criterion(
    0.12,
    "that the best effect has to leave, and a draft to take, for the draft to stand",
    "diagnosis_study, goals: with it all 72 effects of no catalogue raise the alarm, none is named wrong",
)
RIVAL_WORTH = criterion(0.3, "of what the best takes off the loss; less is no rival")
SCORE_WORTH = criterion(
    0.15,
    "of what the best effect explains by its score; what scores less is not fitted",
    "on 52 drives, two for each effect (0.7 and 1.6 of full size), verdict, family and name are those "
    "of fitting all",
)
SMALL_REST = criterion(0.05, "of what an effect explains that may be left to follow the drive")
STANDS_FOR_SOILS = criterion(0.8, "of what new soils take off, for an effect to stand for them")
STEPS_SHARE = criterion(
    0.5,
    "of what is beyond noise, that steps of the soil take off: what is missing besides takes its share too, "
    "a soil leaves little",
)

"""How many are looked at?"""
RIVALS = criterion(8, "effects, or pairs, that are weighed against one another or against soils")
DRAFTS = criterion(6, "drafts that are fitted; fewer than rivals, without evidence")
SOILS_OF_A_LAW = criterion(3, "soils for which a drafted law may stand: a step of what warms passes for two")
MOST_STEPS = criterion(4, "steps of the soil under all wheels")
POINTS_ENOUGH = criterion(200, "points of a wheel from which on their order tells nothing that scores do not")


"""How many predictions may be missing?"""
FORECAST = criterion(0.8, "share of a next drive for which both models need an answer")

"""What is said beside a verdict?"""
LEFT_OPEN = criterion(0.95, "error of a parameter over what was known beforehand that the data leave open")
LARGE_ERROR = criterion(0.2, "part of a channel's size that is a large error, where no noise is known")
TOLD = criterion(0.2, "part of the misfit that a finding told of the most missed channel must account for")
STANDS_OUT = criterion(0.5, "part of the largest error beyond noise for a channel to be among those missed")

"""Which next drive is worth it?"""
STUCK = criterion(0.6, "sinkage over radius at which a rover is stuck")
LEAST_POWER = criterion(
    0.75,
    "power below which a drive settles nothing",
    "diagnosis_study, goals: of families with such a drive 84.4 % end in the right single name",
)
MOST_POWER = criterion(0.99, "power that no drive exceeds: not all that goes wrong is noise or bent laws")
SAME_POWER = criterion(0.05, "powers that differ by less are the same")
SAME_MARGIN = criterion(0.25, "margins, in deviations, that differ by less are the same")
