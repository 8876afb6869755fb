"""When a drafted law stands alone, and when beside what the catalogue has."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hidden_drives import Kind, sized, windows_of
from uncatalogued import OUTSIDE

from terrain_cli import effects
from terrain_cli.diagnosis import diagnose, drafted_laws, outside_catalogue
from terrain_cli.models import ModelFile
from terrain_cli.presentation import diagnosis_text


def no_share(_):
    """No error is more than noise: the share is that of the loss."""
    return float("nan")


def fitted(loss, torque):
    """Return a refit of 100 samples in 20 blocks, of some loss and held-out error of the torque."""
    rng = np.random.default_rng(round(loss))
    per_block = rng.normal(0.0, 0.01, 20)
    return SimpleNamespace(
        loss=per_block - per_block.mean() + loss / 20.0,
        heldout={"torque": torque, "sinkage": 5e-4},
        residuals=[np.ones(100)],
    )


def drafted(changes, driver, form, loss, torque):
    law = drafted_laws.Draft(changes=changes, driver=driver, form=form, text="", effect=None)
    return SimpleNamespace(draft=law, refit=fitted(loss, torque))


def judged(base, effect, draft, family=("drivetrain-friction",), pair=None, driver="velocity"):
    tried = [drafted("torque", driver, "saturating", *draft)]
    both = pair and fitted(*pair)
    return outside_catalogue.verdict(no_share, fitted(*base), fitted(*effect), tried, family, pair=both)


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
    assert unknown.sentence.startswith("A drafted law predicts better")


@pytest.mark.parametrize(
    ("driver", "alone"),
    [("steering_angle", True), ("velocity_rate", False), ("wheel_angle", False), ("", False)],
)
def test_a_law_of_a_column_that_no_effect_can_follow_stands_alone(driver, alone):
    """A gear's efficiency takes up the mean of a torque that steering adds, and most of its size with it."""
    unknown, found = judged((200.0, 0.40), (135.0, 0.16), (100.0, 0.15), driver=driver)
    assert found == alone
    assert unknown.driver == driver
    # One that leaves little is right all the same: the column tells of what it does as well.
    assert not judged((200.0, 0.40), (105.0, 0.16), (100.0, 0.15), driver=driver)[1]


@pytest.mark.parametrize(("pair", "alone"), [((98.0, 0.15), False), ((130.0, 0.2), True)])
def test_a_law_stands_beside_effects_of_which_two_explain_as_much(pair, alone):
    """Each of two that are missing leaves what the other would take."""
    unknown, found = judged((200.0, 0.40), (150.0, 0.30), (100.0, 0.15), pair=pair)
    assert found == alone
    assert unknown.sentence.startswith("No effect" if alone else "A drafted law predicts better")


@pytest.mark.parametrize("pair", [None, (98.0, 0.15)])
def test_without_an_effect_the_law_is_alone(pair):
    assert judged((200.0, 0.40), (135.0, 0.16), (100.0, 0.15), family=(), pair=pair)[1]


def test_a_law_that_predicts_no_better_than_an_effect_is_not_told():
    assert judged((200.0, 0.40), (100.0, 0.15), (100.0, 0.15)) == (None, False)


@pytest.mark.parametrize(
    ("changes", "driver", "form", "loss", "rival"),
    [
        ("torque", "", "constant", 100.0, True),
        ("slip", "slip", "linear", 100.0, True),
        ("torque", "", "constant", 140.0, False),  # it predicts worse
        ("drawbar_pull", "", "constant", 100.0, False),  # it says the same
        ("torque", "velocity", "linear", 100.0, False),  # it is no sensor's
    ],
)
def test_the_error_of_another_sensor_is_a_rival_of_a_name(changes, driver, form, loss, rival):
    named = SimpleNamespace(effects=[effects.find("drawbar-bias")])
    tried = [drafted(changes, driver, form, loss, 0.15)]
    found = outside_catalogue.sensor(tried, named, fitted(100.0, 0.15))
    assert found is (tried[0] if rival else None)


@pytest.mark.parametrize(
    ("effect", "changes", "driver", "rival"),
    [
        ("wheel-radius", "slip", "", True),  # a zero is no radius
        ("wheel-radius", "slip", "slip", False),  # zero and gain can be one
        ("load-bias", "load", "", False),  # it has a zero
        ("drivetrain-friction", "torque", "", False),
        ("gear-efficiency", "torque", "", True),
    ],
)
def test_so_is_the_zero_of_the_same_sensor_where_the_effect_has_none(effect, changes, driver, rival):
    named = SimpleNamespace(effects=[effects.find(effect)])
    tried = [drafted(changes, driver, "linear" if driver else "constant", 100.0, 0.15)]
    found = outside_catalogue.sensor(tried, named, fitted(100.0, 0.15))
    assert found is (tried[0] if rival else None)


