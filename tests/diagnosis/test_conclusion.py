"""What every verb says at its end is a function of the evidence, and nothing else: as a table."""

import math
from types import SimpleNamespace

import pytest

from terrain_cli.diagnosis.conclusion import Asked, Evidence, conclude, of_comparison, of_diagnosis

ASKED = Asked(inputs=("a run.csv",), options=("--segments", "none"))
FILE = Asked(inputs=("run.csv",), model="rig.toml")
OFF = {"torque": 8.64, "drawbar pull": 1.1, "sinkage": 12.2}
FINE = {"torque": 1.02, "sinkage": 0.98}
UNKNOWN = {"torque": math.nan}
MISSES = (
    "The model misses something: the held-out error is 8.6 × the noise in torque and 12 × in sinkage, and "
)
SMALL = (
    "The model misses something: the held-out error is at most 1.02 × the noise (in torque) but not random, "
    "and "
)
FITS = (
    "The model fits to the noise: the held-out error is at most 1.02 × the noise (in torque), and no effect"
)
LOOK = "terrain-est diagnose 'a run.csv' --segments none"
NEW = "terrain-est model new model.toml && terrain-est model add model.toml "
DATA = " --segments none --data 'a run.csv'"


def evidence(ratios, **known):
    return Evidence(**{"ratios": ratios, "blocks": 20, "raised": False, **known})


@pytest.mark.parametrize(
    ("found", "state", "begins", "command"),
    [
        pytest.param(evidence(FINE), "fits", FITS, "", id="noise, by scores"),
        pytest.param(evidence(FINE, verdict="none"), "fits", FITS, "", id="noise, by a diagnosis"),
        pytest.param(
            evidence(OFF, raised=True),
            "explained",
            MISSES + "it follows what was recorded.",
            LOOK,
            id="scores",
        ),
        pytest.param(
            evidence(FINE, raised=True),
            "explained",
            SMALL + "it follows what",
            LOOK,
            id="scores beyond noise",
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
            "First take this drive, and diagnose both logs together: drive uphill.",
            NEW + "--until-quiet" + DATA,
            id="a family that a drive settles",
        ),
        pytest.param(
            evidence(OFF, raised=True, verdict="family", family=("slope",)),
            "explained",
            MISSES + "slope explains it best, but this is not certain.",
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
            MISSES + "a first check of the effects finds no cause.",
            LOOK,
            id="scores silent",
        ),
        pytest.param(
            evidence(OFF, verdict="none", unrecorded=("pitch", "slip_angle")),
            "unexplained",
            MISSES + "nothing that was recorded explains it beyond chance. "
            "Also record a channel that effects need: pitch or slip angle.",
            "",
            id="nothing follows",
        ),
        pytest.param(
            evidence(OFF, verdict="none"),
            "unexplained",
            MISSES + "nothing that was recorded explains it beyond chance. Drive the same track again. "
            "If the misfit returns, the model lacks something; if it changes, the soil varies.",
            "",
            id="all is recorded",
        ),
        pytest.param(
            evidence(OFF, raised=True, verdict="family", family=("slope",), refused=("slope",)),
            "unexplained",
            MISSES + "slope lowered it no more than chance may.",
            "",
            id="tried, and did not pay",
        ),
        pytest.param(
            evidence(OFF, raised=True, verdict="unknown", refused=("law.toml",)),
            "unexplained",
            MISSES + "law.toml lowered it no more than chance may.",
            "",
            id="a law that did not pay",
        ),
        pytest.param(
            evidence(OFF, raised=True, refused=("slope",)),
            "unexplained",
            MISSES + "slope lowered it no more than chance may.",
            NEW + "--until-quiet" + DATA,
            id="scores, one was tried",
        ),
        pytest.param(
            evidence(OFF, refused=("slope",)),
            "unexplained",
            MISSES + "slope lowered it no more than chance may.",
            NEW + "--until-quiet" + DATA,
            id="scores silent, one was tried",
        ),
        pytest.param(
            evidence(OFF, blocks=6),
            "unexplained",
            MISSES + "a first check of the effects finds no cause.",
            LOOK,
            id="few blocks, scores",
        ),
        pytest.param(
            evidence(OFF, blocks=6, verdict="none"),
            "unexplained",
            MISSES + "6 independent stretches of data are too few to show why. Record a longer drive.",
            "",
            id="few blocks",
        ),
        pytest.param(
            evidence(OFF, blocks=6, verdict="none", points=True),
            "unexplained",
            MISSES + "6 independent stretches of data are too few to show why. Measure more test points.",
            "",
            id="few test points",
        ),
        pytest.param(
            evidence(OFF, verdict="none", closest="slope"),
            "unexplained",
            MISSES + "no effect explains it beyond chance, but slope may: held-out data can judge it.",
            NEW + "slope" + DATA,
            id="by chance or not",
        ),
        pytest.param(
            evidence(OFF, raised=True, verdict="effect", family=("slope",), share=0.53),
            "explained",
            MISSES + "slope explains 53% of it.",
            NEW + "slope" + DATA,
            id="one name for a part",
        ),
        pytest.param(
            evidence(UNKNOWN, points=True),
            "undecided",
            "No effect stands out, but the noise of torque is not known.",
            LOOK,
            id="noise of test points unknown",
        ),
        pytest.param(
            evidence(OFF, blocks=3, raised=True),
            "undecided",
            "3 independent stretches of data are too few to tell whether the model misses something. "
            "The held-out error is 8.6 × the noise in torque and 12 × in sinkage. Record a longer drive.",
            "",
            id="too few blocks",
        ),
        pytest.param(
            evidence(UNKNOWN),
            "undecided",
            "No effect stands out, but the noise of torque is not known.",
            "",
            id="noise unknown",
        ),
    ],
)
def test_the_same_evidence_has_the_same_conclusion(found, state, begins, command):
    told = conclude(found, ASKED)
    assert told.state == state
    assert told.sentence.startswith(begins)
    assert told.command == command
    assert told.sentence.endswith(command)


