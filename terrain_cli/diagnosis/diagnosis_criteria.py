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
BETTER = criterion(
    2.0, "a model is better than another only if its gain is this many times its standard error"
)
LEAST_GAIN = criterion(
    1.0,
    "a model is better than another only if it also gains this many noise variances over all samples: of "
    "two models that predict the same, such as wheel-radius and a slip that is off by a share, one gained "
    "0.03 ± 0.01",
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
    0.05,
    "an effect belongs to the family if it is as good as the best one in this share of the simulated drives",
)
RULED_OUT = criterion(
    0.02,
    "a rival is ruled out if in a smaller share of the drives simulated with it, the best effect wins as "
    "clearly as now",
    "diagnosis_study, goals: with it the true effect is in the family of all 166 that are detected",
)
EARNED = criterion(
    0.9,
    "share of the simulated drives in which the effect must come first, to be the single name",
    "diagnosis_study, goals: with it 2 of 976 drives get a wrong single name",
)

"""How much of a term must remain when everything else is refitted?"""
SIGNATURE_SURVIVES = criterion(0.0002, "an effect is tested only if this much of its signature remains")
REST_SURVIVES = criterion(
    0.01, "a shape is tested in the residuals that an effect leaves only if this much of it remains"
)

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
    "diagnosis_study, goals: with it all 72 effects outside the catalogue raise the alarm, and none "
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
    "share of what an effect explains: so much may still be systematic when it gets a single name, and "
    "another pair of effects that explains less by no more than this is named too",
)
STANDS_FOR_SOILS = criterion(
    0.8,
    "an effect replaces several soils if it removes this share of what they remove, and of what both remove "
    "together",
)
STEPS_SHARE = criterion(
    0.5,
    "share of the misfit beyond noise that counts as most of it: changes of the soil must remove it, and "
    "an effect that would explain it is mentioned even where the alarm is silent",
)

"""How many are considered?"""
RIVALS = criterion(8, "effects, or pairs of effects, compared with one another or with a change of soil")
DRAFTS = criterion(6, "drafted laws that are fitted; fewer than effects, without evidence")
SOILS_OF_A_LAW = criterion(
    3,
    "further soils that a drafted law replaces if it predicts as well; fewer only if it predicts better: a "
    "step in a quantity that warms up looks like two soils",
)
MOST_STEPS = criterion(4, "largest number of changes of the soil that are sought, under all wheels together")
POINTS_ENOUGH = criterion(
    200, "test points of a wheel above which their order is not tested: the scores then show as much"
)


"""How many predictions may be missing?"""
FORECAST = criterion(0.8, "share of the samples of a next drive that both models must be able to predict")

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
    "diagnosis_study, goals: 23 of 24 families with such a drive end in the right single name, and 17 of "
    "the 18 in which every pair has such a drive",
)
MOST_POWER = criterion(
    0.99, "largest power that is stated, since more can go wrong than the simulations contain"
)
SAME_POWER = criterion(0.05, "powers that differ by less count as equal")
SAME_MARGIN = criterion(0.25, "margins, in standard deviations, that differ by less count as equal")
