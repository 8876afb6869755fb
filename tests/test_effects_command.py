"""`terrain-est effects`: the catalogue, and a check that no file can fool or break."""

from __future__ import annotations

import json
import re
import signal
from pathlib import Path

import pytest

from terrain_cli import effects
from terrain_cli.effects.laws import effect_file, expression, grammar, law_names
from terrain_cli.mechanics.effect import KINDS, QUANTITIES, Effect

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "effects.md").read_text("utf-8")
EXAMPLE = re.search(r"```toml\n(id = .*?)```", PAGE, re.DOTALL)[1]


@pytest.fixture
def good(tmp_path):
    path = tmp_path / "cable-drag.toml"
    path.write_text(EXAMPLE, "utf-8")
    return path


class TestList:
    def test_has_every_effect(self, terrain_est_here):
        done = terrain_est_here("effects", "list")
        assert (done.returncode, done.stderr) == (0, "")
        header, *rows = done.stdout.splitlines()
        assert header.split() == ["id", "kind", "changes", "needs", "title"]
        # Then come the assumptions.
        assert [row.split()[0] for row in rows[: rows.index("")]] == list(effects.catalogue())

    def test_of_one_kind(self, terrain_est_here):
        done = terrain_est_here("effects", "list", "--kind", "sensor", "--json")
        shown = json.loads(done.stdout)
        assert shown["format"] == "terrain-est/effects/1"
        assert [effect["id"] for effect in shown["effects"]] == [
            effect.id for effect in effects.catalogue().values() if effect.kind == "sensor"
        ]


class TestShow:
    def test_tells_all(self, terrain_est_here):
        known = effects.find("grousers")
        done = terrain_est_here("effects", "show", "grousers")
        assert (done.returncode, done.stderr) == (0, "")
        shown = " ".join(done.stdout.split())
        for words in (
            known.title,
            known.formula,
            known.explanation,
            known.shows,
            known.settled_by,
            known.reference,
        ):
            assert " ".join(words.split()) in shown
        for parameter in known.parameters:
            assert f"{parameter.name} {parameter.unit} {parameter.null:g} {parameter.scale:g}" in shown
        assert max(map(len, done.stdout.splitlines())) <= 110

    def test_file_of_ones_own(self, good, terrain_est_here):
        done = terrain_est_here("effects", "show", good)
        assert done.returncode == 0
        assert re.search(r"^cd +N s/rad +0 +10 +0 +drag per yaw rate$", done.stdout, re.MULTILINE)

    def test_numbers_are_in_their_unit(self, good, terrain_est_here):
        good.write_text(EXAMPLE.replace("N s/rad", "N s/deg"), "utf-8")
        done = terrain_est_here("effects", "show", good, "--json")
        (effect,) = json.loads(done.stdout)["effects"]
        (cd,) = effect["parameters"]
        assert (cd["unit"], cd["null"], cd["scale"], cd["lower"], cd["upper"]) == (
            "N s/deg",
            0.0,
            10.0,
            0.0,
            None,
        )

    def test_unknown_effect_names_the_nearest(self, terrain_est_here):
        done = terrain_est_here("effects", "show", "slip-sinkag")
        assert (done.returncode, done.stdout) == (2, "")
        assert "did you mean slip-sinkage?" in done.stderr

    def test_missing_file(self, terrain_est_here):
        done = terrain_est_here("effects", "show", "none.toml")
        assert (done.returncode, done.stdout) == (66, "")
        assert done.stderr == "terrain-est: none.toml: no such file or folder\n"


