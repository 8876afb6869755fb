"""A user's own effect: what its file is refused for."""

from __future__ import annotations

import re

import pytest
from own_effects import CABLE, effect

from formats import NotFoundError
from terrain_cli.effects.laws import effect_file, law_names
from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.effect import QUANTITIES


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
            ("scale = 10.0", "scale = 1" + "0" * 5000, "not TOML"),
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
        with pytest.raises(ConfigurationError, match="is a folder"):
            effect_file.load(tmp_path)

    def test_device(self):
        with pytest.raises(ConfigurationError, match="/dev/zero: is a device, not a file"):
            effect_file.load("/dev/zero")

    def test_larger_than_any_law(self, write):
        with pytest.raises(ConfigurationError, match="longer than 4,194,304 characters"):
            effect_file.load(write(b"#" * 4_194_305))