@pytest.mark.parametrize(
    ("changes", "driver", "says"),
    [
        ("torque", "", "torque is off by a constant, "),
        ("slip", "slip", "slip is off by a constant and a factor, "),
    ],
)
def test_such_an_error_is_told_beside_the_effect(changes, driver, says):
    rival = drafted(changes, driver, "linear" if driver else "constant", 100.0, 0.15)
    base, effect = fitted(200.0, 0.4), fitted(100.0, 0.15)
    unknown, alone = outside_catalogue.verdict(
        no_share, base, effect, [rival], ("drawbar-bias",), rival=rival
    )
    assert not alone
    assert unknown.channel == changes
    assert unknown.sentence.startswith(f"A sensor's error predicts as well: {says}")


def test_a_slip_that_is_off_gives_no_name_to_something_else():
    """Without wheel-radius in the catalogue, post-peak-softening or grousers explain nearly as much."""
    others = [effects.find(name) for name in ("post-peak-softening", "grousers", "shear-modulus")]
    found = diagnose(windows_of(42000031, Kind(sized("wheel-radius"))), ModelFile(), effects=others)
    assert found.effect is None
    assert (found.unknown.channel, found.unknown.driver, found.unknown.form) == ("slip", "", "constant")
    assert "slip is off by a constant, " in found.sentence


def test_a_load_cell_that_is_off_by_more_than_any_gets_no_name():
    """Without bulldozing in the catalogue, a gain of 0.78 and an offset of -22 N explain it all."""
    others = [effects.find(name) for name in ("load-bias", "drawbar-bias", "sinkage-bias")]
    found = diagnose(
        windows_of(42000030, Kind(sized("bulldozing"), seconds=64.0)), ModelFile(), effects=others
    )
    assert (found.verdict, found.effect) == ("family", None)
    assert {one.effect: one.doubt for one in found.candidates}["load-bias"] == "at its bound"


def test_what_keeps_an_effect_from_being_the_one_name_is_settled_by_a_drive_too():
    kind = Kind(sized("wheel-radius"), course="poor", seconds=64.0)
    found = diagnose(windows_of(42000031, kind), ModelFile(), effects=[effects.find("wheel-radius")])
    assert (found.effect, found.family) == (None, ("wheel-radius",))
    (drive,) = found.next_drive
    assert drive.pair == ("wheel-radius", "slip-offset-constant")
    assert min(drive.settings["slip"]) < 0.0 < max(drive.settings["slip"])
    assert "to tell wheel-radius from that error of a sensor (" in diagnosis_text.text(found)


def test_a_soil_that_follows_what_changes_slowly_is_no_soil_in_parts(monkeypatch):
    """Moisture that rises once and falls: of three soils none was missed by more than the scores can tell."""

    def slowly(seconds, _seed):
        return lambda t: np.round(2.5 - 2.5 * np.cos(4.0 * np.asarray(t) / seconds)) / 25.0

    monkeypatch.setitem(OUTSIDE, "moisture", replace(OUTSIDE["moisture"], values=slowly))
    kind = Kind({}, outside="moisture", outside_size=2.0, seconds=100.0)
    found = diagnose(windows_of(78_500_101, kind), ModelFile())
    assert (found.verdict, found.unknown.driver, found.soils) == ("unknown", "moisture", 1)


@pytest.mark.parametrize(
    ("of_law", "of_effect", "family", "told"),
    [
        # Stiffness that follows acceleration: the loss fell with the sinkage, torque and pull rose.
        (0.0, 0.11, (), None),
        (0.6, 0.5, ("drivetrain-friction",), False),
        (0.5, 0.6, ("drivetrain-friction",), None),
        # Effects that were named explained 12 %, and were tried one after the other.
        (0.6, 0.12, ("drivetrain-friction",), True),
        # Where no effect was fitted, there is nothing else to tell.
        (0.0, float("nan"), (), True),
    ],
)
def test_a_law_stands_by_the_errors_that_are_printed(of_law, of_effect, family, told):
    tried = [drafted("torque", "velocity", "saturating", 100.0, 0.15)]
    law, alone = outside_catalogue.verdict(
        lambda one: of_law if one else of_effect, fitted(200.0, 0.4), fitted(105.0, 0.16), tried, family
    )
    assert (alone if law else None) == told
    head = "No effect of the catalogue explains it" if told else "A drafted law predicts better"
    assert law is None or law.sentence.startswith(head)


@pytest.mark.parametrize(("of_effect", "alone"), [(0.4, True), (0.55, False)])
def test_a_law_is_not_alone_where_an_effect_lowers_the_printed_errors_nearly_as_much(of_effect, alone):
    """A rut that relaxes, of which smoothed channels lose most: it took 51 % off, and the law 57 %."""
    tried = [drafted("sinkage", "velocity", "saturating", 100.0, 0.15)]
    _, found = outside_catalogue.verdict(
        lambda one: 0.6 if one else of_effect,
        fitted(200.0, 0.4),
        fitted(160.0, 0.3),
        tried,
        ("sinkage-relaxation",),
    )
    assert found is alone