class TestCheck:
    def test_good_file(self, good, terrain_est_here):
        done = terrain_est_here("effects", "check", good)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith(f"{good}: nothing is wrong\n")
        assert "the law gives drawbar_pull in N; it reads drawbar_pull [N], yaw_rate [rad/s]" in done.stdout
        assert "the law gives back drawbar_pull, exactly" in done.stdout

    def test_warnings_go_to_stderr(self, good, terrain_est_here):
        good.write_text(EXAMPLE.replace('["yaw_rate"]', '["yaw_rate", "pitch"]'), "utf-8")
        done = terrain_est_here("effects", "check", good)
        assert done.returncode == 0
        assert done.stderr == f"{good}: warning: needs pitch, which no law reads\n"
        assert terrain_est_here("effects", "check", good, "--quiet").stderr == ""

    def test_id_of_the_catalogue(self, good, terrain_est_here):
        good.write_text(EXAMPLE.replace("cable-drag", "slip-sinkage"), "utf-8")
        assert (
            "the catalogue has an effect slip-sinkage too"
            in terrain_est_here("effects", "check", good).stderr
        )

    def test_every_file_is_looked_at(self, good, tmp_path, terrain_est_here):
        wrong = tmp_path / "wrong.toml"
        wrong.write_text(EXAMPLE.replace("abs(yaw_rate)", "abs(yaw_rat)"), "utf-8")
        done = terrain_est_here("effects", "check", wrong, tmp_path / "none.toml", good)
        assert done.returncode == 78
        assert f"{good}: nothing is wrong" in done.stdout
        assert f"terrain-est: {wrong}: law: line 4, column 32: there is no yaw_rat; did you" in done.stderr
        assert "\n  drawbar_pull - cd * abs(yaw_rat)\n                          ^^^^^^^\n" in done.stderr
        assert "none.toml: no such file" in done.stderr
        assert terrain_est_here("effects", "check", tmp_path / "none.toml").returncode == 66

    def test_json(self, good, tmp_path, terrain_est_here):
        wrong = tmp_path / "wrong.toml"
        wrong.write_text(EXAMPLE.replace("null = 0.0", "null = -1.0"), "utf-8")
        done = terrain_est_here("effects", "check", good, wrong, "--json")
        assert done.returncode == 78
        shown = json.loads(done.stdout)
        assert shown["format"] == "terrain-est/effects-check/1"
        assert [file["ok"] for file in shown["files"]] == [True, False]
        assert shown["files"][0]["laws"] == [
            {
                "changes": "drawbar_pull",
                "unit": "N",
                "reads": {"drawbar_pull": "N", "yaw_rate": "rad/s"},
                "deviation_at_null": 0.0,
            }
        ]
        assert "null = -1 is not between" in shown["files"][1]["error"]


@pytest.fixture
def within_seconds():
    """Have the system end this process, whatever it is at, where a test takes more than ten seconds."""
    signal.alarm(10)
    yield
    signal.alarm(0)


HOSTILE = {
    "attribute": "drawbar_pull.__class__.__base__",
    "attribute of a parameter": "drawbar_pull - cd.real",
    "import": "__import__('os').system('touch {flag}')",
    "call": "open('{flag}', 'w')",
    "call without quotes": "exec(drawbar_pull)",
    "eval": "eval(cd)",
    "huge power": "drawbar_pull + cd * 9**9**9",
    "huge power of a parameter": "drawbar_pull + cd ** 99999999",
    "tower of powers": "drawbar_pull + cd * 2^9^9^9^9^9",
    "huge number": "drawbar_pull + cd * " + "9" * 900,
    "huge exponent": "drawbar_pull + cd * 1e" + "9" * 50,
    "deep brackets": "(" * 490 + "drawbar_pull" + ")" * 490,
    "deep signs": "-" * 900 + "drawbar_pull",
    "deep calls": "abs(" * 200 + "cd" + ")" * 190,
    "long": "drawbar_pull + " * 100 + "cd",
    "many": "+".join(["cd"] * 300),
    "index": "drawbar_pull[0]",
    "lambda": "lambda: drawbar_pull",
    "walrus": "(drawbar_pull := cd)",
    "comprehension": "[cd for cd in drawbar_pull]",
    "string": "'drawbar_pull' * 99",
    "format": "f'{{cd}}'",
    "lookalike": "dr\u0430wbar_pull - cd",
    "wide letters": "ｅｖａｌ(cd)",
    "hidden sign": "drawbar_pull\u200b - cd",
    "right to left": "drawbar_pull \u202e- cd",
    "null character": "drawbar_pull \\u0000",
    "words of Python": "None if drawbar_pull else True",
    "await": "await drawbar_pull",
    "yield": "(yield drawbar_pull)",
}


@pytest.mark.parametrize("what", HOSTILE)
@pytest.mark.usefixtures("within_seconds")
def test_hostile_law(what, tmp_path, terrain_est_here):
    path, flag = tmp_path / "hostile.toml", tmp_path / "flag"
    law = HOSTILE[what].replace("{flag}", str(flag))
    path.write_text(EXAMPLE.replace("drawbar_pull - cd * abs(yaw_rate)", law), "utf-8")
    assert law in path.read_text("utf-8")
    done = terrain_est_here("effects", "check", path)
    assert (done.returncode, done.stdout) == (78, "")
    assert done.stderr.startswith(f"terrain-est: {path}: law: ")
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 700
    assert not flag.exists()


