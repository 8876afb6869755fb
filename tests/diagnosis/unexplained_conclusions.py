"""What is concluded where nothing explains a misfit, or too little is known."""

import pytest
from conclusions import (
    AGAIN,
    DATA,
    FINE,
    FITS,
    LOOK,
    MISSES,
    NEW,
    NO_SOIL,
    OFF,
    OUT,
    SMALLEST,
    UNFIT,
    UNKNOWN,
    evidence,
)

#: As `CONCLUSIONS`.
UNEXPLAINED = [
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
        + " changes, the soil varies; if it stays the same, the model lacks something. Also record "
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
        evidence(OFF, raised=True, refused=("slope",), unconfirmed=True),
        "unexplained",
        UNFIT + "slope was tried, and another drive does not confirm it.",
        LOOK,
        id="another drive speaks against it",
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
        f"The model fits as well as these data can tell: {SMALLEST}. The residuals may be systematic, but "
        "no effect explains it.",
        "",
        id="a finding that no effect explains, within the noise",
    ),
    pytest.param(
        evidence(FINE, weak="slope (p 0.002)"),
        "fits",
        f"The model fits to within the noise: {SMALLEST}. The residuals look like slope (p 0.002), "
        "but so small an effect lowers no held-out error: the noise of load, slip and sinkage hides it.",
        "",
        id="noise, which hides a small effect",
    ),
    pytest.param(
        evidence({**FINE, "drawbar pull": 1.0}, effects=("crust",), absent=("crust",)),
        "fits",
        f"{FITS} It fits as well without crust, which does nothing at its fitted size.",
        OUT,
        id="noise, with an effect that does nothing",
    ),
    pytest.param(
        evidence(FINE, effects=("crust",), beyond={"crust": "crust.strength = 9 Pa, which is its bound"}),
        "unexplained",
        f"The model fits to within the noise: {SMALLEST}, but only with crust.strength = 9 Pa, which is its "
        "bound: crust imitates something else. To see what is missing, remove it.",
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
