"""What every verb owes its users: help, examples, names, quick answers and no escape codes."""

from __future__ import annotations

import itertools
import os
import platform
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path
from types import SimpleNamespace

import click
import pytest
from terminals import on_terminal

import terrain_cli
from man import generate
from terrain_cli.app import VERBS, cli
from terrain_cli.commands import options

ROOT = Path(__file__).resolve().parent.parent
CONTEXTS = {context.command_path: context for context in generate.contexts()}
OPTIONS = {
    f"{path} {max(option.opts, key=len)}": (option, context)
    for path, context in CONTEXTS.items()
    for option in context.command.params
    if isinstance(option, click.Option)
}
#: Too slow for an answer in the twinkling of an eye; each is imported where it is used.
HEAVY = ("numpy", "pandas", "scipy", "pyarrow", "rosbags", "pyogrio")


def calls(text):
    """Yield the arguments of every call of terrain-est in lines of shell."""
    for line in text.replace("\\\n", " ").splitlines():
        lexer = shlex.shlex(line, posix=True, punctuation_chars="|>&;")
        lexer.whitespace_split = True
        words = list(lexer)
        for start, word in enumerate(words):
            if word == "terrain-est":
                yield list(itertools.takewhile(lambda word: word[0] not in "|>&;", words[start + 1 :]))


@pytest.mark.parametrize("path", CONTEXTS)
class TestVerb:
    def test_has_help(self, path):
        command = CONTEXTS[path].command
        assert len(command.help) > 40
        assert generate.short_help(command).endswith(".")

    def test_examples_can_be_called(self, path):
        examples = list(calls(generate.blocks(CONTEXTS[path].command.epilog)["Examples"]))
        assert examples
        for words in examples:
            name, *args = "terrain-est", *words
            while isinstance(CONTEXTS[name].command, click.Group):
                name, *args = f"{name} {args[0]}", *args[1:]
            assert name.startswith(path)
            # With its parent: click remembers the names of the help option from the first call.
            CONTEXTS[name].command.make_context(name, args, parent=CONTEXTS[name].parent)

    def test_help_fits_a_terminal(self, path, terrain_est):
        done = terrain_est(*path.split()[1:], "--help", env={"COLUMNS": "80"})
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith(f"Usage: {path} ")


@pytest.mark.parametrize("name", OPTIONS)
class TestOption:
    def test_has_help(self, name):
        option, _ = OPTIONS[name]
        assert option.help
        assert option.help[0].isupper()
        assert re.sub(r"(\s*\[[^]]*\])+$", "", option.help).endswith((".", '".', ":"))

    def test_environment_variable_is_named_after_it(self, name):
        option, context = OPTIONS[name]
        variable = generate.variable(option, context)
        long = max(option.opts, key=len)
        assert variable in {None, "TERRAIN_EST_" + long.lstrip("-").replace("-", "_").upper()}

    def test_short_and_long_name(self, name):
        option, _ = OPTIONS[name]
        assert re.fullmatch(r"--[a-z]+(-[a-z]+)*", max(option.opts, key=len))


@pytest.mark.parametrize("verb", VERBS)
def test_verb_is_called_as_the_list_of_verbs_calls_it(verb):
    assert cli.get_command(click.Context(cli), verb).name == verb


def test_verb_of_two_words_is_a_module_with_an_underscore(monkeypatch):
    command = click.Command("two-words")
    monkeypatch.setitem(sys.modules, "terrain_cli.commands.two_words", SimpleNamespace(command=command))
    monkeypatch.setitem(VERBS, "two-words", "Say two words.")
    assert cli.get_command(click.Context(cli), "two-words") is command
    assert generate.short_help(command) == "Say two words."


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [("estimat", "estimate"), ("inpsect", "inspect"), ("Estimate", "estimate"), ("complete", "completion")],
)
def test_unknown_verb_names_the_nearest(wrong, meant, terrain_est):
    done = terrain_est(wrong, "run.bag")
    assert (done.returncode, done.stdout) == (2, "")
    assert f"no such command: {wrong}; did you mean {meant}?" in done.stderr


def test_unknown_option_names_the_nearest(terrain_est):
    done = terrain_est("estimate", "run.bag", "--segment", "none")
    assert (done.returncode, done.stdout) == (2, "")
    assert "--segments" in done.stderr


