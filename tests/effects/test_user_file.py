"""A user's own effect: what its file may say."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from own_effects import CABLE, effect

from terrain_cli.effects.laws import effect_file
from terrain_cli.mechanics.dual import seed
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict
from terrain_cli.models import ModelFile, model_change


class TestGood:
    def test_example_of_the_documentation(self, write):
        understood = effect_file.read(write(CABLE))
        own = understood.effect
        assert (own.id, own.kind, own.needs) == ("cable-drag", "force", ("yaw_rate",))
        assert own.formula == "drawbar_pull = drawbar_pull - cd * abs(yaw_rate)"
        assert own.reference == "cd: own measurement"
        (cd,) = own.parameters
        assert (cd.unit, cd.null, cd.scale, cd.lower, cd.upper) == ("N s/rad", 0.0, 10.0, 0.0, math.inf)
        assert own.laws["drawbar_pull"]({"drawbar_pull": 5.0, "yaw_rate": -0.2, "cd": 10.0}) == 3.0
        assert understood.warnings == []
        assert understood.units == {"drawbar_pull": {"drawbar_pull": "N", "yaw_rate": "rad/s"}}

    def test_parameters_become_si(self, write):
        content = effect("exit_angle", "exit_angle + a", "deg", null=0.0, more="lower = -30\nupper = 10\n")
        (a,) = effect_file.load(write(content)).parameters
        assert a.unit == "deg"
        assert (a.scale, a.lower, a.upper) == pytest.approx([math.radians(x) for x in (1.0, -30.0, 10.0)])
        assert a.factor == pytest.approx(math.radians(1.0))

    def test_null_that_is_not_zero(self, write):
        own = effect_file.load(write(effect("torque", "torque * a / 100", "1", null=100)))
        assert own.parameters[0].null == 100.0
        own = effect_file.load(write(effect("torque", "torque * a", "%", null=100)))
        assert own.parameters[0].null == 1.0

    def test_a_number_that_is_known_is_held(self, write):
        own = effect_file.load(
            write(
                'id = "warm"\ntitle = "Warm"\nneeds = ["motor_temperature"]\nchanges = "torque"\n'
                'law = "torque * (1 + a * (motor_temperature - usual))"\n'
                '[parameters.a]\nunit = "1/K"\nnull = 0\nscale = 1e-3\n'
                '[parameters.usual]\nunit = "K"\nnull = 25\nscale = 10\nheld = "calibrated there"\n'
            )
        )
        a, usual = own.parameters
        there = [{"motor_temperature": np.array([20.0, 60.0])}]
        assert (a.idle(there), usual.idle(there)) == ("", "calibrated there")
        # No search tries it at other values, nor has the effect another form there.
        assert not usual.shape
        change = model_change.Changed(ModelFile(model=Model(effects=(own,))), ("warm",))
        assert len(model_change.in_forms(change)) == 1

    def test_several_laws(self, write):
        own = effect_file.load(
            write(
                'id = "fan"\ntitle = "Fan"\nneeds = ["velocity"]\n[laws]\n'
                'torque = "torque + drag * wheel_radius * abs(velocity)"\n'
                'drawbar_pull = """\ndrawbar_pull\n  - drag * velocity"""\n'
                '[parameters.drag]\nunit = "N/(m/s)"\nnull = 0\nscale = 5\n'
            )
        )
        assert list(own.laws) == ["torque", "drawbar_pull"]
        assert own.kind == "sensor"
        assert own.formula.endswith("; drawbar_pull = drawbar_pull - drag * velocity")

    def test_all_that_can_be_said(self, write):
        content = effect("torque", "torque + a", "N m") + 'lower = -inf\nmeaning = "friction"\n'
        top = 'kind = "force"\nshows = "torque"\nsettled_by = "a spin"\nreference = "me"\n'
        top += 'explanation = """\nA\nB."""\n'
        own = effect_file.load(write(top + content))
        assert (own.kind, own.shows, own.settled_by, own.reference) == ("force", "torque", "a spin", "me")
        assert own.explanation == "A B."
        assert own.parameters[0].meaning == "friction"

    @pytest.mark.parametrize(
        ("changes", "law", "unit", "needs"),
        [
            (
                "slip",
                "1 - velocity / (angular_velocity * (wheel_radius + a))",
                "mm",
                ["velocity", "angular_velocity"],
            ),
            ("slip", "where(slip < 0, slip, slip - a * (1 - slip))", "%", []),
            ("slip", "slip + a * load", "1/kN", []),
            ("load", "load * (1 + a * sin(pitch)) + a * load * slip", "%", ["pitch"]),
            ("sinkage", "sinkage + a", "mm", []),
            ("radius", "radius - a * load", "mm/N", []),
            ("cohesion", "cohesion * (1 + a * log10(1 + pass_number))", "1", ["pass_number"]),
            ("tan_phi", "tan(atan(tan_phi) + a)", "deg", []),
            ("shear_modulus", "shear_modulus * (1 + a * abs(slip))", "1", []),
            ("stiffness", "where(sinkage > 0.1 * wheel_radius, stiffness * exp(a), stiffness)", "1", []),
            ("sinkage_exponent", "sinkage_exponent + a * abs(slip)", "1", []),
            ("max_stress_angle", "max_stress_angle + a * slip * entry_angle", "1", []),
            ("exit_angle", "-a * entry_angle", "1", []),
            ("shear_radius", "shear_radius + a * grouser_height", "1", ["grouser_height"]),
            ("normal_stress", "normal_stress + a * max(0, depth - 0.2 * wheel_radius)", "kPa/mm", []),
            ("normal_stress", "normal_stress + a * depth ^ sinkage_exponent", "kPa/m^n", []),
            (
                "shear_stress",
                """(cohesion + tan_phi * normal_stress) * sign(shear_displacement)
                * (1 - exp(-abs(shear_displacement) / shear_modulus)) * (1 + a * angle)""",
                "1/deg",
                [],
            ),
            ("torque", "torque + a * sign(angular_velocity)", "N cm", ["angular_velocity"]),
            ("torque", "torque + a * torque_rate", "ms", ["torque_rate"]),
            (
                "torque",
                "torque + a * cos(grouser_count * wheel_angle)",
                "N m",
                ["grouser_count", "wheel_angle"],
            ),
            ("sinkage", "sinkage - a * slip * rut_slope", "cm", ["rut_slope"]),
            ("torque", "torque + a * measured_drawbar_pull", "m", ["drawbar_pull"]),
            ("drawbar_pull", "drawbar_pull - a * torque / radius", "1", []),
            ("drawbar_pull", "drawbar_pull - a * load * time", "1/h", ["time"]),
        ],
    )
    def test_laws_of_every_kind(self, changes, law, unit, needs, write):
        own = effect_file.load(write(effect(changes, law, unit, needs)))
        assert own.kind in {"soil", "stress", "contact", "force", "sensor"}
        assert set(needs) <= set(own.needs)

    def test_parameter_that_shapes_the_influence_of_another(self, write):
        more = '[parameters.t0]\nunit = "°C"\nnull = 25\nscale = 10\n'
        law = "torque * (1 + a * (motor_temperature - t0))"
        understood = effect_file.read(write(effect("torque", law, "%/K", ["motor_temperature"], more=more)))
        assert [parameter.shape for parameter in understood.effect.parameters] == [False, True]
        assert understood.warnings == []

    def test_load_that_a_law_reads_is_a_need(self, write):
        own = effect_file.load(write(effect("torque", "torque + a * load", "mm")))
        assert own.needs == ("load",)

    def test_further_column_is_read_in_its_unit(self, write):
        content = effect(
            "cohesion", "cohesion + a * moisture", "kPa", ["moisture"], columns='columns = {moisture = "%"}\n'
        )
        understood = effect_file.read(write(content))
        assert understood.warnings == []
        law = understood.effect.laws["cohesion"]
        assert law({"cohesion": 100.0, "moisture": np.array([0.0, 5.0]), "a": 1e3}).tolist() == [100.0, 150.0]
        law = pickle.loads(pickle.dumps(law))  # noqa: S301
        assert law({"cohesion": 100.0, "moisture": 5.0, "a": 1e3}) == pytest.approx(150.0)

    def test_rate_of_a_further_column(self, write):
        content = effect(
            "torque", "torque + a * arm_rate", "N s", ["arm_rate"], columns='columns = {arm = "mm"}\n'
        )
        law = effect_file.load(write(content)).laws["torque"]
        assert law({"torque": 1.0, "arm_rate": 1000.0, "a": 2.0}) == pytest.approx(3.0)

    def test_model_computes_it_with_its_derivatives(self, write):
        own = effect_file.load(write(CABLE))
        n = 4
        channels = {
            "load": np.full(n, 80.0),
            "slip": np.linspace(0.1, 0.5, n),
            "sinkage": np.full(n, 0.015),
            "yaw_rate": np.array([-0.2, 0.0, 0.1, 0.3]),
        }
        soil = {
            "cohesion": 500.0,
            "tan_phi": 0.6,
            "shear_modulus": 0.015,
            "stiffness": 8e5,
            "sinkage_exponent": 1.0,
        }
        wheel = WheelGeometry(0.125, 0.1)
        bare = predict(Model("wong-reece"), wheel, channels, soil)
        both = predict(
            Model("wong-reece", (own,)),
            wheel,
            channels,
            {**soil, "cable-drag.cd": 12.0},
            by=("cable-drag.cd", "slip"),
        )
        drag = np.abs(channels["yaw_rate"])
        np.testing.assert_allclose(both.drawbar_pull.value, bare.drawbar_pull - 12.0 * drag)
        np.testing.assert_allclose(both.drawbar_pull.slopes["cable-drag.cd"], -drag)
        assert np.all(both.drawbar_pull.slopes["slip"] > 0.0)


class TestWarnings:
    @pytest.mark.parametrize(
        ("content", "says"),
        [
            (effect("torque", "torque + a", "N m", ["pitch"]), "needs pitch, which no law reads"),
            (
                effect("cohesion", "cohesion + a", "Pa", ["torque"]),
                "needs torque, which no law reads; a law reads it as measured_torque",
            ),
            (effect("torque", "torque + a * grip", "N m", ["grip"]), "grip is no channel"),
            (effect("torque", "torque + a * sqrt(pitch)", "N m", ["pitch"]), "gives no number for "),
            (effect("torque", "torque + abs(a)", "N m", []), "no slope at its null value"),
            (effect("torque", "torque + a * 0", "N m", []), "a: has no influence on the law"),
            (
                effect("torque", "torque * (1 + sqrt(a))", "1", []),
                "the derivative of the law is not finite at its null value",
            ),
            (
                effect(
                    "slip",
                    "1 - velocity / (angular_velocity * (wheel_radius + a))",
                    "m",
                    ["velocity", "angular_velocity"],
                ),
                "only where slip is not negative",
            ),
        ],
    )
    def test_of_what_is_doubtful(self, content, says, write):
        warnings = effect_file.read(write(content)).warnings
        assert any(says in warning for warning in warnings), warnings


def test_derivative_of_a_law_by_its_parameter_is_exact(write):
    law = effect_file.load(write(effect("torque", "torque * exp(-a * slip) + a^2 * torque", "1"))).laws[
        "torque"
    ]
    torque, slip, a = np.array([3.0, 8.0]), np.array([0.2, 0.7]), 0.4
    slope = law({"torque": torque, "slip": slip, "a": seed(np.full(2, a), "a")}).slopes["a"]
    np.testing.assert_allclose(slope, -slip * torque * np.exp(-a * slip) + 2.0 * a * torque)
