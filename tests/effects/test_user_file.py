"""A user's own effect: what its file may say, and what it is refused for."""

from __future__ import annotations

import math
import pickle
import re

import numpy as np
import pytest

from formats import NotFoundError
from terrain_cli.effects.laws import effect_file, law_names, law_trial
from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.dual import seed
from terrain_cli.mechanics.effect import QUANTITIES
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry, predict
from terrain_cli.vocabulary.channels import CHANNELS, LABEL

CABLE = """id = "cable-drag"
title = "Umbilical drags on the carriage"
changes = "drawbar_pull"           # a channel, or an inner quantity
law = "drawbar_pull - cd * abs(yaw_rate)"
needs = ["yaw_rate"]
[parameters.cd]
unit = "N s/rad"
null = 0.0
scale = 10.0
lower = 0.0
reference = "own measurement"
"""


@pytest.fixture
def write(tmp_path):
    def write(content):
        path = tmp_path / "effect.toml"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


@pytest.fixture
def refused(write):
    """Return a function that asserts that a file is refused in one line, and returns the error."""

    def refused(content, *says):
        path = write(content)
        with pytest.raises(ConfigurationError) as error:
            effect_file.load(path)
        assert error.value.exit_code == 78
        message = str(error.value)
        assert message.startswith(f"{path}: ")
        assert "\n" not in message
        assert len(message) < 400 + len(str(path))
        for words in says:
            assert words in message + "\n" + error.value.hint
        return error.value

    return refused


def effect(changes, law, unit="1", needs=(), null=0.0, more="", columns=""):
    listed = ", ".join(f'"{need}"' for need in needs)
    return f"""id = "own"
title = "Own"
changes = "{changes}"
law = '''{law}'''
needs = [{listed}]
{columns}
[parameters.a]
unit = "{unit}"
null = {null}
scale = 1.0
{more}"""


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


class TestLawRefused:
    @pytest.mark.parametrize(
        ("law", "place", "says"),
        [
            ("drawbar_pull - cd * abs(yaw_rat)", "yaw_rat)", "there is no yaw_rat; did you mean yaw_rate?"),
            ("drawbar_pull - cd * abs(pitch)", "pitch", "pitch is read and not listed in needs"),
            ("drawbar_pull - cd * terrain", "terrain", "terrain is a label, not a number"),
            (
                "drawbar_pull - cd * normal_stress",
                "normal_stress",
                "normal_stress is not known where drawbar_pull",
            ),
            ("drawbar_pull - cd * depth", "depth", "depth is not known where drawbar_pull is changed"),
            ("drawbar_pull - cd * pi2", "pi2", "there is no pi2"),
            ("drawbar_pull - cd * measured_torque", "measured_torque", 'needs = ["yaw_rate", "torque"]'),
            ("drawbar_pull - cd", "cd", "subtracts cd (N s) from drawbar_pull (N)"),
            ("drawbar_pull - cd * yaw_rate - 5", "5", "subtracts 5 (a plain number)"),
            ("cd * yaw_rate * wheel_radius", "cd", "the law gives N m, and drawbar_pull is N"),
            ("drawbar_pull - cd * abs(yaw_rate) ^ 30", "30", "a power is between"),
            ("drawbar_pull - cd * yaw_rate.real", ".real", "'.' has no place in a law"),
        ],
    )
    def test_at_its_place(self, law, place, says, refused):
        content = CABLE.replace("drawbar_pull - cd * abs(yaw_rate)", law)
        error = refused(content, says)
        line = content.splitlines()[3]
        column = line.index(place, line.index('"')) + 1
        assert f"law: line 4, column {column}: " in str(error)
        shown, carets, *_ = error.hint.split("\n")
        assert shown == law
        assert carets.index("^") == law.index(place)

    def test_place_in_a_law_of_several_lines(self, refused):
        law = '"""\ndrawbar_pull\n  - cd * abs(yaw_rat)"""'
        error = refused(CABLE.replace('"drawbar_pull - cd * abs(yaw_rate)"', law), "line 6, column 14: ")
        assert error.hint.startswith("  - cd * abs(yaw_rat)\n             ^^^^^^^\n")

    def test_place_in_a_law_of_several(self, refused):
        content = CABLE.replace('changes = "drawbar_pull"', "").replace("law = ", "laws.drawbar_pull = ")
        refused(content.replace("yaw_rate)", "yaw_rat)"), "laws.drawbar_pull: line 4, column ")

    def test_place_with_escapes(self, refused):
        error = refused(CABLE.replace("abs(yaw_rate)", r"a\u0062s(yaw_rat)"), "law: column 25: ")
        assert "\n" + " " * 24 + "^^^^^^^" in error.hint

    def test_place_with_windows_lines(self, refused):
        refused(CABLE.replace("abs(yaw_rate)", "abs(yaw_rat)").replace("\n", "\r\n"), "line 4, column 32: ")

    def test_not_absent_at_null(self, refused):
        refused(
            CABLE.replace("drawbar_pull - cd * abs(yaw_rate)", "-cd * abs(yaw_rate)"),
            "does not give back drawbar_pull",
            "0 instead of",
            "yaw_rate = ",
            "gives the whole drawbar_pull, not its change",
        )

    def test_slightly_off_at_null(self, refused):
        refused(effect("torque", "torque * (1.000001 + a)"), "does not give back torque")

    def test_no_number_at_null(self, refused):
        refused(
            effect("torque", "torque + 0 * log(-abs(torque / (1 + a * 0)) / torque_rate)", "1"), "torque_rate"
        )
        refused(effect("torque", "torque * (1 + slip / a)", "1"), "gives no number", "a = 0")

    @pytest.mark.parametrize("changes", QUANTITIES)
    def test_reads_only_what_is_known_by_then(self, changes, refused, write):
        known = law_names.reached(changes)
        order = list(QUANTITIES)
        for name in order[order.index(changes) + 1 :]:
            if name in known:
                continue
            error = refused(effect(changes, f"{changes} * (1 + 0 * a * {name})"))
            assert re.search(f"{name} is (not known|read and not listed)", str(error))
        for name in known:
            law = f"{changes} * (1 + a * sign({name}))"
            assert effect_file.load(write(effect(changes, law, needs=[]))).laws.keys() == {changes}