def test_version_stands_in_one_place(terrain_est):
    done = terrain_est("--version")
    first, python, place = done.stdout.splitlines()
    assert first == f"terrain-est, version {terrain_cli.__version__}"
    assert python.startswith(f"Python {platform.python_version()} on ")
    assert place.startswith(f"installed in {ROOT / 'terrain_cli'} (")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert project["project"]["dynamic"] == ["version"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {"attr": "terrain_cli.version.__version__"}
    assert f"[{terrain_cli.__version__}]" in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.mark.parametrize("args", [["--help"], ["--version"], *([verb, "--help"] for verb in VERBS)])
def test_help_loads_nothing_heavy(args):
    code = (
        "import sys; from terrain_cli.app import main\n"
        f"try: main({args!r})\n"
        f"finally: print(*(name for name in {HEAVY!r} if name in sys.modules), file=sys.stderr)"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout
    assert done.stderr.split() == []


class TestNoEscapeCodes:
    CALLS = (
        ["--help"],
        ["estimate", "--help"],
        ["estimate", "no-such-file.bag"],
        ["estimate", str(ROOT / "sample_data" / "run.csv")],
        ["inspect", str(ROOT / "sample_data" / "run.bag")],
    )

    @pytest.mark.parametrize("args", CALLS, ids=" ".join)
    def test_on_a_terminal_with_no_color(self, args, bin_folder):
        shown = on_terminal([bin_folder / "terrain-est", *args], NO_COLOR="1")
        assert shown
        assert "\x1b" not in shown

    @pytest.mark.parametrize("args", CALLS, ids=" ".join)
    def test_without_a_terminal(self, args, terrain_est):
        done = terrain_est(*args, env={"TERM": "xterm-256color"})
        assert done.stdout or done.stderr
        assert "\x1b" not in done.stdout + done.stderr

    WORK = """
import time
from terrain_cli.presentation import terminal
terminal.PATIENCE = 0.0
with terminal.Progress(2, enabled={enabled}) as bar:
    bar.say("run.bag", "reading")
    bar.advance()
    time.sleep(0.4)
    bar.say("run.mcap", "wheel", 0.5)
    time.sleep(0.4)
print("done")
"""

    def test_progress_bar(self):
        shown = on_terminal([sys.executable, "-c", self.WORK.format(enabled=True)], PYTHONPATH=str(ROOT))
        assert re.search(r"\r█{12}░{12} 1/2  0 s  run\.bag  reading +\r", shown)
        # Half of the second input.
        assert re.search(r"\r█{18}░{6} 1/2  \d s  run\.mcap  wheel +\r", shown)
        assert re.search(r"\r +\rdone\s*$", shown)
        assert "\x1b" not in shown

    TELL = """
import sys, time
from terrain_cli.presentation import terminal
terminal.PATIENCE = 0.0
with terminal.Progress(2, enabled={enabled}) as bar:
    time.sleep(0.4)
    bar.tell("first\\n  second")
"""

    def test_what_is_told_stays_beneath_no_bar(self):
        shown = on_terminal([sys.executable, "-c", self.TELL.format(enabled=True)], PYTHONPATH=str(ROOT))
        assert re.search(r"\r +\rfirst\r\n  second\r\n", shown)

    @pytest.mark.parametrize(("enabled", "told"), [(True, "first\n  second\n"), (False, "")])
    def test_what_is_told_reaches_a_pipe_without_a_bar(self, enabled, told):
        command = [sys.executable, "-c", self.TELL.format(enabled=enabled)]
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
        assert (done.stdout, done.stderr) == ("", told)

    def test_no_progress_bar_when_quiet(self):
        shown = on_terminal([sys.executable, "-c", self.WORK.format(enabled=False)], PYTHONPATH=str(ROOT))
        assert shown.split() == ["done"]


@pytest.mark.parametrize(
    "name", [name for name, (o, _) in OPTIONS.items() if isinstance(o.type, click.FloatRange)]
)
@pytest.mark.parametrize("value", ["nan", "inf", "1e300"])
def test_a_number_that_has_a_range_is_finite(name, value):
    """For click nan lies within every range; and a number may be so large that its square is none."""
    option, context = OPTIONS[name]
    with pytest.raises(click.BadParameter, match=r"not a finite number|is more than|is not in the range"):
        option.type.convert(value, option, context)


@pytest.mark.parametrize(
    "name", [name for name, (o, _) in OPTIONS.items() if isinstance(o.type, options.Count)]
)
def test_a_count_has_a_largest_value_too(name):
    option, context = OPTIONS[name]
    with pytest.raises(click.BadParameter, match="is more than"):
        option.type.convert("1" + 13 * "0", option, context)
