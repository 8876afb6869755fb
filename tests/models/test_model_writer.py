"""Model files: written whole, and edited without losing what their user wrote."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from terrain_cli import effects, models
from terrain_cli.models import Prior, model_file
from terrain_cli.vocabulary import choices

WR = 'format = "terrain-est/model/1"\nbase = "wong-reece"\n'

numbers = st.floats(1e-6, 1.0)


@st.composite
def files(draw):
    names = draw(st.lists(st.sampled_from(list(effects.NAMES)), unique=True, max_size=4))
    file = models.build("wong-reece", names)
    known = list(file.units)
    far = {name: choices.MOST_SCALES * p.scale for name, p in file.model.parameters.items()}
    bounds = choices.SOIL_BOUNDS | {
        name: (max(p.lower, p.null - far[name]), min(p.upper, p.null + far[name]))
        for name, p in file.model.parameters.items()
    }

    def value(name):
        return draw(st.floats(*bounds[name]))

    def deviation(name):
        low, high = bounds[name]
        return (high - low) * draw(numbers)

    held = draw(st.lists(st.sampled_from(known), unique=True, max_size=4))
    known = [name for name in known if name not in held]
    prior = draw(st.lists(st.sampled_from(known), unique=True, max_size=3)) if known else []
    entry = st.dictionaries(st.text("abc.é ", min_size=1), st.text() | st.integers(0, 9) | st.lists(numbers))
    return replace(
        file,
        fixed={name: value(name) for name in held},
        priors={name: Prior(value(name), deviation(name)) for name in prior},
        shared=tuple(draw(st.lists(st.sampled_from(file.model.soil), unique=True, max_size=2))),
        history=tuple(draw(st.lists(entry, max_size=3))),
    )


anywhere = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)


@anywhere
@given(files())
def test_what_is_written_reads_back(tmp_path, file):
    path = tmp_path / "model.toml"
    models.save(file, path)
    assert replace(models.load(path), path=None) == file


@anywhere
@given(files(), files())
def test_what_is_edited_reads_back(tmp_path, before, after):
    path = tmp_path / "model.toml"
    models.save(before, path)
    after = replace(after, history=(*before.history, *after.history), text=path.read_text("utf-8"))
    models.save(after, path)
    assert replace(models.load(path), path=None) == after


WRITTEN = """\
# The front wheels, tuned by hand.
format = "terrain-est/model/1"
base = "wong-reece"      # as in the paper
effects = [
    "slip-sinkage",      # it digs
    "drivetrain-friction",
]

[fixed]
shear_modulus = 0.018    # m, from the plate test
"slip-sinkage.n1" = 0.4

[[history]]              # the first night
added = "slip-sinkage"
"""


def test_an_edit_keeps_comments_and_order(write):
    path = write(WRITTEN)
    file = models.load(path)
    change = {"removed": "slip-sinkage", "heldout": {"torque": [0.2, 0.21]}}
    models.save(
        replace(
            file,
            model=replace(file.model, effects=file.model.effects[1:]),
            effects=file.effects[1:],
            fixed={"shear_modulus": 0.02, "cohesion": 500.0},
            history=(*file.history, change),
        ),
        path,
    )
    assert (
        path.read_text("utf-8")
        == """\
# The front wheels, tuned by hand.
format = "terrain-est/model/1"
base = "wong-reece"      # as in the paper
effects = ["drivetrain-friction"]

[fixed]
shear_modulus = 0.02    # m, from the plate test
cohesion = 500.0

[[history]]              # the first night
added = "slip-sinkage"

[[history]]
removed = "slip-sinkage"
heldout = { torque = [0.2, 0.21] }
"""
    )


@pytest.mark.parametrize(
    "text",
    [
        WR + "fixed = { cohesion = 3, shear_modulus = 0.01 }  # known",
        WR + "fixed.cohesion = 3  # known\nfixed.shear_modulus = 0.01",
        WR + "[fixed]  # known\ncohesion = 3\nshear_modulus = 0.01",
        WR + "[fixed]\r\ncohesion = 3  # known\r\nshear_modulus = 0.01\r\n",
        WR + "[[history]]\nx = 1\n[fixed]\ncohesion = 3\nshear_modulus = 0.01\n# known",
        WR + "[priors.stiffness]  # known\nmean = 1e6\nsd = 1e5\n[fixed]\ncohesion = 3\nshear_modulus = 0.01",
    ],
)
def test_every_layout_can_be_edited(write, text):
    path = write(text)
    file = models.load(path)
    priors = {"sinkage_exponent": Prior(1.0, 0.1)}
    models.save(
        replace(
            file,
            fixed={"cohesion": 3.0, "tan_phi": 0.5},
            priors={**file.priors, **priors},
            history=(*file.history, {"n": 2}),
        ),
        path,
    )
    after = models.load(path)
    assert after.fixed == {"cohesion": 3.0, "tan_phi": 0.5}
    assert after.priors == {**file.priors, **priors}
    assert after.history == (*file.history, {"n": 2})
    assert "# known" in path.read_text("utf-8")


def test_a_new_key_leaves_a_comment_with_its_table(write):
    text = WR + "\n# held\n[fixed]\n\n# beforehand\n[priors]\n\n# the first night\n[[history]]\nx = 1\n"
    path = write(text)
    file = models.load(path)
    models.save(
        replace(file, shared=("cohesion",), fixed={"tan_phi": 0.5}, priors={"cohesion": Prior(9.0, 1.0)}),
        path,
    )
    assert path.read_text("utf-8") == (
        text.replace("\n\n# held", '\nshared = ["cohesion"]\n\n# held')
        .replace("[fixed]\n", "[fixed]\ntan_phi = 0.5\n")
        .replace("[priors]\n", "[priors]\ncohesion = { mean = 9.0, sd = 1.0 }\n")
    )


def test_what_tomlkit_cannot_edit_is_written_anew(write):
    path = write(WR + "fixed.cohesion = 3\n")
    file = models.load(path)
    models.save(replace(file, fixed={}), path)
    assert models.load(path).fixed == {}


def test_nothing_is_written_where_nothing_has_changed(write):
    path = write(WRITTEN)
    models.save(models.load(path), path)
    assert path.read_text("utf-8") == WRITTEN


def test_a_new_file_explains_itself(tmp_path):
    file = models.build("wong-reece", ["slip-sinkage"], {"shear_modulus": 0.018})
    text = model_file.new(file)
    assert tomllib.loads(text)["fixed"] == {"shear_modulus": 0.018}
    assert "cohesion (Pa), tan_phi (1), shear_modulus (m)" in text
