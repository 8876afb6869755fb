"""The completion scripts work in the shells they are for: a line is typed, Tab is pressed, and it is read."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import time

import pytest

SHELLS = [pytest.param(shell, marks=pytest.mark.real(shell)) for shell in ("bash", "zsh", "fish")]
LINES = [
    ("terrain-est est", "terrain-est estimate "),
    ("terrain-est estimate --seg", "terrain-est estimate --segments "),
    ("terrain-est estimate --segments no", "terrain-est estimate --segments none "),
    ("terrain-est estimate wal", "terrain-est estimate walk.bag "),
    ("terrain-est estimate walk.bag --rover lun", "terrain-est estimate walk.bag --rover lunar.toml "),
    ("terrain-est completion zs", "terrain-est completion zsh "),
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
def scripts(tmp_path, terrain_est):
    """Return a folder with the scripts, and two files to complete."""
    for shell, name in (("bash", "terrain-est.bash"), ("zsh", "_terrain-est"), ("fish", "terrain-est.fish")):
        (tmp_path / name).write_text(terrain_est("completion", shell).stdout)
    for name in ("walk.bag", "lunar.toml"):
        (tmp_path / name).touch()
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


def test_after_an_unknown_verb_the_shell_is_left_in_peace(terrain_est):
    asked = {"COMP_WORDS": "terrain-est nosuch --", "COMP_CWORD": "2"}
    done = terrain_est(env={"_TERRAIN_EST_COMPLETE": "bash_complete", **asked})
    assert done.stderr == ""
