"""Every effect of the catalogue, by the same rules: one row each, of its name."""

from __future__ import annotations

import pickle
import re

import numpy as np
import pytest
from hypothesis import given as given_that
from hypothesis import strategies as st
from known_effects import KNOWN_EFFECTS
from profiles import examples

from terrain_cli import effects
from terrain_cli.effects.laws import dimensions
from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.dual import slopes, value
from terrain_cli.mechanics.effect import KINDS, QUANTITIES
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict
from terrain_cli.telemetry import effect_inputs
from terrain_cli.vocabulary.channels import CHANNELS

OUTPUTS = ("balance", "load", "torque", "drawbar_pull", "sinkage")

every = pytest.mark.parametrize("name", effects.NAMES)
#: Each effect under each base that can have it, with sinkage measured and sought.
cases = pytest.mark.parametrize(
    ("name", "way"),
    [
        (name, way)
        for name in effects.NAMES
        for way in ("sinkage", "load", "linear")
        if way != "linear" or KNOWN_EFFECTS[name].on_the_line
    ],
)


def model_of(way, *names):
    base = "linear" if way == "linear" else "wong-reece"
    return Model(base, tuple(effects.find(name) for name in names))


def run(model, way, wheel, channels, soil, changed=None, by=()):
    values = {name: soil[name] for name in model.soil} | model.nulls() | (changed or {})
    given = "load" if way == "load" else "sinkage"
    return predict(model, wheel, channels, values, given=given, by=by)


def outputs(prediction):
    return {name: getattr(prediction, name) for name in OUTPUTS if getattr(prediction, name) is not None}


def away(model, sizes):
    """Return values that many sizes away from the nulls, to the side that has room."""
    result = {}
    for name, p in model.parameters.items():
        step = sizes * p.scale
        result[name] = p.null + step if p.null + step <= p.upper else p.null - step
    return result


def test_each_is_known_by_its_own_name():
    assert len(effects.NAMES) == len(set(effects.NAMES))
    assert KNOWN_EFFECTS.keys() == set(effects.NAMES)
    assert {name: effect.id for name, effect in effects.catalogue().items()} == dict(
        zip(effects.NAMES, effects.NAMES, strict=True)
    )
    assert {e.id: e.kind for e in effects.catalogue().values()} == {
        name: known.kind for name, known in KNOWN_EFFECTS.items()
    }
    assert {known.kind for known in KNOWN_EFFECTS.values()} == set(KINDS)


@every
def test_tells_a_person_what_it_is(name):
    effect = effects.find(name)
    for text, least in (
        (effect.title, 10),
        (effect.formula, 5),
        (effect.explanation, 300),
        (effect.shows, 10),
        (effect.reference, 40),
        (effect.settled_by, 20),
    ):
        assert len(text) >= least
        assert text == " ".join(text.split())
    assert re.search(r"\((19|20)\d\d\)", effect.reference), "a year"
    others = [other for other in effects.NAMES if other != name]
    assert any(other in effect.explanation.lower() for other in others), "what it is taken for"


@every
def test_parameters_have_units_scales_and_bounds_that_fit(name):
    effect = effects.find(name)
    assert effect.parameters
    for p in effect.parameters:
        assert dimensions.parse(p.unit).factor == 1.0
        assert p.scale > 0.0
        assert p.lower <= p.null <= p.upper
        assert p.lower < p.upper
        assert any(p.lower <= p.null + step <= p.upper for step in (p.scale, -p.scale))
        assert p.meaning
        # A law would read its own parameter for a channel or a quantity of the same name.
        assert p.name not in QUANTITIES | dict.fromkeys(CHANNELS) | dict.fromkeys(
            ("angle", "depth", "shear_displacement", "entry_angle", "wheel_radius", *WheelGeometry._fields)
        )
    assert not all(p.shape for p in effect.parameters)
    assert set(effect.laws) <= set(QUANTITIES)


@every
def test_travels_between_processes(name):
    assert pickle.loads(pickle.dumps(effects.find(name))).laws.keys() == effects.find(name).laws.keys()  # noqa: S301


