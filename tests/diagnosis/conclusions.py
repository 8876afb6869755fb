"""Evidence, and what is concluded from it."""

import math

import pytest

from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.vocabulary.next_commands import Asked

ASKED = Asked(inputs=("a run.csv",), options=("--segments", "none"))
FILE = Asked(inputs=("run.csv",), model="rig.toml")
OFF = {"torque": 8.64, "drawbar pull": 1.1, "sinkage": 12.2}
FINE = {"torque": 1.02, "sinkage": 0.98}
UNKNOWN = {"torque": math.nan}
MISSES = (
    "The model misses something: the held-out error is 8.6 × the noise in torque and 12 × in sinkage, and "
)
UNFIT = f"The model does not fit to within the noise: {MISSES[28:-6]}; "
AGAIN = "Repeat the drive beside this track: if the misfit"
SMALL = "The model may miss something: the held-out error is at most 1.02 × the noise (in torque), but "
POSSIBLE = "a first check of the effects finds a possible cause."
SMALLEST = "the held-out error is at most 1.02 × the noise (in torque)"
FITS = f"The model fits to within the noise: {SMALLEST}, and the data show no missing effect."
NO_SOIL = (
    f"The model fits to within the noise: {SMALLEST}, but only with a cohesion of -3 kPa, which is "
    "physically impossible: the soil imitates something that is missing, or a sensor is wrong."
)
LOOK = "terrain-est diagnose 'a run.csv' --segments none"
OUT = "terrain-est model remove wong-reece crust --segments none --data 'a run.csv'"
NEW = "terrain-est model new model.toml && terrain-est model add model.toml "
DATA = " --segments none --data 'a run.csv'"


def evidence(ratios, **known):
    return Evidence(**{"ratios": ratios, "blocks": 20, "raised": False, **known})


