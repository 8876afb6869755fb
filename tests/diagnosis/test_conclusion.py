"""What every verb says at its end is a function of the evidence, and nothing else: as a table."""

import math

import pytest
from conclusions import AGAIN, ASKED, CONCLUSIONS, DATA, FILE, FINE, LOOK, MISSES, NEW, OFF, UNFIT, evidence
from unexplained_conclusions import UNEXPLAINED

from terrain_cli.diagnosis.conclusion import conclude
from terrain_cli.vocabulary.next_commands import Asked


@pytest.mark.parametrize(("found", "state", "begins", "command"), [*CONCLUSIONS, *UNEXPLAINED])
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
        MISSES + "the sign of torque and the unit of load may be wrong: if so, copy the line"
    )
    assert told.command == "terrain-est compare 'a run.csv' --segments none"
    assert told.drive == ""


def test_what_is_doubted_of_a_model_that_fits_is_left_to_the_note():
    assert conclude(evidence(FINE, doubted=DOUBTED), ASKED).state == "fits"


@pytest.mark.parametrize(
    ("ratios", "begins"),
    [(OFF, MISSES), (FINE, "The model may miss something: the held-out error is at most 1.02 × the noise")],
)
@pytest.mark.parametrize("verdict", [None, "none"])
def test_samples_in_which_a_sensor_is_at_its_limit_are_left_out_first(ratios, begins, verdict):
    """What they miss of the model may pass for noise: that it fits is no proof."""
    limits = ("torque < 4.99", "load > 10")
    told = conclude(evidence(ratios, at_limit=limits, verdict=verdict), ASKED)
    assert told.sentence.startswith(begins)
    why = "the sensor of torque and load may be stuck, or at its limit: leave these samples out."
    assert why in told.sentence
    condition = "(torque < 4.99) and (load > 10)"
    assert told.command == f"terrain-est compare 'a run.csv' --segments none --where '{condition}'"


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
    # Also where what it looks at shows nothing, or an effect that lowers no error.
    for weak in ("", "crust (p 0.005)"):
        now = evidence(FINE, refused=("slope",), ended=True, weak=weak)
        assert conclude(now, ASKED).sentence == told.sentence
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


def test_a_command_that_needs_standard_input_anew_says_so():
    """Pasted alone it would wait for the data; two commands behind a pipe get them only in brackets."""
    piped = Asked(inputs=("-",))
    told = conclude(evidence(OFF, raised=True), piped)
    assert told.command == "terrain-est diagnose -"
    assert told.sentence == f"{told.lead} Next, with the same data on standard input: {told.command}"
    assert told.lead == conclude(evidence(OFF, raised=True), Asked(inputs=("run.csv",))).lead
    made = conclude(evidence(OFF, raised=True, verdict="effect", family=("slope",)), piped).command
    add = "terrain-est model add model.toml slope --data -"
    assert made == f"(terrain-est model new model.toml && {add})"
    file = Asked(inputs=("-",), model="rig.toml")
    assert file.added(["slope"]) == add.replace("model.toml", "rig.toml")