class TestFileRefused:
    @pytest.mark.parametrize(
        ("old", "new", "says"),
        [
            ("title", "titel", "titel: unknown key; did you mean title?"),
            ("null = 0.0", "nul = 0.0", "parameters.cd.nul: unknown key; did you mean null?"),
            ('changes = "drawbar_pull"', 'changes = "drawbarpull"', "changes: must be one of slip, load"),
            ('id = "cable-drag"', 'id = "Cable drag"', "'Cable drag' is no id"),
            ('id = "cable-drag"', 'id = "../../etc"', "is no id"),
            ('id = "cable-drag"', "id = 5", "id: must be text, not 5"),
            ('id = "cable-drag"', "", "id is missing"),
            ('title = "Umbilical drags on the carriage"', 'title = "a\\nb"', "title: must be one line"),
            ('title = "Umbilical drags on the carriage"', "", "title is missing"),
            ('changes = "drawbar_pull"', "", "changes is missing"),
            ('law = "drawbar_pull - cd * abs(yaw_rate)"', "", "law is missing"),
            ('law = "drawbar_pull - cd * abs(yaw_rate)"', "law = 3", "law: must be text, not 3"),
            ('law = "drawbar_pull - cd * abs(yaw_rate)"', "laws = {}", "give changes or [laws], not both"),
            ('needs = ["yaw_rate"]', 'needs = "yaw_rate"', "needs: must be a list"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "yaw_rate"]', "yaw_rate is there twice"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "cohesion"]', "which nothing measures"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "width"]', "width is always known"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "entry_angle"]', "is always known"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "run"]', "run is a label"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "measured_torque"]', "the channel is torque"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "sqrt"]', "a word of the language"),
            ('needs = ["yaw_rate"]', 'needs = ["yaw_rate", "a`b"]', "no name that a law can read"),
            ('needs = ["yaw_rate"]', f"needs = {[f'n{k}' for k in range(21)]}", "needs: more than 20"),
            ('needs = ["yaw_rate"]', 'columns = {grip = "1"}', "columns.grip: not among the needs"),
            ('needs = ["yaw_rate"]', 'columns = {pitch = "deg"}', "the unit of a channel is known"),
            (
                'needs = ["yaw_rate"]',
                'needs = ["grip"]\ncolumns = {grip = "blue"}',
                "columns.grip: 'blue' is not",
            ),
            ('unit = "N s/rad"', "", "parameters.cd: unit is missing"),
            ('unit = "N s/rad"', "unit = 1", "parameters.cd.unit: must be text, not 1"),
            ('unit = "N s/rad"', 'unit = "N sec/rads"', "subtracts cd * abs(yaw_rate) ("),
            ('unit = "N s/rad"', 'unit = "newtonish"', "parameters.cd.unit: 'newtonish' is not a known unit"),
            ("null = 0.0", "", "null is missing"),
            ("null = 0.0", "null = -1.0", "null = -1 is not between lower and upper"),
            ("null = 0.0", "null = nan", "null: must be a number, not nan"),
            ("null = 0.0", "null = inf", "null: must be a number, not inf"),
            ("null = 0.0", "null = true", "null: must be a number, not True"),
            ("null = 0.0", 'null = "0"', "null: must be a number"),
            ("scale = 10.0", "scale = 0", "scale: must be a positive number, not 0"),
            ("scale = 10.0", "scale = -1", "scale: must be a positive number, not -1"),
            ("scale = 10.0", "scale = 1" + "0" * 400, "scale: must be a positive number"),
            ("scale = 10.0", "scale = 1" + "0" * 5000, "line 9 is longer than 2000"),
            ("scale = 10.0", "scale = 0x" + "f" * 1900, "scale: must be a positive number"),
            ("lower = 0.0", "lower = nan", "lower: must be a number"),
            ("lower = 0.0", "lower = 0.0\nupper = 0.0", "lower = 0 must be below upper = 0"),
            ("[parameters.cd]", "[parameters.yaw_rate]", "yaw_rate is a channel"),
            ("[parameters.cd]", "[parameters.cohesion]", "cohesion is a quantity of the model"),
            ("[parameters.cd]", "[parameters.sqrt]", "sqrt is a word of the language"),
            ("[parameters.cd]", "[parameters.pi]", "pi is a word of the language"),
            ("[parameters.cd]", "[parameters.slip_rate]", "slip_rate is a channel"),
            ("[parameters.cd]", "[parameters.wheel_radius]", "a quantity of the model"),
            ("[parameters.cd]", '[parameters."c d"]', "'c d' is no name of a parameter"),
            ("[parameters.cd]", '[parameters."__class__"]', "is no name of a parameter"),
            ("[parameters.cd]", "[parameter.cd]", "parameter: unknown key; did you mean parameters?"),
            ("[parameters.cd]", "[parameters]\ncd = 5\n[x]", "parameters.cd: must be a table, not 5"),
            ("id", 'kind = "magic"\nid', "kind: must be one of soil"),
            ("id", "id id", "not TOML"),
            ("id", "deep = " + "[\n" * 5000 + "]" * 1500 + "\nid", "not TOML: nested too deep"),
            ("id", "deep = " + "{a=" * 450 + "1" + "}" * 450 + "\nid", "not TOML: nested too deep"),
            ("id", "columns." + "a." * 900 + "a = 1\nid", "not TOML: a key has more than 40 parts"),
            ("id", "# x\n" * 20_000 + "\nid", "larger than 64 kB"),
        ],
    )
    def test_for(self, old, new, says, refused):
        assert old in CABLE
        refused(CABLE.replace(old, new, 1), says)

    def test_parameter_that_no_law_reads(self, refused):
        refused(CABLE + '[parameters.ce]\nunit = ""\nnull = 0\nscale = 1\n', "parameters.ce: no law reads ce")

    def test_no_parameter(self, refused):
        refused(CABLE.partition("[parameters")[0], "there is no parameter", "unit, null and scale")

    def test_too_many_parameters(self, refused):
        refused(
            CABLE + "".join(f'[parameters.p{k}]\nunit = ""\nnull = 0\nscale = 1\n' for k in range(20)),
            "more than 20 parameters",
        )

    def test_not_text(self, refused):
        refused(b"\xff\xfe\x00", "not text in UTF-8")

    def test_binary_zeros(self, refused):
        refused(bytes(100), "not TOML")

    def test_byte_order_mark_is_no_fault(self, write):
        assert effect_file.load(write(b"\xef\xbb\xbf" + CABLE.encode())).id == "cable-drag"

    def test_missing(self, tmp_path):
        with pytest.raises(NotFoundError, match="no such file"):
            effect_file.load(tmp_path / "none.toml")

    def test_folder(self, tmp_path):
        with pytest.raises(ConfigurationError, match="cannot be read"):
            effect_file.load(tmp_path)

    def test_device(self):
        with pytest.raises(ConfigurationError, match="/dev/zero: is a device, not a file"):
            effect_file.load("/dev/zero")

    def test_larger_than_any_law(self, write):
        with pytest.raises(ConfigurationError, match="larger than 64 kB"):
            effect_file.load(write(b"#" * 65_537))