@cases
def test_null_values_give_the_base_model(name, way, wheel, channels, soil):
    bare = outputs(run(model_of(way), way, wheel, channels, soil))
    same = outputs(run(model_of(way, name), way, wheel, channels, soil))
    assert same.keys() == bare.keys()
    for output, expected in bare.items():
        # The balance is a difference of loads.
        floor = 1e-9 * np.max(channels["load"]) if output in {"balance", "drawbar_pull"} else 0.0
        np.testing.assert_allclose(same[output], expected, rtol=1e-10, atol=floor, err_msg=output)


@cases
@pytest.mark.parametrize("sizes", [0.0, 0.4])
def test_derivatives_are_those_of_differences(name, way, sizes, wheel, channels, soil):
    model = model_of(way, name)
    start = {q: soil[q] for q in model.soil} | away(model, sizes)
    measured = {"slip", "load", "sinkage"} - ({"sinkage"} if way == "load" else set())
    by = [*start, *sorted(measured)]
    exact = outputs(run(model, way, wheel, channels, soil, start, by))
    for quantity in by:
        p = model.parameters.get(quantity)
        # What is late and what is ahead go on from nothing with the same slope, but bend otherwise.
        h = (1e-6 if model.remembers else 1e-5) * (
            p.scale if p else start.get(quantity, 1.0) if quantity in start else np.max(channels[quantity])
        )

        def at(step, quantity=quantity):
            if quantity in start:
                return outputs(
                    run(model, way, wheel, channels, soil, start | {quantity: start[quantity] + step})
                )
            moved = channels | {quantity: channels[quantity] + step}
            return outputs(run(model, way, wheel, moved, soil, start))

        # To one side where the law ends at its null.
        steps = {0.0: -1.5, h: 2.0, 2.0 * h: -0.5} if p and p.null == p.lower else {-h: -0.5, h: 0.5}
        around = {step: at(step) for step in steps}
        for output, number in exact.items():
            by_difference = sum(weight * around[step][output] for step, weight in steps.items()) / h
            rounding = 1e-11 * np.max(np.abs(around[h][output])) / h
            np.testing.assert_allclose(
                np.broadcast_to(slopes(number).get(quantity, 0.0), by_difference.shape),
                by_difference,
                rtol=1e-6,
                atol=1e-6 * np.max(np.abs(by_difference)) + rounding,
                err_msg=f"{output} by {quantity}",
            )


@cases
def test_is_seen_at_its_null_unless_a_shape(name, way, wheel, channels, soil):
    model = model_of(way, name)
    here = outputs(run(model, way, wheel, channels, soil, by=tuple(model.parameters)))
    predicts = {"load": {"sinkage", "torque", "drawbar_pull"}, "linear": {"torque", "drawbar_pull"}}.get(
        way, here.keys()
    )
    for qualified, p in model.parameters.items():
        seen = max(np.max(np.abs(slopes(here[output]).get(qualified, 0.0))) for output in predicts)
        # Without a sinkage to predict there is no ripple in it.
        if qualified.startswith("grouser-ripple.sinkage") and way != "load":
            continue
        assert (seen == 0.0) == (p.shape or bool(p.held)), qualified


@every
def test_linear_base_refuses_what_it_does_not_have(name):
    if not KNOWN_EFFECTS[name].on_the_line:
        with pytest.raises(ConfigurationError, match=f"{name} changes the .* linear does not have"):
            model_of("linear", name)
    else:
        assert model_of("linear", name).effects


@every
def test_a_missing_channel_is_named(name, wheel, channels, soil):
    effect = effects.find(name)
    there = {*channels, "time", "grouser_count", "grouser_height"}
    assert effect_inputs.missing(effect, there) == ()
    for need in effect.needs:
        without = there - {
            need,
            need.removesuffix("_rate"),
            {"wheel_angle": "angular_velocity", "rut_slope": "velocity"}.get(need, ""),
        }
        assert effect_inputs.missing(effect, without) == (need,)
    if effect.any_of:
        (lack,) = effect_inputs.missing(effect, there - set(effect.any_of) - {"time"})
        assert lack.replace(" or ", ", ").split(", ") == list(effect.any_of)
        for one in effect.any_of:
            assert effect_inputs.missing(effect, {*effect.needs, one}) == ()


