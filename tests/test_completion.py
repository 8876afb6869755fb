"""The completion scripts work in the shells they are for: a line is typed, Tab is pressed, and it is read."""

from __future__ import annotations

import os
import pty
import select
import shutil
import subprocess
import time

import pytest
from click.shell_completion import BashComplete

from man import generate
from terrain_cli.app import cli
from terrain_cli.effects import NAMES
from terrain_cli.simulation.drive_file import PRESETS
from terrain_cli.simulation.scenario import SOILS

SHELLS = [pytest.param(shell, marks=pytest.mark.real(shell)) for shell in ("bash", "zsh", "fish")]
LINES = [
    ("terrain-est est", "terrain-est estimate "),
    ("terrain-est estimate --seg", "terrain-est estimate --segments "),
    ("terrain-est estimate --segments no", "terrain-est estimate --segments none "),
    ("terrain-est estimate wal", "terrain-est estimate walk.bag "),
    ("terrain-est estimate walk.bag --rover lun", "terrain-est estimate walk.bag --rover lunar.toml "),
    ("terrain-est completion zs", "terrain-est completion zsh "),
    ("terrain-est model new m.toml --effect slip-si", "terrain-est model new m.toml --effect slip-sinkage "),
    ("terrain-est effects show lun", "terrain-est effects show lunar.toml "),
    ("terrain-est simulate --soil lu", "terrain-est simulate --soil lunar-soil "),
    ("terrain-est simulate --drive slip-", "terrain-est simulate --drive slip-sweep "),
    ("terrain-est estimate --method rec", "terrain-est estimate --method recursive "),
    ("terrain-est compare walk.bag --model wo", "terrain-est compare walk.bag --model wong-reece "),
    ("terrain-est estimate walk.bag --wheel front-l", "terrain-est estimate walk.bag --wheel front-left "),
]
#: What each shell is told first: load the script, and on Ctrl-X L write the line as it stands to a file.
SETUP = {
    "bash": """
        source ./terrain-est.bash
        capture() { printf %s "$READLINE_LINE" > part; mv part line; }
        bind -x '"\\C-xl": capture'
    """,
    "zsh": """
        fpath=("$PWD" $fpath); autoload -U compinit; compinit -D -u
        capture() { print -rn -- "$BUFFER" > part; mv part line }
        zle -N capture; bindkey '^Xl' capture
    """,
}
START = {"bash": ["bash", "--norc", "--noprofile", "-i"], "zsh": ["zsh", "-f", "-i"]}


@pytest.fixture
def scripts(tmp_path):
    """Return a folder with the scripts that are packed, and two files to complete."""
    for path in generate.scripts():
        name = f"{path.name}.bash" if path.parent.name == "bash" else path.name
        shutil.copy(path, tmp_path / name)
    for name in ("walk.bag", "lunar.toml"):
        (tmp_path / name).touch()
    (tmp_path / "rover.toml").write_text("[wheels.front-left]\n[wheels.rear]\n")
    return tmp_path


def environment(bin_folder):
    return {
        **os.environ,
        "PATH": f"{bin_folder}:{os.environ['PATH']}",
        "TERM": "dumb",
        "HOME": str(bin_folder),
    }


def typed(shell, line, scripts, bin_folder):
    """Type a line and Tab, as a person does, and return what the line has become."""
    if shell == "fish":
        command = f"source terrain-est.fish; complete --do-complete '{line}'"
        done = subprocess.run(
            ["fish", "--no-config", "--command", command],
            cwd=scripts,
            env=environment(bin_folder),
            capture_output=True,
            text=True,
            check=True,
        )
        offered = [option.partition("\t")[0] for option in done.stdout.splitlines()]
        assert not done.stderr
        return f"{line.rpartition(' ')[0]} {offered[0]} " if len(offered) == 1 else offered
    main, side = pty.openpty()
    process = subprocess.Popen(
        START[shell],
        stdin=side,
        stdout=side,
        stderr=side,
        cwd=scripts,
        env=environment(bin_folder),
        start_new_session=True,
    )
    os.close(side)
    (scripts / "setup").write_text(SETUP[shell])
    os.write(main, b"source ./setup\n")
    os.write(main, f"{line}\t\x18l".encode())
    result, shown, deadline = scripts / "line", b"", time.monotonic() + 20
    while not result.exists() and time.monotonic() < deadline:
        if select.select([main], [], [], 0.05)[0]:
            shown += os.read(main, 4096)
    process.kill()
    process.wait()
    os.close(main)
    assert result.exists(), shown.decode(errors="replace")
    return result.read_text()


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(("line", "completed"), LINES)
def test_tab(shell, line, completed, scripts, bin_folder):
    assert typed(shell, line, scripts, bin_folder) == completed


def offered(words, **environment):
    asked = {"COMP_WORDS": f"terrain-est {words}", "COMP_CWORD": str(words.count(" ") + 1)}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {**asked, **environment}.items():
            patch.setenv(name, value)
        completion = BashComplete(cli, {}, "terrain-est", "_TERRAIN_EST_COMPLETE")
        return completion.complete().splitlines()


def test_ids_and_files_where_both_may_stand():
    assert offered("model add m.toml ") == ["file,", *(f"plain,{name}" for name in NAMES)]
    assert offered("compare --model li") == ["file,li", "plain,linear"]


def test_every_soil_and_every_drive_is_offered():
    assert offered("simulate --soil ") == [f"plain,{name}" for name in SOILS]
    assert offered("simulate --drive ") == [f"plain,{name}" for name in PRESETS]


@pytest.mark.parametrize(
    ("words", "names"),
    [
        ("estimate --wheel ", []),
        ("estimate run.bag --wheel ", []),
        ("estimate day/run.bag --wheel ", ["fl", "fr"]),
        ("estimate run.bag --rover day/rover.toml --wheel fr", ["fr"]),
        ("estimate run.bag --rover wrong.toml --wheel ", []),
    ],
)
def test_wheels_are_those_of_the_rover_file(words, names, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "day").mkdir()
    (tmp_path / "day" / "rover.toml").write_text("[wheels.fl]\n[wheels.fr]\n")
    (tmp_path / "wrong.toml").write_text("[wheels")
    assert offered(words) == [f"plain,{name}" for name in names]


def test_after_an_unknown_verb_the_shell_is_left_in_peace(terrain_est):
    asked = {"COMP_WORDS": "terrain-est nosuch --", "COMP_CWORD": "2"}
    done = terrain_est(env={"_TERRAIN_EST_COMPLETE": "bash_complete", **asked})
    assert done.stderr == ""