class TestTrial:
    def test_every_quantity_and_channel_has_ordinary_values(self):
        numeric = {name for name, channel in CHANNELS.items() if channel.dimension != LABEL}
        names = {*QUANTITIES, *numeric, *law_names.reached("shear_stress"), *law_names.ON_DEMAND}
        drawn = law_trial.inputs(())
        assert names <= drawn.keys()
        assert all(np.all(np.isfinite(values)) for values in drawn.values())

    def test_they_go_together_as_in_the_model(self):
        """A law may say over again what the base says, by other names."""
        q = law_trial.inputs(())
        np.testing.assert_allclose(q["sinkage"], q["radius"] * (1.0 - np.cos(q["entry_angle"])))
        driving = q["slip"] >= 0.0
        slip = 1.0 - q["velocity"] / (q["wheel_radius"] * q["angular_velocity"])
        np.testing.assert_allclose(q["slip"][driving], slip[driving], atol=1e-12)
        assert np.all(q["depth"] > 0.0)

    def test_always_the_same(self):
        first, second = law_trial.inputs({"grip"}), law_trial.inputs({"grip"})
        assert all(np.array_equal(first[name], second[name]) for name in first)


def test_derivative_of_a_law_by_its_parameter_is_exact(write):
    law = effect_file.load(write(effect("torque", "torque * exp(-a * slip) + a^2 * torque", "1"))).laws[
        "torque"
    ]
    torque, slip, a = np.array([3.0, 8.0]), np.array([0.2, 0.7]), 0.4
    slope = law({"torque": torque, "slip": slip, "a": seed(np.full(2, a), "a")}).slopes["a"]
    np.testing.assert_allclose(slope, -slip * torque * np.exp(-a * slip) + 2.0 * a * torque)
