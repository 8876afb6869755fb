"""No output onto an input: every verb, every option that names a file, whatever it is called."""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
from pathlib import Path

import click
import pytest
from test_conventions import CABLE
from wheel_table import ROVER, good, text

from man import generate
from terrain_cli.app import main
from terrain_cli.commands import paths
from terrain_cli.errors import UsageError

ROOT = Path(__file__).resolve().parent.parent
COMMANDS = {
    path.removeprefix("terrain-est "): context
    for path, context in ((context.command_path, context) for context in generate.contexts())
    if not isinstance(context.command, click.Group)
}
PARAMETERS = {
    f"{name} {max(parameter.opts, key=len)}": (name, parameter)
    for name, context in COMMANDS.items()
    for parameter in context.command.params
}
#: What each type is given to read; the model names the effect.
READ = {
    paths.INPUT: "run.csv",
    paths.ROVER: "rover.toml",
    paths.MODEL: "model.toml",
    paths.CHANGED: "model.toml",
    paths.EFFECT: "effect.toml",
    paths.EFFECT_FILE: "effect.toml",
    paths.PLACES: "places.csv",
    paths.DRIVE: "drive.toml",
}
#: Outputs of the verbs that read a file.
WRITTEN = {
    key: (name, parameter)
    for key, (name, parameter) in PARAMETERS.items()
    if isinstance(parameter.type, paths.Writes) and any(p.type in READ for p in COMMANDS[name].command.params)
}
MODEL = 'format = "terrain-est/model/1"\nbase = "wong-reece"\neffects = ["effect.toml"]\n'


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder that has something of everything that is read."""
    monkeypatch.chdir(tmp_path)
    drive = 'model = "model.toml"\n[effects]\n"effect.toml" = { cd = 2.0 }\n'
    contents = (text(good()), ROVER, MODEL, CABLE, "time,x,y\n0,0,0\n", drive)
    for name, content in zip(dict.fromkeys(READ.values()), contents, strict=True):
        Path(name).write_text(content)
    return tmp_path


@pytest.fixture
def refused(folder, capfd):
    """Return a function that asserts that a command is refused with 2 and one line, and does nothing."""

    def state():
        return {path: path.is_file() and path.read_bytes() for path in sorted(folder.rglob("*"))}

    def refused(*args):
        before = state()
        with pytest.raises(SystemExit) as end:
            main([str(arg) for arg in args])
        out, err = capfd.readouterr()
        assert (end.value.code, out) == (2, ""), (args, err)
        message, hint = err.splitlines()
        assert message.startswith("terrain-est: ")
        assert hint.startswith("  ")
        assert state() == before
        return message.removeprefix("terrain-est: ")

    return refused


def words(name, values):
    """Return the arguments of a command: parameter → value."""
    options = [[p.opts[0], value] for p, value in values.items() if isinstance(p, click.Option)]
    arguments = [[value] for p, value in values.items() if isinstance(p, click.Argument)]
    return [*name.split(), *itertools.chain(*arguments, *options)]


def given(name):
    """Return a file for each parameter of a command that reads one, and for those that must be given."""
    files = {p: READ[p.type] for p in COMMANDS[name].command.params if p.type in READ}
    if name == "simulate":
        # Where nothing else is named, its log would go to the standard output.
        files |= {p: "new.csv" for p in COMMANDS[name].command.params if p.name == "output"}
    required = {p: f"new-{p.name}" for p in COMMANDS[name].command.params if p.required and p not in files}
    return files | required


def aliases(file, parameter):
    """Yield names for a file, as the parameter takes them: as it is, and by links."""
    folders = isinstance(parameter.type, paths.PICTURES.__class__ | paths.BATCH.__class__)
    inner = "strength.svg" if parameter.type is paths.PICTURES else "manifest.jsonl"
    link, hard = Path(f"link-{file}"), Path(f"hard-{file}")
    for path in (link, hard):
        if folders:
            path.mkdir(exist_ok=True)
    (link / inner if folders else link).symlink_to(Path(file).resolve())
    (hard / inner if folders else hard).hardlink_to(file)
    yield from (file, f"./{file}", f"../{Path.cwd().name}/{file}", str(Path(file).resolve()))
    yield from (str(link), str(hard))


@pytest.mark.parametrize("key", WRITTEN)
def test_no_output_onto_an_input(key, refused):
    name, parameter = WRITTEN[key]
    base = given(name)
    inputs = {file for other, file in base.items() if not isinstance(other.type, paths.Writes)}
    # The model names the effect, and the drive names the model.
    inputs |= {"model.toml"} if "drive.toml" in inputs else set()
    inputs |= {"effect.toml"} if "model.toml" in {*inputs, *base.values()} else set()
    assert inputs
    for file in sorted(inputs):
        for alias in aliases(file, parameter):
            message = refused(*words(name, base | {parameter: alias}), *(["--force"] * takes_force(name)))
            what, onto = message.split(" would be written onto ")
            assert what == f"{parameter.metavar if what.startswith('FILE') else parameter.opts[0]} {alias}"
            assert onto.endswith(f" {file}")


@pytest.mark.parametrize("name", ["run.csv/", "run.csv/.", "./run.csv//"])
def test_a_slash_behind_a_file_is_none(refused, name):
    for option in ("-o", "--summary"):
        assert "onto the input run.csv" in refused("estimate", "run.csv", option, name)


@pytest.mark.parametrize("ending", ["-wal", "-journal"])
def test_what_sqlite_keeps_beside_a_database_is_an_input(refused, ending):
    for file in ("run.db3", f"run.db3{ending}"):
        Path(file).write_text("x")
    assert "onto the input" in refused("estimate", "--salvage", "run.db3", "--summary", f"run.db3{ending}")


def takes_force(name):
    return any("--force" in parameter.opts for parameter in COMMANDS[name].command.params)


PAIRS = [
    pytest.param(name, first, second, id=f"{name} {first.opts[-1]} {second.opts[-1]}")
    for name, context in COMMANDS.items()
    for first, second in itertools.combinations(
        (p for p in context.command.params if isinstance(p.type, paths.Writes)), 2
    )
]


@pytest.mark.parametrize(("name", "first", "second"), PAIRS)
def test_no_two_outputs_in_one_file(name, first, second, refused):
    Path("sub").mkdir()
    Path("up").symlink_to(".")
    Path("old.csv").write_text("old")
    Path("hard.csv").hardlink_to("old.csv")
    base = {p: file for p, file in given(name).items() if p.type in READ and p not in {first, second}}
    pictures = [p for p in (first, second) if p.type is paths.PICTURES]
    couples = [("out.csv", "out.csv"), ("out.csv", "./sub/../out.csv"), ("old.csv", "hard.csv")]
    couples += [("out.csv", "up/out.csv")]
    for one, two in couples:
        values = base | {first: one, second: two}
        if pictures:
            values = base | {first: "out/strength.svg", second: "out/strength.svg"} | {pictures[0]: "out"}
        message = refused(*words(name, values), *(["--force"] * takes_force(name)))
        if first.type is paths.CHANGED:
            continue
        assert message.startswith(f"{first.opts[0]} and {second.opts[0]} both go to ")


@pytest.mark.parametrize("name", COMMANDS)
def test_every_verb_compares_what_it_reads_and_writes(name):
    assert isinstance(COMMANDS[name].command, paths.Verb)


@pytest.mark.parametrize("key", PARAMETERS)
def test_every_name_of_a_file_is_declared_as_read_or_written(key):
    _, parameter = PARAMETERS[key]
    named = re.search(r"FILE|DIR|INPUT|EFFECT|MODEL|toml", parameter.metavar or "")
    assert isinstance(parameter.type, click.Path) == bool(named)
    if named:
        assert isinstance(parameter.type, paths.Named)


class TestWhatIsNotOnTheCommandLine:
    def test_environment(self, refused, monkeypatch):
        monkeypatch.setenv("TERRAIN_EST_SUMMARY", "run.csv")
        assert refused("estimate", "run.csv") == "--summary run.csv would be written onto the input run.csv"
        monkeypatch.setenv("TERRAIN_EST_SUMMARY", "places.csv")
        monkeypatch.setenv("TERRAIN_EST_PLACES", "places.csv")
        assert "onto the localisation table places.csv" in refused("estimate", "run.csv")

    @pytest.mark.parametrize("file", ["places.csv", "model.toml", "effect.toml"])
    def test_rover_file(self, refused, file):
        rover = f'{ROVER}[estimate]\nmodel = "model.toml"\nplaces = "places.csv"\n'
        Path("rover.toml").write_text(rover)
        assert f"--summary {file} would be written onto the " in refused(
            "estimate", "run.csv", "--summary", file
        )

    @pytest.mark.parametrize("verb", ["estimate", "report"])
    def test_rover_file_that_nobody_named(self, refused, verb):
        Path("day").mkdir()
        Path("run.csv").rename("day/run.csv")
        for rover in ("rover.toml", "day/rover.toml"):
            Path(rover).write_text(ROVER)
            assert (
                refused(verb, "day", "-o", rover)
                == f"-o {rover} would be written onto the rover file {rover}"
            )

    def test_names_that_simulate_gives(self, refused):
        assert refused("simulate", "--hide", "-o", "x.csv", "--rover", "x.csv.sealed.json") == (
            "--truth and --rover both go to x.csv.sealed.json"
        )
        Path("rover.toml").unlink()
        assert refused("simulate", "-o", "x.csv", "--truth", "rover.toml") == (
            "--truth and --rover both go to rover.toml"
        )


def log_folder(name, *files):
    """Make a folder of files; nothing is read of them before the command is refused."""
    for file in files:
        Path(name, file).parent.mkdir(parents=True, exist_ok=True)
        Path(name, file).write_text("x")


class TestFolders:
    @pytest.mark.parametrize("files", [("metadata.yaml", "a.mcap"), ("a.parquet",), ("k=1/a.parquet",)])
    @pytest.mark.parametrize("output", ["soil.csv", "soil.json", "sub/soil.gpkg"])
    def test_a_folder_that_is_one_log_stays_as_it_is(self, refused, files, output):
        log_folder("log", *files)
        Path("link").symlink_to("log")
        for name, other in (("log", "link"), ("link", "log"), ("log/", "log")):
            assert refused("estimate", name, "-o", f"{other}/{output}") == (
                f"-o {other}/{output} lies in {name}, a folder that is one log"
            )
        assert "a folder that is one log" in refused("compare", "log", "--plot", "log")
        assert "a folder that is one log" in refused("batch", "log", "-o", "log/mission")
        assert "onto the input log" in refused("estimate", "log", "--summary", f"log/{files[-1]}")

    def test_partitions_that_lie_elsewhere(self, refused):
        log_folder("elsewhere", "a.parquet")
        log_folder("log", "k=1/a.parquet")
        Path("log/k=2").symlink_to("../elsewhere")
        assert "lies in log, a folder" in refused("estimate", "log", "-o", "elsewhere/soil.csv")

    @pytest.mark.parametrize("name", ["day", "day/*.csv", "day/**", "d?y/*", "."])
    def test_nothing_that_the_next_run_would_take_for_a_log(self, refused, name):
        log_folder("day", "a.csv", "b.bag")
        output = "soil.csv" if name == "." else "day/soil.csv"
        assert refused("estimate", name, "-o", output) == (
            f"-o {output} would be read as an input in the next run: {name} includes it"
        )
        Path(output).write_text("x")
        assert "onto the input" in refused("estimate", name, "-o", output)


def allowed(*args):
    """Compare what a command would read and write, and do nothing else."""
    name = args[0]
    command = COMMANDS[name].command
    paths.check(command.make_context(name, [str(arg) for arg in args[1:]], parent=COMMANDS[name].parent))


@pytest.mark.usefixtures("folder")
class TestAllowed:
    def test_devices_and_pipes(self):
        os.mkfifo("pipe")
        for place in ("/dev/null", "/dev/stderr", "pipe"):
            allowed("estimate", "run.csv", "-o", place, "--summary", place, "--rejects", place)
        allowed("estimate", "run.csv", "-o", "/dev/stdout", "--summary", "soil.json")
        allowed("estimate", "run.csv", "--summary", "-", "-o", "soil.csv")
        allowed("compare", "run.csv", "--plot", "pictures")

    def test_two_layers(self):
        Path("up").symlink_to(".")
        allowed("estimate", "run.csv", "-o", "soil.gpkg", "--samples", "./up/soil.gpkg")

    def test_beside_the_inputs(self):
        log_folder("day", "a.csv", "b.bag")
        for output in ("day/soil.gpkg", "day/sub/soil.csv", "day/_soil.csv", "soil.csv"):
            allowed("estimate", "day", "-o", output, "--plot", "day")
        allowed("estimate", "day/*.bag", "-o", "day/soil.csv")
        allowed("estimate", "day/a.csv", "-o", "day/soil.csv")

    def test_a_model_file_that_is_changed_where_it_lies(self):
        log_folder("log", "metadata.yaml", "a.mcap", "model.toml")
        allowed("model add", "log/model.toml", "slope", "--data", "log")

    def test_what_is_no_file_of_this_name(self):
        Path("wong-reece").write_text("x")
        allowed("report", "run.csv", "-o", "wong-reece", "--force")
        allowed("model new", "slip-sinkage", "--effect", "slip-sinkage")

    def test_names_that_no_file_can_have(self):
        Path("model.toml").write_text(MODEL.replace("effect.toml", "a\\u0000.toml"))
        Path("loop").symlink_to("loop")
        for name in ("a" * 300, "loop", "none/x.csv", "run.csv/x.csv"):
            allowed("estimate", "run.csv", "--model", "model.toml", "--places", "loop", "--summary", name)

    def test_a_working_folder_that_is_gone(self):
        Path("gone").mkdir()
        os.chdir("gone")
        Path("../gone").rmdir()
        allowed("estimate", "run.csv", "--summary", "soil.json", "--plot", "pictures", "--model", "m.toml")

    def test_inputs_that_are_missing_are_told_by_who_opens_them(self):
        allowed("estimate", "none.csv", "none*.bag", "-o", "none.csv", "--model", "none.toml")


@pytest.mark.usefixtures("folder")
class TestStandardOutput:
    @pytest.mark.parametrize("name", ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
    def test_takes_one_output(self, name):
        for args in (("--rejects", name), ("-o", "/dev/stdout", "--summary", name)):
            with pytest.raises(UsageError, match="both go to standard output"):
                allowed("estimate", "run.csv", *args)
        with pytest.raises(UsageError, match="--draft both go to standard output"):
            allowed("diagnose", "run.csv", "--draft", name)

    @pytest.mark.parametrize(
        ("args", "says"),
        [
            (("inspect", "run.csv"), "standard output would be written onto the input run.csv"),
            (("estimate", "-", "-o", "run.csv"), "-o run.csv would be written onto standard input"),
            (
                ("estimate", "places.csv", "--summary", "run.csv"),
                "the result and --summary both go to run.csv",
            ),
        ],
    )
    def test_is_a_file_where_the_shell_says_so(self, args, says):
        """`>> run.csv` and `< run.csv`, as users run it."""
        before = Path("run.csv").read_bytes()
        command = [sys.executable, "-m", "terrain_cli", *args]
        env = {**os.environ, "PYTHONPATH": str(ROOT)}
        with Path("run.csv").open() as stdin, Path("run.csv").open("a") as stdout:
            done = subprocess.run(
                command, stdin=stdin, stdout=stdout, stderr=subprocess.PIPE, env=env, text=True, check=False
            )
        assert done.returncode == 2
        assert done.stderr.splitlines()[0] == f"terrain-est: {says}"
        assert Path("run.csv").read_bytes() == before


@pytest.mark.usefixtures("folder")
def test_summary_to_standard_output(capfd):
    with pytest.raises(SystemExit):
        main(["estimate", "-q", "run.csv", "-o", "soil.csv", "--summary", "-"])
    assert capfd.readouterr().out.startswith('{\n  "format": "terrain-est/summary/')
    assert not Path("-").exists()