@every
def test_computes_with_no_more_than_it_says_it_needs(name, wheel, channels, soil):
    effect = effects.find(name)
    choices = [(one,) for one in effect.any_of] or [()]
    for further in choices:
        known = {"slip", "load", "sinkage", *effect.needs, *further} & channels.keys()
        model = model_of("sinkage", name)
        prediction = run(model, "sinkage", wheel, {c: channels[c] for c in known}, soil, away(model, 0.5))
        assert np.all(np.isfinite(prediction.torque))
        assert np.all(np.isfinite(prediction.drawbar_pull))


@pytest.mark.parametrize("name", [name for name, known in KNOWN_EFFECTS.items() if not known.with_constants])
def test_law_does_not_depend_on_the_units(name, wheel, channels, soil):
    """Measured in inches, slugs and minutes, say, a law says the same: its terms have the same unit."""
    sizes = {"kg": 3.0, "m": 7.0, "s": 0.2, "K": 1.0, "A": 1.0, "m^n": 1.0}

    def factor(unit):
        powers = dimensions.parse(unit).dimension.powers
        return np.prod([size ** float(power) for size, power in zip(sizes.values(), powers, strict=True)])

    units = {c: CHANNELS[c].unit.symbol for c in channels if c in CHANNELS}
    units |= {f"{c}_rate": f"{unit}/s" for c, unit in units.items() if f"{c}_rate" in channels}
    units |= {
        "load": "N",
        "motor_temperature": "K",
        "wheel_angle": "1",
        "rut_slope": "1",
        "depth": "m",
        "shear_displacement": "m",
    }
    units |= {
        "wheel_radius": "m",
        "width": "m",
        "grouser_height": "m",
        "gravity": "m/s^2",
        "entry_angle": "1",
    }
    units |= {"measured_drawbar_pull": "N", **QUANTITIES, "grouser_count": "1", "angle": "1"}
    q = {c: column for c, column in channels.items() if c in units} | soil | wheel._asdict()
    q |= {"wheel_radius": q["radius"], "measured_drawbar_pull": channels["drawbar_pull"]}
    one = np.full(len(channels["slip"]), 0.5)
    q |= {"entry_angle": one, "exit_angle": -0.1 * one, "max_stress_angle": 0.5 * one, "shear_radius": 0.13}
    q |= {"depth": 0.01 * one, "shear_displacement": 0.02 * one, "angle": 0.3 * one}
    q |= {"normal_stress": 6e3 * one, "shear_stress": 2e3 * one}
    effect = effects.find(name)
    for p in effect.parameters:
        q[p.name], units[p.name] = (p.null + 0.3 * p.scale, p.unit)
    scaled = {quantity: number * factor(units[quantity]) for quantity, number in q.items()}
    for known, second in ((q, 1.0), (scaled, sizes["s"])):
        shown = {c: known[c] for c in ("torque", "drawbar_pull", "sinkage")}
        time = 0.3 * second * np.arange(len(one))
        known.update(along(time, np.zeros(len(one), dtype=int), known["velocity"], shown))
    for quantity, law in effect.laws.items():
        np.testing.assert_allclose(
            law(scaled), law(q) * factor(units[quantity]), rtol=1e-12, err_msg=quantity
        )


@given_that(
    st.lists(st.sampled_from(effects.NAMES), unique=True, max_size=8),
    st.sampled_from(["sinkage", "load"]),
    st.floats(0.05, 0.5),
)
@examples(25)
def test_any_set_of_effects_goes_together(wheel, channels, soil, names, way, sizes):
    bare, model = model_of(way), model_of(way, *names)
    at_null = outputs(run(model, way, wheel, channels, soil))
    for output, expected in outputs(run(bare, way, wheel, channels, soil)).items():
        floor = 1e-9 * np.max(channels["load"]) if output in {"balance", "drawbar_pull"} else 0.0
        np.testing.assert_allclose(at_null[output], expected, rtol=1e-10, atol=floor, err_msg=output)
    by = (*model.parameters, *bare.soil, "slip", "load")
    changed = outputs(run(model, way, wheel, channels, soil, away(model, sizes), by))
    carried = (
        np.isfinite(value(changed["sinkage"])) if way == "load" else np.full(len(channels["slip"]), True)
    )
    assert np.any(carried)
    for output, number in changed.items():
        assert np.all(np.isfinite(value(number)[carried])), output
        for quantity, slope in slopes(number).items():
            assert np.all(np.isfinite(np.broadcast_to(slope, carried.shape)[carried])), (
                f"{output} by {quantity}"
            )