#: Evidence, and the state, the beginning of the sentence, and the command that it has.
CONCLUSIONS = [
    pytest.param(evidence(FINE), "fits", FITS, "", id="noise, by scores"),
    pytest.param(evidence(FINE, verdict="none"), "fits", FITS, "", id="noise, by a diagnosis"),
    pytest.param(
        evidence(FINE, verdict="none", blocks=5),
        "fits",
        f"The model fits to within the noise: {SMALLEST}. No effect shows, but 5 independent stretches of "
        "data are too few to rule one out. Record a drive at least 2 times as long.",
        "",
        id="noise, on few stretches",
    ),
    pytest.param(
        evidence({**FINE, "drawbar pull": 1.0}, soils=3, changes=("8 s", "20 s"), needed=True),
        "fits",
        FITS.replace("noise:", "noise with 3 soils:")
        + " The soil changes at 8 s and 20 s, and no effect predicts as well with fewer "
        + "soils.",
        "",
        id="noise, on several soils",
    ),
    pytest.param(
        evidence({**FINE, "drawbar pull": 1.0}, verdict="none", soils=6, changes=tuple("abcde")),
        "fits",
        FITS.replace("noise:", "noise with 6 soils:") + " The soil changes at 5 places.",
        "",
        id="noise, on more soils than one reads of",
    ),
    pytest.param(
        evidence(FINE, soils=2, changes=("8 s",), instead="multi-pass"),
        "explained",
        SMALL + "only with 2 soils; with multi-pass, fewer may be enough.",
        LOOK,
        id="an effect in place of soils",
    ),
    pytest.param(
        evidence(FINE, soils=2, changes=("8 s",), instead="multi-pass", refused=("multi-pass",)),
        "fits",
        FITS.replace("noise:", "noise with 2 soils:"),
        "",
        id="an effect in place of soils that did not pay",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="effect", family=("slope",), fewer=1, soils=2, changes=("8 s",)),
        "explained",
        MISSES.replace("the held-out", "with 1 soil instead of 2, the held-out")
        + "slope explains it. A soil that changes at 8 s would explain it too. To tell, drive beside "
        + "this track in the opposite direction: if the misfit changes at the same place, the soil is "
        + "the cause.",
        NEW + "slope" + DATA,
        id="one name on fewer soils",
    ),
    pytest.param(
        evidence(
            OFF,
            raised=True,
            verdict="family",
            family=("slope",),
            fewer=1,
            soils=2,
            changes=("8 s",),
            leaves=True,
            better=True,
        ),
        "explained",
        MISSES.replace("the held-out", "with 1 soil instead of 2, the held-out")
        + "slope explains most of it, but this is not certain. "
        + "A soil that changes at 8 s would explain it better. To tell, ",
        NEW + "slope" + DATA,
        id="most of it on fewer soils",
    ),
    pytest.param(evidence(OFF, raised=True), "explained", MISSES + POSSIBLE, LOOK, id="scores"),
    pytest.param(
        evidence(OFF, raised=True, tracked=True),
        "explained",
        MISSES + "the residuals are systematic.",
        LOOK,
        id="findings",
    ),
    pytest.param(
        evidence(FINE, raised=True), "explained", SMALL + POSSIBLE, LOOK, id="scores within the noise"
    ),
    pytest.param(
        evidence(FINE, raised=True, tracked=True),
        "explained",
        SMALL + "the residuals are systematic.",
        LOOK,
        id="findings within the noise",
    ),
    pytest.param(
        evidence(FINE, raised=True, verdict="effect", family=("slope",)),
        "explained",
        "The model may miss something: the held-out error is at most 1.02 × the noise (in torque), but "
        "the residuals are systematic, and slope explains it.",
        NEW + "slope" + DATA,
        id="one name within the noise",
    ),
    pytest.param(
        evidence(FINE, raised=True, verdict="family", family=("slope", "crust"), refused=("slope", "crust")),
        "unexplained",
        "The model fits as well as these data can tell: the held-out error is at most 1.02 × the noise "
        "(in torque). The residuals may be systematic, but slope and crust were tried, and "
        "held-out data do not support them.",
        "",
        id="nothing pays within the noise",
    ),
    pytest.param(
        evidence(UNKNOWN, raised=True),
        "explained",
        "The model misses something: the noise of the sensors is not known",
        LOOK,
        id="scores, noise unknown",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="effect", family=("slope",)),
        "explained",
        MISSES + "slope explains it.",
        NEW + "slope" + DATA,
        id="one name",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("slope", "crust")),
        "explained",
        MISSES + "one of slope and crust explains it; these data cannot tell which.",
        NEW + "--until-quiet" + DATA,
        id="a family",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("slope", "crust"), drive="drive uphill"),
        "explained",
        MISSES + "one of slope and crust explains it; these data cannot tell which. "
        "First record this drive, and diagnose both logs together: drive uphill.",
        NEW + "--until-quiet" + DATA,
        id="a family that a drive settles",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("slope", "crust"), checks=("weigh it",)),
        "explained",
        MISSES + "one of slope and crust explains it; these data cannot tell which. "
        "No drive can tell all of them apart. First weigh it. Without that, the next command",
        NEW + "--until-quiet" + DATA,
        id="a family that a sensor's check settles",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("slope",), checks=("weigh it",)),
        "explained",
        MISSES
        + "slope explains it, but this is not certain. No drive can rule out all others. First weigh it.",
        NEW + "slope" + DATA,
        id="one of which the others are doubted",
    ),
    pytest.param(
        evidence(
            OFF,
            raised=True,
            verdict="family",
            family=("slope", "crust", "load-bias"),
            drive="drive uphill",
            checks=("weigh it",),
        ),
        "explained",
        MISSES + "one of slope, crust and load-bias explains it; these data cannot tell which. "
        "First record this drive, and diagnose both logs together: drive uphill. "
        "Also weigh it: the drive alone does not tell all of them apart. Without that, the next command",
        NEW + "--until-quiet" + DATA,
        id="a family that both settle",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("slope", "crust"), share=0.97, leaves=True),
        "explained",
        MISSES + "one of slope and crust explains most of it; these data cannot tell which.",
        NEW + "--until-quiet" + DATA,
        id="a family that leaves more than noise",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("slope",)),
        "explained",
        MISSES + "slope explains it, but this is not certain.",
        NEW + "slope" + DATA,
        id="not sure",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("p", "q", "r"), together=("p", "q")),
        "explained",
        MISSES + "p and q together explain it best.",
        NEW + "p q" + DATA,
        id="two",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="unknown", law="torque follows wind"),
        "explained",
        MISSES + "no effect of the catalogue explains it: torque follows wind.",
        LOOK + " --draft law.toml",
        id="a law",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="unknown", draft="law.toml"),
        "explained",
        MISSES + "no effect of the catalogue explains it.",
        NEW + "law.toml" + DATA,
        id="a law that was written",
    ),
]
