"""When a drafted law stands alone, and when beside what the catalogue has."""

from types import SimpleNamespace

import numpy as np
import pytest

from terrain_cli.diagnosis import outside_catalogue


def fitted(loss, torque):
    """Return a refit of 100 samples in 20 blocks, of some loss and held-out error of the torque."""
    rng = np.random.default_rng(round(loss))
    per_block = rng.normal(0.0, 0.01, 20)
    return SimpleNamespace(
        loss=per_block - per_block.mean() + loss / 20.0,
        heldout={"torque": torque, "sinkage": 5e-4},
        residuals=[np.ones(100)],
    )


def judged(base, effect, draft, family=("drivetrain-friction",), pair=None):
    law = SimpleNamespace(changes="torque", driver="velocity", form="saturating", text="")
    tried = [SimpleNamespace(draft=law, refit=fitted(*draft))]
    both = pair and fitted(*pair)
    return outside_catalogue.verdict(fitted(*base), fitted(*effect), tried, family, pair=both)


def test_a_law_stands_alone_where_every_effect_leaves_much_of_the_misfit():
    unknown, alone = judged((200.0, 0.40), (150.0, 0.30), (100.0, 0.15))
    assert alone
    assert (unknown.channel, unknown.driver) == ("torque", "velocity")
    assert unknown.sentence.startswith("No effect of the catalogue explains it")


@pytest.mark.parametrize(
    ("effect", "draft"),
    [
        ((105.0, 0.16), (100.0, 0.15)),  # little is left
        # What lasts weighs little beside noise that lasts: the error itself is nearly all gone.
        ((135.0, 0.16), (100.0, 0.15)),
    ],
)
def test_a_law_stands_beside_an_effect_that_leaves_little(effect, draft):
    unknown, alone = judged((200.0, 0.40), effect, draft)
    assert not alone
    assert unknown.sentence.startswith("A law of one driver predicts it better")


@pytest.mark.parametrize(("pair", "alone"), [((98.0, 0.15), False), ((130.0, 0.2), True)])
def test_a_law_stands_beside_effects_of_which_two_explain_as_much(pair, alone):
    """Each of two that are missing leaves what the other would take."""
    unknown, found = judged((200.0, 0.40), (150.0, 0.30), (100.0, 0.15), pair=pair)
    assert found == alone
    assert unknown.sentence.startswith("No effect" if alone else "A law of one driver predicts it better")


@pytest.mark.parametrize("pair", [None, (98.0, 0.15)])
def test_without_an_effect_the_law_is_alone(pair):
    assert judged((200.0, 0.40), (135.0, 0.16), (100.0, 0.15), family=(), pair=pair)[1]


def test_a_law_that_predicts_no_better_than_an_effect_is_not_told():
    assert judged((200.0, 0.40), (100.0, 0.15), (100.0, 0.15)) == (None, False)
