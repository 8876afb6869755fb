"""What a diagnosis says of the order of its candidates."""

from types import SimpleNamespace

from terrain_cli.presentation import diagnosis_text


def candidate(effect, loss, *, doubt="", refitted=True, in_family=False, explained=0.5):
    return SimpleNamespace(
        effect=effect, loss=loss, doubt=doubt, refitted=refitted, in_family=in_family, explained=explained
    )


def test_an_order_by_loss_alone_needs_no_other_word():
    several = [candidate("a", -3.0), candidate("b", -2.0), candidate("c", -0.1, refitted=False)]
    assert diagnosis_text.ranked_by(several) == ["loss", "loss", "score"]
    assert diagnosis_text.order(several) == diagnosis_text.order([]) == []


def test_those_that_are_marked_come_before_the_others():
    several = [
        candidate("a", -3.0, in_family=True),
        candidate("b", -1.0, in_family=True),
        candidate("c", -2.0, doubt="at its bound"),
    ]
    assert diagnosis_text.ranked_by(several) == ["loss", "loss", "behind"]
    marked = "then those marked * (these data cannot tell them from the best), then the others"
    assert diagnosis_text.order(several) == [f"order: the best, {marked}"]
    assert "named in the first line" in diagnosis_text.order(several, ("a", "b"))[0]


def test_a_plainer_first_one_is_told():
    several = [candidate("a", -2.9, in_family=True), candidate("b", -3.0), candidate("c", -1.0)]
    assert diagnosis_text.ranked_by(several) == ["plainer", "loss", "loss"]
    told = "b is not significantly better than a, but has more parameters"
    assert diagnosis_text.order(several) == [told]
    assert diagnosis_text.order([candidate("a", -2.9), *several[1:]]) == []


def test_a_first_one_with_clearly_lower_printed_errors_is_told():
    several = [candidate("a", -2.9, in_family=True), candidate("b", -3.0, explained=0.3)]
    assert diagnosis_text.ranked_by(several) == ["errors", "loss"]
    assert diagnosis_text.order(several) == []


def test_a_doubted_one_with_less_loss_makes_the_first_no_plainer():
    several = [candidate("a", -2.0), candidate("b", -3.0, doubt="physically impossible")]
    assert diagnosis_text.ranked_by(several) == ["loss", "behind"]