def test_the_next_command_changes_the_file_that_is_there():
    told = conclude(evidence(OFF, raised=True, verdict="effect", family=("slope",)), FILE)
    assert told.command == "terrain-est model add rig.toml slope --data run.csv"
    assert conclude(evidence(OFF), FILE).command == "terrain-est diagnose run.csv --model rig.toml"


def test_a_base_that_is_not_the_usual_one_is_named():
    asked = Asked(inputs=("run.csv",), model="linear")
    told = conclude(evidence(OFF, raised=True, verdict="effect", family=("slope",)), asked)
    assert told.command.startswith("terrain-est model new model.toml --base linear && ")
    assert conclude(evidence(OFF), asked).command.endswith("--model linear")


@pytest.mark.parametrize(("amplitude", "raised"), [(0.002, False), (-0.002, False), (0.004, True)])
def test_a_finding_too_small_for_an_alarm_of_diagnose_raises_none_in_compare(amplitude, raised):
    # A torque of 1 N m, of which diagnose asks for 0.3 %.
    torque = SimpleNamespace(rmse=0.01, nrmse=0.01, noise=0.01, heldout_rmse=0.0102)
    finding = SimpleNamespace(channel="torque", amplitude=amplitude)
    found = SimpleNamespace(
        channels={"torque": torque}, failures=[finding], blocks=20, scores=None, wheels=[]
    )
    assert of_comparison(found).raised is raised


@pytest.mark.parametrize(
    ("channel", "driver", "law"),
    [
        ("drawbar_pull", "yaw_rate", "drawbar pull follows yaw rate"),
        ("slip", "slip", "slip is off by a constant and a factor"),
        ("torque", "", ""),
    ],
)
def test_a_drafted_law_in_a_few_words(channel, driver, law):
    found = SimpleNamespace(
        comparison=SimpleNamespace(channels={}, blocks=20, wheels=[]),
        alarm=SimpleNamespace(raised=True, small=False),
        verdict="unknown",
        unknown=SimpleNamespace(channel=channel, driver=driver),
        family=(),
        together=(),
        candidates=[],
        next_drive=[],
        unrecorded=(),
    )
    assert of_diagnosis(found).law == law
