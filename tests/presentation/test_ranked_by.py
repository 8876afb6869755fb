"""What a diagnosis says of the order of its candidates."""

from types import SimpleNamespace

from terrain_cli.presentation import diagnosis_text


def candidate(effect, loss, *, doubt="", refitted=True, torque=1.0):
    return SimpleNamespace(
        effect=effect,
        loss=loss,
        doubt=doubt,
        refitted=refitted,
        heldout={"torque": torque},
        explained=0.5,
        surviving=0.5,
        in_family=False,
        sizes={},
    )


def test_an_order_by_loss_alone_needs_no_other_word():
    several = [candidate("a", -3.0), candidate("b", -2.0), candidate("c", -0.1, refitted=False)]
    assert diagnosis_text.ranked_by(several) == ["loss", "loss", "score"]
    assert diagnosis_text.order(several) == []


def test_a_plainer_first_one_and_one_that_stands_behind_are_told():
    several = [
        candidate("a", -2.9),
        candidate("b", -3.0),
        candidate("c", -1.0),
        candidate("d", -2.0, doubt="at its bound"),
    ]
    assert diagnosis_text.ranked_by(several) == ["plainer", "loss", "loss", "behind"]
    assert diagnosis_text.order(several) == [
        "a stands first because it has fewer parameters: b predicts better, but not significantly",
        "effects whose size is doubtful (in brackets) stand behind the others",
    ]


def test_a_gain_that_may_be_chance_is_told_apart_from_a_doubted_size():
    several = [candidate("a", -3.0), candidate("b", -1.0), candidate("c", -2.0), candidate("d", -1.5)]
    assert diagnosis_text.order(several) == [
        "c and d stand lower than their errors suggest: their gains may be chance"
    ]


def test_a_doubted_one_with_less_loss_makes_the_first_no_plainer():
    several = [candidate("a", -2.0), candidate("b", -3.0, doubt="physically impossible")]
    assert diagnosis_text.ranked_by(several) == ["loss", "behind"]