@pytest.mark.parametrize(
    "content",
    [
        "\x00\x01",
        "a." * 20_000 + "a = 1",
        ("a." * 990 + "a = 1\n") * 30,
        "columns." + "a." * 990 + "a = 1",
        "id = " + "[\n" * 30_000,
        "id = " + "9" * 60_000,
        "id = 0x" + "f" * 60_000,
        "id = '" + "x" * 60_000 + "'",
        "x = 2026-02-31",
        "#" * 100_000,
        "[parameters.cd]\n" * 2,
        "parameters = 5",
        "[[parameters]]\nunit = '1'",
        "law = {a = 1}",
        "law = [[[[[[[[]]]]]]]]",
        "law = '''" + "drawbar_pull\n+ " * 4000,
        "'' = 1",
        "laws = {torque = 5}",
        "id = 'a'\ntitle = 'b'\nchanges = ['torque']\nlaw = 'torque'",
    ],
    ids=lambda content: repr(content[:20]),
)
@pytest.mark.usefixtures("within_seconds")
def test_hostile_file(content, tmp_path, terrain_est_here):
    path = tmp_path / "hostile.toml"
    path.write_text(content, "utf-8")
    done = terrain_est_here("effects", "check", path)
    assert (done.returncode, done.stdout) == (78, "")
    assert done.stderr.startswith(f"terrain-est: {path}: ")
    assert "Traceback" not in done.stderr
    assert len(done.stderr) < 700


class TestDocumentation:
    def test_first_example_is_right(self, good):
        understood = effect_file.read(good)
        assert understood.effect.id == "cable-drag"
        assert understood.warnings == []

    def test_python_example_is_the_same_effect(self, good):
        import numpy as np

        code = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1]
        space: dict[str, object] = {}
        exec(code, space)  # noqa: S102 - our own page
        own, python = effect_file.load(good), space["CABLE_DRAG"]
        assert isinstance(python, Effect)
        q = {"drawbar_pull": np.array([3.0, 4.0]), "yaw_rate": np.array([-0.1, 0.2]), "cd": 7.0}
        np.testing.assert_allclose(own.laws["drawbar_pull"](q), python.laws["drawbar_pull"](q))

    def test_names_all_that_a_law_may_use(self):
        for name, unit in QUANTITIES.items():
            assert f"| `{name}` | {unit} |" in PAGE
        for name in {*law_names.reached("shear_stress"), *law_names.ON_DEMAND} - QUANTITIES.keys():
            assert f"`{name}`" in PAGE
        (functions,) = re.findall(r"\| functions \| `([^`]*)`", PAGE)
        assert set(functions.split()) == expression.FUNCTIONS.keys() - {"where"}
        for bound in (grammar.LONGEST, grammar.LARGEST, grammar.DEEPEST, f"−{grammar.HIGHEST_POWER:g}"):
            assert f"{bound}" in PAGE
        for kind in KINDS:
            assert kind in PAGE

    def test_error_is_as_shown(self, good, terrain_est_here):
        shown = re.search(r"```\n(terrain-est: cable-drag.toml.*?)```", PAGE, re.DOTALL)[1]
        law = shown.splitlines()[1].strip()
        good.write_text(EXAMPLE.replace("drawbar_pull - cd * abs(yaw_rate)", law), "utf-8")
        done = terrain_est_here("effects", "check", good.name, cwd=good.parent)
        assert done.stderr.startswith(shown)

    def test_names_every_key(self, good, terrain_est_here):
        good.write_text("no_such_key = 1", "utf-8")
        hint = terrain_est_here("effects", "check", good).stderr.partition("known here: ")[2]
        for key in hint.strip().split(", "):
            assert f"`{key}" in PAGE
        good.write_text(EXAMPLE + "no_such_key = 1", "utf-8")
        hint = terrain_est_here("effects", "check", good).stderr.partition("known here: ")[2]
        for key in hint.strip().split(", "):
            assert f"`{key}`" in PAGE

    def test_names_every_key_of_json(self, good, terrain_est_here):
        part = PAGE.partition("## JSON")[2].partition("## An effect in Python")[0]

        def check(value):
            for inner in value if isinstance(value, list) else ():
                check(inner)
            if isinstance(value, dict):
                assert all(f'"{key}"' in part for key in value)
                for key, inner in value.items():
                    if key != "reads":
                        check(inner)

        for verb in (["list"], ["check", good], ["check", "none.toml"]):
            check(json.loads(terrain_est_here("effects", *verb, "--json").stdout))
