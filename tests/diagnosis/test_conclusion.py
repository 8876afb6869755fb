"""What every verb says at its end is a function of the evidence, and nothing else: as a table."""

import math
from types import SimpleNamespace

import pytest

from terrain_cli.diagnosis.conclusion import conclude
from terrain_cli.diagnosis.diagnosis_outcome import Asked, NextDrive, UnknownEffect
from terrain_cli.diagnosis.evidence import Evidence
from terrain_cli.models import Refused

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
            evidence(
                OFF, raised=True, verdict="effect", family=("slope",), fewer=1, soils=2, changes=("8 s",)
            ),
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
            evidence(
                FINE, raised=True, verdict="family", family=("slope", "crust"), refused=("slope", "crust")
            ),
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
            UNFIT + "6 independent stretches of data are too few to show why. Record a longer drive.",
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
        pytest.param(
            evidence(OFF, raised=True, verdict="effect", family=("slope",), share=0.53),
            "explained",
            MISSES + "slope explains most of it.",
            NEW + "slope" + DATA,
            id="one name for a part",
        ),
        pytest.param(
            evidence(OFF, raised=True, verdict="effect", family=("slope",), share=0.31),
            "explained",
            MISSES + "slope explains a part of it.",
            NEW + "slope" + DATA,
            id="a part",
        ),
        pytest.param(
            evidence(UNKNOWN, points=True),
            "undecided",
            "The data show no missing effect, but the noise of torque is not known",
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
            "The data show no missing effect, but the noise of torque is not known",
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


DOUBTED = ("the sign of torque", "the unit of load")


@pytest.mark.parametrize(
    "further",
    [
        {},
        {"raised": True, "verdict": "effect", "family": ("slope",)},
        {"raised": True, "verdict": "unknown", "draft": "law.toml"},
        {"raised": True, "tracked": True, "stretch": (40.0, 59.95)},
        {"raised": True, "refused": ("slope",)},
        {"blocks": 3},
    ],
)
def test_what_may_be_measured_wrongly_is_settled_before_an_effect_explains_it(further):
    told = conclude(evidence(OFF, doubted=DOUBTED, **further), ASKED)
    assert told.sentence.startswith(
        MISSES + "the sign of torque and the unit of load may be wrong: if so, put the line"
    )
    assert told.command == "terrain-est compare 'a run.csv' --segments none"
    assert told.drive == ""


def test_what_is_doubted_of_a_model_that_fits_is_left_to_the_note():
    assert conclude(evidence(FINE, doubted=DOUBTED), ASKED).state == "fits"


STRETCH = {"raised": True, "tracked": True, "stretch": (40.0, 59.95)}


@pytest.mark.parametrize("further", [{}, {"verdict": "family", "family": ("slope", "crust"), "share": 0.1}])
def test_a_stretch_that_differs_is_left_out_and_the_rest_compared(further):
    told = conclude(evidence(OFF, **STRETCH, **further), ASKED)
    assert told.sentence.startswith(MISSES + "most of all from 40 s to 59.95 s: find out what happened then")
    condition = "time < 40 or time > 59.95"
    assert told.command == f"terrain-est compare 'a run.csv' --segments none --where '{condition}'"
    before = Asked(inputs=("run.csv",), options=("--where", "load > 50"))
    command = conclude(evidence(OFF, **STRETCH, **further), before).command
    assert command == f"terrain-est compare run.csv --where '(load > 50) and ({condition})'"


def test_a_step_with_time_is_told_once_no_effect_explains_it():
    """A zero that jumps. A soil, a second pass or a motor may as well: so a diagnosis comes first."""
    steps = {"raised": True, "tracked": True, "stretch": (40.0, math.inf)}
    assert conclude(evidence(OFF, **steps), ASKED).command == LOOK
    told = conclude(evidence(OFF, **steps, verdict="unknown", law="torque follows load"), ASKED)
    assert told.sentence.startswith(MISSES + "most of all after 40 s: find out what happened then")
    assert told.command == "terrain-est compare 'a run.csv' --segments none --where 'time < 40'"
    named = {"verdict": "effect", "family": ("multi-pass",), "share": 0.9}
    assert conclude(evidence(OFF, **steps, **named), ASKED).command.startswith(NEW + "multi-pass")


@pytest.mark.parametrize("verdict", [None, "none"])
def test_a_stretch_is_told_too_where_a_diagnosis_finds_no_effect(verdict):
    told = conclude(evidence(OFF, **{**STRETCH, "raised": verdict is None}, verdict=verdict), ASKED)
    assert "most of all from 40 s to 59.95 s: find out what happened then" in told.sentence
    assert told.command.endswith("--where 'time < 40 or time > 59.95'")


@pytest.mark.parametrize(
    ("driver", "form", "explained", "command"),
    [
        ("time", "saturating", 0.99, LOOK + " --draft law.toml"),
        ("board V", "step", 0.99, LOOK + " --draft law.toml"),
        ("board V", "step", 0.3, "terrain-est compare 'a run.csv' --segments none --where 'time < 40'"),
        ("time", "step", 0.99, "terrain-est compare 'a run.csv' --segments none --where 'time < 40'"),
    ],
)
def test_a_law_that_explains_most_is_more_than_a_stretch_unless_it_is_that_stretch(
    driver, form, explained, command
):
    """What drifts is off most of all at one end: to leave out half of a log again and again ends nowhere."""
    law = UnknownEffect(
        channel="sinkage", driver=driver, form=form, explained=explained, law="", sentence="", draft=""
    )
    found = diagnosis(verdict="unknown", family=(), unknown=law, stretch=(40.0, math.inf))
    assert conclude(Evidence.of_diagnosis(found), ASKED).command == command


def test_an_effect_that_explains_most_is_more_than_a_stretch():
    named = {"verdict": "effect", "family": ("slope",), "share": 0.9}
    assert conclude(evidence(OFF, **STRETCH, **named), ASKED).command.startswith(NEW + "slope")


def test_after_a_loop_that_found_nothing_none_is_proposed():
    """Nor a diagnosis, which would propose the same again."""
    raised = {"raised": True, "tracked": True}
    tried = conclude(evidence(OFF, **raised, refused=("slope",)), ASKED)
    assert tried.command == NEW + "--until-quiet" + DATA
    for refused in ((), ("slope",)):
        told = conclude(evidence(OFF, **raised, refused=refused, ended=True), ASKED)
        assert (told.state, told.command) == ("unexplained", "")
    # What the loop says at its end, from its diagnosis, `compare` says of the same model afterwards.
    for ratios in (OFF, FINE):
        for tried in ((), ("slope",)):
            last = evidence(ratios, tracked=True, verdict="none", refused=tried, unrecorded=("pitch",))
            now = evidence(
                ratios, raised=True, tracked=True, refused=tried, ended=True, unrecorded=("pitch",)
            )
            assert conclude(last, ASKED).sentence == conclude(now, ASKED).sentence
    after = {"raised": True, "refused": ("slope",), "ended": True}
    loop = {"verdict": "effect", "family": ("slope",)}
    told = conclude(evidence(FINE, **after), ASKED)
    assert told.sentence == conclude(evidence(FINE, **after, **loop), ASKED).sentence
    assert told.sentence.startswith("The model fits as well as these data can tell: ")
    # A law that was drafted after that was not tried.
    law = {"verdict": "unknown", "law": "torque follows load", "refused": ("slope",), "ended": True}
    assert conclude(evidence(OFF, raised=True, **law), ASKED).command.endswith("--draft law.toml")


def test_what_a_finding_tracks_was_recorded_though_no_effect_explains_it():
    told = conclude(evidence(OFF, verdict="none", tracked=True), ASKED).sentence
    assert told.startswith(f"{UNFIT}the residuals are systematic, but no effect explains them significantly.")


@pytest.mark.parametrize(("blocks", "state"), [(20, "fits"), (400, "unexplained")])
def test_few_test_points_have_larger_errors_by_chance(blocks, state):
    """The noise of 20 pairs is known by 16 %, and the error by 11 %."""
    ratios = {"torque": 1.0, "drawbar pull": 1.3, "sinkage": 1.02}
    told = conclude(evidence(ratios, points=True, blocks=blocks), ASKED)
    assert told.state == state
    assert ("(in drawbar pull), as is to be expected by chance with so few points" in told.sentence) == (
        state == "fits"
    )
    assert conclude(evidence(ratios, blocks=blocks), ASKED).state == "unexplained"


def test_where_the_pull_alone_is_off_it_is_not_the_soil():
    """Another soil would show in torque or sinkage too."""
    ratios = {"torque": 1.0, "drawbar pull": 21.0, "sinkage": 1.02}
    told = conclude(evidence(ratios, verdict="none"), ASKED).sentence
    assert "Torque and sinkage fit, so look for something that acts on the drawbar pull alone: a" in told
    # A torque that is cut off, or a soil that changes, shows most in the pull too.
    shared = {"torque": 1.1, "drawbar pull": 1.2, "sinkage": 1.02}
    assert "on the pull alone" not in conclude(evidence(shared, verdict="none"), ASKED).sentence
    assert "soil" not in told
    # Alone it tells nothing of what else fits.
    assert AGAIN in conclude(evidence({"drawbar pull": 21.0}, verdict="none"), ASKED).sentence


def test_the_next_command_changes_the_file_that_is_there():
    told = conclude(evidence(OFF, raised=True, verdict="effect", family=("slope",)), FILE)
    assert told.command == "terrain-est model add rig.toml slope --data run.csv"
    assert conclude(evidence(OFF), FILE).command == "terrain-est diagnose run.csv --model rig.toml"


def test_without_drawbar_pull_it_says_what_would_not_show():
    """A torque that is off by a constant is cohesion then, a load by a factor friction."""
    told = conclude(evidence(FINE), ASKED).sentence
    assert told.endswith("or a wrong zero or gain of the load would look much like another soil.")
    # What is in the model has shown.
    found = conclude(evidence(FINE, effects=("drivetrain-friction", "load-bias")), ASKED).sentence
    assert found.endswith(
        "Without drawbar pull, a wrong gain of the torque would look much like another soil."
    )
    every = ("drivetrain-friction", "load-bias", "gear-efficiency")
    assert conclude(evidence(FINE, effects=every), ASKED).sentence.endswith("no missing effect.")
    pulled = conclude(evidence({**FINE, "drawbar pull": 0.99}), ASKED).sentence
    assert "drawbar" not in pulled.split("data show")[1]


def test_a_base_that_is_not_the_usual_one_is_named():
    asked = Asked(inputs=("run.csv",), model="linear")
    told = conclude(evidence(OFF, raised=True, verdict="effect", family=("slope",)), asked)
    assert told.command.startswith("terrain-est model new model.toml --base linear && ")
    assert conclude(evidence(OFF), asked).command.endswith("--model linear")


def compared_to(channels, **further):
    known = {"blocks": 20, "stretch": None, "doubted": (), "refused": Refused(), "points": False}
    known |= {"soil_count": 0, "soil_changes": [], "wheels": [None], "unsorted": False, "impossible": ()}
    model = {"base": "wong-reece", "effects": []}
    return SimpleNamespace(model=model, channels=channels, **{**known, "failures": [], **further})


@pytest.mark.parametrize(("amplitude", "raised"), [(0.002, False), (-0.002, False), (0.004, True)])
def test_a_finding_too_small_for_an_alarm_of_diagnose_raises_none_in_compare(amplitude, raised):
    # A torque of 1 N m, of which diagnose asks for 0.3 %.
    torque = SimpleNamespace(rmse=0.01, nrmse=0.01, noise=0.01, heldout_rmse=0.0102)
    finding = SimpleNamespace(channel="torque", amplitude=amplitude)
    found = compared_to({"torque": torque}, failures=[finding], scores=None)
    assert Evidence.of_comparison(found).raised is raised


def diagnosis(*, stretch=None, **known):
    torque = SimpleNamespace(noise=1.0, heldout_rmse=5.0)
    usual = {
        "alarm": SimpleNamespace(raised=True, small=False),
        "unknown": None,
        "together": (),
        "together_or": (),
        "candidates": [],
        "next_drive": [],
        "unrecorded": (),
        "heldout": {},
        "soils": 0,
    }
    return SimpleNamespace(comparison=compared_to({"torque": torque}, stretch=stretch), **{**usual, **known})


def test_effects_of_a_doubtful_size_explain_nothing():
    names = ("slope", "crust", "hardpan")
    doubts = ("", "at its bound", "")
    found = diagnosis(
        verdict="family",
        family=names,
        candidates=[
            SimpleNamespace(
                effect=name, doubt=doubt, explained=0.9, heldout={"torque": 1.6}, noise={}, settles=False
            )
            for name, doubt in zip(names, doubts, strict=True)
        ],
        next_drive=[
            NextDrive(("slope", "crust"), "drive over firm ground", 0.9, settings={"part": []}),
            NextDrive(("slope", "hardpan"), "no drive tells", 0.1, check="weigh it"),
        ],
    )
    evidence = Evidence.of_diagnosis(found)
    assert evidence.family == ("slope", "hardpan")
    assert evidence.leaves
    assert (evidence.drive, evidence.checks) == ("", ("weigh it",))
    for one in found.candidates:
        # A twelfth of the error: the noise differs by as much between models.
        one.doubt, one.heldout = "at its bound", {"torque": 1.3}
    assert not Evidence.of_diagnosis(found).leaves
    assert Evidence.of_diagnosis(found).family == names


@pytest.mark.parametrize(
    ("noise", "heldout", "told"),
    [
        (
            2.0,
            4.4,
            "2.2 × the noise in torque (noise of torque as estimated with sensor-lag), and sensor-lag",
        ),
        (3.9, 4.4, "at most 1.10 × the noise (in torque) but systematic, and sensor-lag explains"),
        # Where compare sees it too, both say the same.
        (2.0, 10.0, "2.5 × the noise in torque, and sensor-lag explains"),
    ],
)
def test_a_misfit_that_passed_for_noise_is_none(noise, heldout, told):
    """The jumps that a lag leaves; noise differs by some percent between models that miss nothing."""
    found = SimpleNamespace(
        comparison=compared_to({"torque": SimpleNamespace(noise=4.0, heldout_rmse=heldout)}),
        alarm=SimpleNamespace(raised=True, small=False),
        verdict="effect",
        unknown=None,
        family=("sensor-lag",),
        together=(),
        together_or=(),
        candidates=[
            SimpleNamespace(
                effect="sensor-lag",
                doubt="",
                explained=0.9,
                heldout={"torque": 2.0},
                noise={"torque": noise},
                settles=False,
            )
        ],
        next_drive=[],
        unrecorded=(),
        heldout={},
        soils=0,
    )
    assert told in conclude(Evidence.of_diagnosis(found), ASKED).sentence


@pytest.mark.parametrize(
    ("settles", "heldout", "left"),
    [
        (True, 1.0, ("the unit of load",)),
        (False, 1.0, ("the unit of torque", "the unit of load")),
        # What an effect leaves much of is not explained by it.
        (True, 3.0, ("the unit of torque", "the unit of load")),
    ],
)
def test_an_effect_that_explains_the_misfit_removes_the_doubt_of_a_unit(settles, heldout, left):
    torque = SimpleNamespace(noise=1.0, heldout_rmse=5.0)
    warm = SimpleNamespace(effect="motor-temperature", doubt="", explained=1.0, noise={}, settles=settles)
    warm.heldout = {"torque": heldout}
    found = SimpleNamespace(
        comparison=compared_to({"torque": torque}, doubted=("the unit of torque", "the unit of load")),
        alarm=SimpleNamespace(raised=True, small=False),
        verdict="effect",
        unknown=None,
        family=("motor-temperature",),
        together=(),
        together_or=(),
        candidates=[warm],
        next_drive=[],
        unrecorded=(),
        heldout={},
        soils=0,
    )
    assert Evidence.of_diagnosis(found).doubted == left
