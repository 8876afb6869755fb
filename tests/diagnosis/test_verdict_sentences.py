"""What a diagnosis says first is what who looks at the errors finds there."""

from types import SimpleNamespace

import pytest

from terrain_cli.diagnosis import verdict

THROUGHOUT = "the model predicts 4.3 mm too little sinkage throughout"
ALONG_SLIP = "the model predicts 8.2 N too much drawbar pull at slip 0.6, compared with 0"


def diagnosed(heldout, verdict="effect", together=()):
    """Return a diagnosis of noise 0.4 N m, 3.5 N, 0.6 mm."""
    noise = {"torque": 0.4, "drawbar_pull": 3.5, "sinkage": 6e-4}
    candidate = SimpleNamespace(effect="gear-efficiency", sizes={}, doubt="", in_family=True, explained=0.9)
    return SimpleNamespace(
        verdict=verdict,
        comparison=SimpleNamespace(
            channels={
                name: SimpleNamespace(noise=size, heldout_rmse=error)
                for (name, size), error in zip(noise.items(), heldout, strict=True)
            },
            stretch=None,
        ),
        candidates=[candidate],
        family=together or ("gear-efficiency",),
        unknown=None,
        together=together,
        together_or=(),
        pair=None,
    )


def found(channel, sentence, share):
    return SimpleNamespace(channel=channel, sentence=sentence, share=share)


def said(heldout, *failures, changed=()):
    text = verdict.sentence(diagnosed(heldout), failures, changed)
    return text[: text.index(" Most likely cause: gear-efficiency")]


def test_a_misfit_that_the_soil_moved_to_another_channel_is_told_where_it_is():
    findings = found("sinkage", THROUGHOUT, 0.93), found("drawbar_pull", ALONG_SLIP, 0.04)
    told = "The held-out error of drawbar pull is 13 N, 3.7 × its noise."
    assert said((0.42, 12.9, 6.1e-4), *findings) == told


def test_a_finding_of_that_channel_is_told_where_it_is_much_of_the_misfit():
    text = said(
        (0.42, 12.9, 6.1e-4), found("sinkage", THROUGHOUT, 0.6), found("drawbar_pull", ALONG_SLIP, 0.35)
    )
    assert text == f"T{ALONG_SLIP[1:]}."


@pytest.mark.parametrize(
    ("heldout", "changed"),
    [
        ((0.42, 12.9, 6.1e-4), {"sinkage"}),  # it is the effect's own channel
        ((0.42, 7.0, 1.1e-3), ()),  # this channel is missed nearly as much
        ((0.41, 3.6, 6.0e-4), ()),  # none is missed to speak of
    ],
)
def test_the_strongest_finding_is_told_where_it_shows(heldout, changed):
    text = said(
        heldout, found("sinkage", THROUGHOUT, 0.9), found("drawbar_pull", ALONG_SLIP, 0.3), changed=changed
    )
    assert text == f"T{THROUGHOUT[1:]}."


def test_without_a_finding_the_name_comes_first():
    assert verdict.sentence(diagnosed((0.4, 5.0, 6e-4)), []).startswith("Most likely cause: gear-efficiency")


def test_what_explains_nothing_is_no_probable_cause_beside_what_is_not_believed():
    found = diagnosed((0.4, 5.0, 6e-4), "family")
    found.family = ("sensor-lag", "gear-efficiency")
    found.candidates[0].doubt = "physically impossible"
    lag = SimpleNamespace(effect="sensor-lag", sizes={}, doubt="", in_family=True, explained=0.0)
    found.candidates.insert(0, lag)
    told = "No effect explains most of the misfit: sensor-lag explains at most 0%."
    assert verdict.sentence(found, []).endswith(told)


def test_of_a_family_those_of_a_doubtful_size_are_marked():
    found = diagnosed((0.4, 5.0, 6e-4), "family")
    found.family = ("gear-efficiency", "slope", "crust")
    found.candidates.append(
        SimpleNamespace(effect="crust", sizes={}, doubt="at its bound", in_family=True, explained=0.9)
    )
    assert verdict.sentence(found, []) == (
        "Possible causes: gear-efficiency or slope; these data cannot tell which. "
        "Not credible: crust (at its bound)."
    )


@pytest.mark.parametrize("stretch", [(40.0, 60.0), None])
def test_no_effect_is_a_probable_cause_that_explains_little(stretch):
    log = diagnosed((0.4, 5.0, 6e-4), "family")
    log.family, log.comparison.stretch, log.candidates[0].explained = (
        ("gear-efficiency", "slope"),
        stretch,
        0.09,
    )
    fails = "the model predicts 1.6 N m too little torque from 40 s to 60 s"
    assert verdict.sentence(log, [found("torque", fails, 0.6)], ["torque"]) == (
        f"T{fails[1:]}. No effect explains most of the misfit: gear-efficiency or slope explains at most 9%."
    )


def test_two_that_are_missing_together_are_no_alternatives():
    pair = ("gear-efficiency", "slope")
    assert verdict.sentence(diagnosed((0.4, 5.0, 6e-4), "family", pair), []) == (
        "Gear-efficiency and slope together explain more than any effect alone."
    )


def test_beside_a_pair_the_best_single_effects_are_named():
    log = diagnosed((0.4, 5.0, 6e-4), "family", ("gear-efficiency", "slope"))
    log.family = ("gear-efficiency", "crust")
    assert verdict.sentence(log, []) == (
        "Gear-efficiency and slope together explain more than any effect alone. "
        "The best single effects are gear-efficiency and crust."
    )
    log.candidates[0].explained = 0.0
    assert verdict.sentence(log, []).endswith("than any effect alone. The best single effect is crust.")
