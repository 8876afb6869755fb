"""What a base takes for granted: told, lifted, and made again."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from terrain_cli import effects, models
from terrain_cli.errors import ConfigurationError, UsageError
from terrain_cli.models import ASSUMPTIONS, ModelFile, Prior, model_change
from terrain_cli.vocabulary import choices

K = 0.018
LINEAR, FULL = models.build("linear"), models.build("wong-reece")
STRESSES, MODULUS = ASSUMPTIONS


def made(file):
    return [one.id for one in model_change.made_by(file, K)]


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        (LINEAR, [STRESSES, MODULUS]),
        (replace(LINEAR, fixed={"shear_modulus": 0.01}), [STRESSES, MODULUS]),
        (replace(LINEAR, priors={"shear_modulus": Prior(0.02, 0.01)}), [STRESSES]),
        (replace(LINEAR, shared=("shear_modulus",)), [STRESSES]),
        (FULL, []),
        (replace(FULL, fixed={"shear_modulus": 0.01}), [MODULUS]),
    ],
)
def test_which_a_model_makes(file, expected):
    assert made(file) == expected


def test_the_value_held_is_named():
    assert model_change.made_by(LINEAR, K)[1].title == "The shear modulus k is the one assumed: 18 mm"
    assert model_change.made_by(replace(FULL, fixed={"shear_modulus": 0.01}), K)[0].title.endswith(": 10 mm")


def test_stresses_lifted():
    assert model_change.lifted(LINEAR, STRESSES, K) == FULL
    own = replace(LINEAR, fixed={"shear_modulus": 0.01}, priors={"tan_phi": Prior(0.5, 0.1)})
    lifted = model_change.lifted(own, STRESSES, K)
    assert (lifted.model.base, lifted.fixed, lifted.priors) == ("wong-reece", own.fixed, own.priors)
    # k is held in the file: that is another assumption.
    assert made(lifted) == [MODULUS]


@pytest.mark.parametrize(("file", "k"), [(LINEAR, K), (replace(FULL, fixed={"shear_modulus": 0.01}), 0.01)])
def test_modulus_lifted_is_expected_within_a_factor(file, k):
    lifted = model_change.lifted(file, MODULUS, K)
    assert MODULUS not in made(lifted)
    mean, sd = lifted.priors["shear_modulus"].of_logarithm()
    assert math.exp(mean) == pytest.approx(k, rel=1e-3)
    assert math.exp(sd) == pytest.approx(choices.K_FACTOR, rel=1e-3)


def test_what_is_not_made_is_not_lifted():
    for name in ASSUMPTIONS:
        with pytest.raises(UsageError, match=f"does not make the assumption {name}"):
            model_change.lifted(FULL, name, K)
    with pytest.raises(UsageError, match="no assumption 'gravity'"):
        model_change.lifted(LINEAR, "gravity", K)
    with pytest.raises(UsageError, match="already"):
        model_change.imposed(LINEAR, STRESSES, K)


@pytest.mark.parametrize("name", ASSUMPTIONS)
def test_made_again_is_as_before(name):
    assert model_change.imposed(model_change.lifted(LINEAR, name, K), name, K) == LINEAR


def test_full_model_may_be_held_to_an_assumption():
    assert model_change.imposed(FULL, MODULUS, K).fixed == {"shear_modulus": K}
    with pytest.raises(ConfigurationError, match="has no stiffness"):
        model_change.imposed(replace(FULL, fixed={"stiffness": 1e6}), STRESSES, K)
    with pytest.raises(ConfigurationError, match="which the base linear does not have"):
        model_change.imposed(models.build("wong-reece", ["slip-sinkage"]), STRESSES, K)


def test_effects_that_only_the_full_model_takes_come_after_the_lift():
    changed = models.added(LINEAR, ["slip-sinkage", STRESSES], K)
    assert (changed.file.model.base, changed.file.effects) == ("wong-reece", ("slip-sinkage",))
    assert changed.ids == ("slip-sinkage", STRESSES)
    assert models.removed(changed.file, [STRESSES, "slip-sinkage"], K).file == LINEAR


def test_a_lifted_model_is_written_and_read(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(
        'format = "terrain-est/model/1"\nbase = "linear"   # the paper\n[fixed]\nshear_modulus = 0.01\n'
    )
    lifted = model_change.lifted(model_change.lifted(models.load(path), STRESSES, K), MODULUS, K)
    models.save(lifted, path)
    read = models.load(path)
    assert (read.model.base, read.fixed, read.priors) == ("wong-reece", {}, lifted.priors)
    assert 'base = "wong-reece"   # the paper' in path.read_text("utf-8")


def test_no_effect_has_their_names():
    assert not ASSUMPTIONS.keys() & effects.catalogue().keys()
    assert isinstance(LINEAR, ModelFile)


def test_they_are_listed_and_shown_with_the_effects(terrain_est_here):
    told = terrain_est_here("effects", "list").stdout
    assert "assumptions of a base, which model add removes:\nlinearised-stresses" in told
    assert "assumptions" not in terrain_est_here("effects", "list", "--kind", "sensor").stdout
    shown = terrain_est_here("effects", "show", MODULUS, "slip-sinkage")
    assert shown.returncode == 0
    assert shown.stdout.startswith(f"{MODULUS}: {ASSUMPTIONS[MODULUS].title}\n")
    assert "\n\nslip-sinkage: " in shown.stdout
    found = json.loads(terrain_est_here("effects", "show", MODULUS, "slip-sinkage", "--json").stdout)
    assert [one["id"] for one in found["effects"]] == ["slip-sinkage"]
    assert [one["id"] for one in found["assumptions"]] == [MODULUS]
    text = (Path(__file__).resolve().parent.parent.parent / "docs" / "effects.md").read_text("utf-8")
    assert not [key for key in (*ASSUMPTIONS, *found["assumptions"][0]) if f"{key}" not in text]


@pytest.mark.parametrize("names", [[STRESSES, MODULUS], [MODULUS, STRESSES]])
def test_both_assumptions_are_lifted_in_any_order(names):
    file = models.added(LINEAR, names, K).file
    assert (file.model.base, made(file)) == ("wong-reece", [])
    assert "shear_modulus" in file.priors


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ({"changed": ["slope"], "rivals": ["drawbar-bias", "load-bias"]}, ["drawbar-bias", "load-bias"]),
        ({"changed": ["slope"], "rivals": ["bulldozing"]}, []),  # It is in the model as well
        ({"changed": ["slope"], "rivals": ["drawbar-bias"], "kept": False}, []),
        ({"changed": ["side-slip"], "rivals": ["drawbar-bias"]}, []),  # It was removed again
        ({"changed": ["slope"], "rivals": ["no-effect", 3]}, []),
        ({"changed": 3, "rivals": "drawbar-bias", "note": "by hand"}, []),
    ],
)
def test_rivals_are_what_data_did_not_tell_from_an_effect_that_is_there(entry, expected):
    file = models.build("wong-reece", ["slope", "bulldozing"])
    found = models.rivals(replace(file, history=(entry, {"changed": ["bulldozing"]})))
    assert [one.id for one in found] == expected
