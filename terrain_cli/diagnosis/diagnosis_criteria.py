"""What decides what a model is said to lack; read as ``diagnosis_criteria.NAME``."""

from terrain_cli.vocabulary.choices import criterion

"""How many blocks are enough?"""
BLOCKS_OF_ALARM = criterion(5, "blocks needed to raise an alarm")

"""How long is an independent stretch?"""
SOIL_SAMPLES = criterion(40, "fitted samples of a soil needed on each side of a step")

"""When are neighbouring blocks independent?"""
UNRELATED_SCORES = criterion(
    0.2, "largest correlation of the scores of neighbouring blocks that diagnose treats as none"
)
UNRELATED_SHORT_SCORES = criterion(
    0.1,
    "largest correlation of the scores of neighbouring stretches, 400 in a drive, that is treated as none",
    "in 15 tuning drives of diagnosis_study: at most 0.05 in white and AR(1) noise, 0.25 to 0.34 where the "
    "soil changes every 8 s without labels",
)

"""How small an effect is reported?"""
SMALLEST_SHARE = criterion(
    0.003,
    "smallest missing effect that raises the alarm, as a share of a channel's root mean square; "
    "--smallest-share sets another",
    "arithmetic: at the 3 % of noise of diagnosis_study a gain of 0.004 noise variances is a share of 0.0019",
)

"""How many standard errors are significant?"""
BETTER = criterion(2.0, "a model is better than another if it gains more")
LEAST_GAIN = criterion(
    1.0,
    "and more noise variances, over all samples: of two models that predict the same, such as wheel-radius "
    "and a slip that is off by a share, one gained 0.03 ± 0.01",
)
TESTABLE = criterion(2.0, "an effect is testable if three times its typical size stands out by more")
SURE_OF_BENT_LAWS = criterion(
    4.0,
    "a next drive with this margin tells two effects apart even if their laws differ somewhat from the "
    "catalogue's",
)

"""When is a result too rare to be chance?"""
LEVEL = criterion(
    0.01,
    "how often chance gives a score this large, or parameters of an effect this far from null",
    "with both levels, false alarms: 1 of 400 clean logs (diagnosis_study), 1 of 150 (alarm_study)",
)
GAINED = criterion(
    0.03,
    "how often chance gives such a gain on held-out blocks; an effect that acts in a few blocks gains "
    "only there, and no test of the mean is then sure",
    "with both levels, false alarms: 1 of 400 clean logs (diagnosis_study), 1 of 150 (alarm_study)",
)
TIED = criterion(
    0.05, "an effect belongs to the family if it is as good as the best in this share of the draws"
)
RULED_OUT = criterion(
    0.02,
    "a rival is ruled out if it is mistaken for the best, by as much as now, in a smaller share of the draws",
    "diagnosis_study, goals: with it the true effect is in the family of all that are detected",
)
EARNED = criterion(
    0.9,
    "share of the draws that must name the effect correctly",
    "diagnosis_study, goals: with it 2 wrong single names of 976 drives",
)

"""How much of a term must remain when everything else is refitted?"""
SIGNATURE_SURVIVES = criterion(0.0002, "an effect's signature is tested")
REST_SURVIVES = criterion(0.01, "a shape is tested in the residuals that an effect leaves")

"""How much more must the more complex explanation explain?"""
PLAINER_DRAFT = criterion(
    0.03, "a simpler law, or a law of a channel, is preferred unless another explains this much more"
)
FURTHER_PARAMETER = criterion(
    6.0, "gain in the sum of squares that a further parameter of a drafted law must bring"
)

"""Which share of the misfit?
Shares of what a model leaves, or of what the best effect removes. Each value decides something else."""
DRAFT_LEFT = criterion(
    0.12,
    "a drafted law stands if the best effect leaves this much, and the law explains it",
    "diagnosis_study, goals: with it 71 of 72 effects outside the catalogue raise the alarm, and none "
    "gets a wrong name",
)
RIVAL_WORTH = criterion(
    0.3, "an effect is a rival if it removes this share of the loss that the best effect removes"
)
SCORE_WORTH = criterion(
    0.15,
    "an effect is fitted if its score explains this share of what the best score explains",
    "on 52 drives, two for each effect (0.7 and 1.6 of full size), fitting all effects gave the same "
    "verdict, family and name",
)
SMALL_REST = criterion(
    0.05,
    "share of what an effect explains that may still follow the drive afterwards, or by which another "
    "pair of effects may explain less and still be what is there",
)
STANDS_FOR_SOILS = criterion(
    0.8,
    "an effect replaces several soils if it removes this share of what they remove, and of what both remove "
    "together",
)
STEPS_SHARE = criterion(
    0.5,
    "steps of the soil must remove this share of the misfit beyond noise; the rest may come from "
    "another missing effect, since a soil leaves little; an effect that would explain more is told even "
    "where the alarm is silent",
)

"""How many are considered?"""
RIVALS = criterion(8, "effects, or pairs of effects, compared with one another or with a change of soil")
DRAFTS = criterion(6, "laws that are fitted; fewer than rivals, without evidence")
SOILS_OF_A_LAW = criterion(
    3,
    "further soils that a drafted law replaces if it predicts as well; fewer only if it predicts better: a "
    "step in a quantity that warms up looks like two soils",
)
MOST_STEPS = criterion(4, "steps of the soil under all wheels")
POINTS_ENOUGH = criterion(
    200, "test points of a wheel above which their order is not tested: the scores say as much"
)


"""How many predictions may be missing?"""
FORECAST = criterion(0.8, "share of a next drive that both models must be able to predict")

"""What is reported beside a verdict?"""
LEFT_OPEN = criterion(
    0.95, "error of a parameter over the error of its prior, above which the data leave it open"
)
LARGE_ERROR = criterion(
    0.2, "error that counts as large where the noise is unknown, as a share of the channel"
)
TOLD = criterion(0.2, "share of the misfit that a finding must explain to be named for the worst channel")
STANDS_OUT = criterion(
    0.5, "a channel counts as missed if its error beyond noise is this share of the largest"
)

"""Which next drive is worth driving?"""
STUCK = criterion(0.6, "sinkage over radius at which a rover is stuck")
LEAST_POWER = criterion(
    0.75,
    "power below which a drive is not proposed",
    "diagnosis_study, goals: of 22 families with such a drive 18 end in the right single name, of 16 in "
    "which every pair has one 15",
)
MOST_POWER = criterion(
    0.99, "largest power that is stated: not only noise and other forms of a law can go wrong"
)
SAME_POWER = criterion(0.05, "powers that differ by less count as equal")
SAME_MARGIN = criterion(0.25, "margins, in standard deviations, that differ by less count as equal")
