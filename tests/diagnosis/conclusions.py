"""Evidence, and what is concluded from it."""

import math

import pytest

from terrain_cli.diagnosis.diagnosis_outcome import Asked
from terrain_cli.diagnosis.evidence import Evidence

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
    "physically impossible: something is missing that the soil takes up, or a sensor is wrong."
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
        SMALL + "only with 2 soils; fewer may be enough with multi-pass.",
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
        "The model may miss something: the held-out error is at most 1.02 × the noise (in torque) but "
        "systematic, and slope explains it.",
        NEW + "slope" + DATA,
        id="one name within the noise",
    ),
    pytest.param(
        evidence(FINE, raised=True, verdict="family", family=("slope", "crust"), refused=("slope", "crust")),
        "unexplained",
        "The model fits as well as these data can tell: the held-out error is at most 1.02 × the noise "
        "(in torque). What is left may be systematic, but slope and crust were tried, and "
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
    pytest.param(
        evidence(OFF),
        "unexplained",
        UNFIT + "a first check of the effects finds no cause.",
        LOOK,
        id="scores silent",
    ),
    pytest.param(
        evidence(OFF, verdict="none", unrecorded=("pitch", "slip_angle")),
        "unexplained",
        UNFIT
        + "no recorded channel tracks the misfit significantly. "
        + AGAIN
        + " changes, the soil varies; if it returns, the model lacks something. Also record "
        + "a channel that effects need: pitch or slip angle.",
        "",
        id="nothing follows",
    ),
    pytest.param(
        evidence(OFF, verdict="none", points=True),
        "unexplained",
        UNFIT
        + "no recorded channel tracks the misfit significantly. Repeat the test points on fresh soil: if",
        "",
        id="nothing follows of test points",
    ),
    pytest.param(
        evidence(OFF, verdict="none"),
        "unexplained",
        UNFIT + "no recorded channel tracks the misfit significantly. " + AGAIN,
        "",
        id="all is recorded",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="family", family=("slope",), refused=("slope",)),
        "unexplained",
        UNFIT + "slope was tried, and held-out data do not support it.",
        "",
        id="tried, and did not pay",
    ),
    pytest.param(
        evidence(
            OFF,
            raised=True,
            verdict="family",
            family=("slope",),
            refused=("slope",),
            drive="climb a hill",
        ),
        "unexplained",
        UNFIT
        + "slope was tried, and held-out data do not support it. To test slope again, record this drive, "
        "and diagnose both logs together: climb a hill.",
        "",
        id="tried, and a drive can tell",
    ),
    pytest.param(
        evidence(OFF, raised=True, verdict="unknown", refused=("law.toml",)),
        "unexplained",
        UNFIT + "law.toml was tried, and held-out data do not support it.",
        "",
        id="a law that did not pay",
    ),
    pytest.param(
        evidence(OFF, raised=True, tracked=True, refused=("stiffness-with-load",)),
        "unexplained",
        UNFIT + "stiffness-with-load was tried, and held-out data do not support it. " + AGAIN,
        "",
        id="a law that a diagnosis drafted before",
    ),
    pytest.param(
        evidence(UNKNOWN, points=True, refused=("slope",)),
        "undecided",
        "The data show no missing effect, but the noise of torque is not known: repeat some test points",
        "",
        id="noise of test points unknown, one was tried",
    ),
    pytest.param(
        evidence(OFF, raised=True, refused=("slope",)),
        "unexplained",
        UNFIT + "slope was tried, and held-out data do not support it.",
        NEW + "--until-quiet" + DATA,
        id="scores, one was tried",
    ),
    pytest.param(
        evidence(OFF, refused=("slope",)),
        "unexplained",
        UNFIT + "slope was tried, and held-out data do not support it.",
        NEW + "--until-quiet" + DATA,
        id="scores silent, one was tried",
    ),
    pytest.param(
        evidence(FINE, tracked=True, verdict="none"),
        "unexplained",
        f"The model fits as well as these data can tell: {SMALLEST}. What is left may be systematic, but "
        "no effect explains it.",
        "",
        id="a finding that no effect explains, within the noise",
    ),
    pytest.param(
        evidence(FINE, weak="slope (p 0.002)"),
        "fits",
        f"The model fits to within the noise: {SMALLEST}. What is left follows slope (p 0.002), but no "
        "held-out error falls with so small an effect: the noise of load, slip and sinkage hides it.",
        "",
        id="noise, which hides a small effect",
    ),
    pytest.param(
        evidence({**FINE, "drawbar pull": 1.0}, effects=("crust",), absent=("crust",)),
        "fits",
        f"{FITS} It fits as well without crust, of which it has none.",
        OUT,
        id="noise, with an effect that does nothing",
    ),
    pytest.param(
        evidence(FINE, effects=("crust",), beyond={"crust": "crust.strength = 9 Pa, which is its bound"}),
        "unexplained",
        f"The model fits to within the noise: {SMALLEST}, but only with crust.strength = 9 Pa, which is its "
        "bound: crust stands for something else. Take it out to see what is missing.",
        OUT,
        id="noise, with an effect at its bound",
    ),
    pytest.param(
        evidence(FINE, impossible=("a cohesion of -3 kPa",)),
        "unexplained",
        f"{NO_SOIL}",
        LOOK,
        id="noise, on a soil that there is not",
    ),
    pytest.param(
        evidence(FINE, impossible=("a cohesion of -3 kPa",), verdict="none"),
        "unexplained",
        f"{NO_SOIL} Check zero and gain of each sensor",
        "",
        id="noise, on a soil that there is not, diagnosed",
    ),
    pytest.param(
        evidence(OFF, blocks=6),
        "unexplained",
        UNFIT + "a first check of the effects finds no cause.",
        LOOK,
        id="few blocks, scores",
    ),
    pytest.param(
        evidence(OFF, blocks=6, verdict="none"),
        "unexplained",
        UNFIT
        + "6 independent stretches of data are too few to show why. Record a drive at least 2 times as long.",
        "",
        id="few blocks",
    ),
    pytest.param(
        evidence(OFF, blocks=6, verdict="none", points=True),
        "unexplained",
        UNFIT + "6 independent stretches of data are too few to show why. Measure more test points.",
        "",
        id="few test points",
    ),
    pytest.param(
        evidence(OFF, verdict="none", closest="slope"),
        "unexplained",
        UNFIT + "no effect explains it significantly; held-out data can test slope.",
        NEW + "slope" + DATA,
        id="by chance or not",
    ),
    *(
        pytest.param(
            evidence(OFF, raised=True, verdict="effect", family=("slope",), share=share),
            "explained",
            MISSES + f"slope explains {part} of it.",
            NEW + "slope" + DATA,
            id=f"one name for {part}",
        )
        for share, part in ((0.53, "most"), (0.31, "a part"))
    ),
    *(
        pytest.param(
            evidence(UNKNOWN, points=points),
            "undecided",
            "The data show no missing effect, but the noise of torque is not known",
            command,
            id=f"noise{' of test points' * points} unknown",
        )
        for points, command in ((True, LOOK), (False, ""))
    ),
    pytest.param(
        evidence(OFF, blocks=3, raised=True),
        "undecided",
        "3 independent stretches of data are too few to tell whether the model misses something. "
        "The held-out error is 8.6 × the noise in torque and 12 × in sinkage. "
        "Record a drive at least 3 times as long.",
        "",
        id="too few blocks",
    ),
]
