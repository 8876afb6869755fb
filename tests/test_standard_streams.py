"""Devices as input, copies of pipes, signals, and standard streams that are closed or full."""

import importlib.machinery
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from child_processes import TERRAIN_EST

import terrain_cli

ROOT = Path(__file__).resolve().parent.parent
RUN = ROOT / "sample_data" / "run.csv"
#: Its first rows: where names are told does not hang on how long a log is.
BEGINNING = "".join(RUN.read_text("utf-8").splitlines(keepends=True)[:400])
HEAD = ["estimate", str(RUN), "--segments", "none", "--method", "least-squares"]


def shell(line, **options):
    """Run a line of bash in which $T is the command."""
    env = {**os.environ, "PYTHONPATH": str(ROOT), "T": f"{sys.executable} -m terrain_cli"}
    env |= options.pop("env", {})
    return subprocess.run(
        ["bash", "-c", line], capture_output=True, text=True, env=env, timeout=60, check=False, **options
    )


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full"])
def test_a_device_is_no_input(device, tmp_path, terrain_est_here):
    link = tmp_path / "run.csv"
    link.symlink_to(device)
    for verb in ("estimate", "inspect"):
        done = terrain_est_here(verb, link, "--rover", ROOT / "sample_data" / "rover.toml")
        assert done.returncode == 65
        assert f"{link}: is a device, not a file" in done.stderr


def test_a_pipe_larger_than_allowed_is_refused(tmp_path):
    line = f"yes 0,1,2,3 | head -c 3000000 | $T estimate - --rover {RUN.parent}/rover.toml --largest 0.001"
    done = shell(line, env={"TMPDIR": str(tmp_path)})
    assert done.returncode == 73
    assert "is larger than the 0.001 GB that are copied" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGKILL, -signal.SIGKILL)]
)
def test_no_signal_leaves_anything_of_a_pipe(number, code, tmp_path):
    command = [*TERRAIN_EST, "estimate", "-", "-o", str(tmp_path / "out.gpkg")]
    env = {**os.environ, "PYTHONPATH": str(ROOT), "TMPDIR": str(tmp_path)}
    process = subprocess.Popen(
        [*command, "--rover", str(RUN.parent / "rover.toml")],
        stdin=subprocess.PIPE, stderr=subprocess.PIPE, env=env, start_new_session=True,
    )  # fmt: skip
    process.stdin.write(RUN.read_bytes()[:200_000])
    process.stdin.flush()
    # The copy is open once the pipe was read.
    descriptors = Path(f"/proc/{process.pid}/fd")
    deadline = time.monotonic() + 20
    while time.monotonic() < deadline:
        if any(str(tmp_path) in str(fd.readlink()) for fd in descriptors.iterdir() if fd.is_symlink()):
            break
        time.sleep(0.02)
    else:
        pytest.fail("no copy was begun")
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    assert process.returncode == code
    assert not list(tmp_path.iterdir())
    assert b"Traceback" not in said


@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_no_signal_leaves_anything_of_a_geopackage(number, code, tmp_path):
    (tmp_path / "site").mkdir()
    # Styles that take their time: the layers are written, and a journal is there.
    (tmp_path / "site/sitecustomize.py").write_text(
        "import time\nfrom formats.output import geopackage\n"
        "def stop(database, styles):\n"
        "    database.execute('UPDATE gpkg_contents SET identifier = table_name || 1')\n"
        "    open('begun', 'w').close()\n"
        "    time.sleep(60)\n"
        "geopackage._write_styles = stop\n"
    )
    out = tmp_path / "out"
    out.mkdir()
    process = subprocess.Popen(
        [*TERRAIN_EST, "estimate", str(RUN), "-q", "--method", "least-squares", "-o", str(out / "soil.gpkg")],
        stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": f"{tmp_path / 'site'}:{ROOT}"},
        cwd=tmp_path, start_new_session=True,
    )  # fmt: skip
    deadline = time.monotonic() + 40
    # The layers had a journal too, which is gone.
    while time.monotonic() < deadline and not (tmp_path / "begun").exists():
        time.sleep(0.02)
    assert len(list(out.iterdir())) == 2
    process.send_signal(number)
    _, said = process.communicate(timeout=20)
    assert process.returncode == code, said
    assert not list(out.iterdir())
    assert b"Traceback" not in said


def test_a_pipe_for_which_there_is_no_room_is_refused(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(
        "import shutil, collections\nUsage = collections.namedtuple('Usage', 'total used free')\n"
        "shutil.disk_usage = lambda path: Usage(1 << 40, 0, 60 << 20)\n"
    )
    (tmp_path / "copies").mkdir()
    env = {"TMPDIR": str(tmp_path / "copies"), "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    done = shell(f"cat {RUN} | $T estimate - --rover {RUN.parent}/rover.toml", env=env)
    assert done.returncode == 73
    assert done.stderr.startswith(
        f"terrain-est: {tmp_path}/copies: no room for a copy of standard input: less than"
    )
    assert "set TMPDIR to a larger disk" in done.stderr
    assert not list((tmp_path / "copies").iterdir())


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("$T estimate - --rover {rover} <&-", 66),
        ("$T {run} >&-", 73),
        ("$T {run} 2>&- | wc -l", 0),
        ("$T {run} 2>/dev/full | wc -l", 0),
        ("$T {run} --segments fixed --window-distance nan", 2),
        ("$T {run} --segments fixed --window-distance inf", 2),
    ],
)
def test_streams_and_numbers_end_with_their_own_code(line, code):
    run = shlex.join(HEAD)
    done = shell("set -o pipefail; " + line.format(run=run, rover=RUN.parent / "rover.toml"))
    assert done.returncode == code, done.stderr
    assert "please report" not in done.stderr
    assert "Traceback" not in done.stderr


def test_a_name_that_the_terminal_lacks(tmp_path):
    log = tmp_path / "Fähre-φ.csv"
    log.write_text(BEGINNING, "utf-8")
    line = f"$T estimate {log} --rover {RUN.parent}/rover.toml --segments none"
    done = shell(line, env={"LC_ALL": "C", "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"})
    assert done.returncode == 0, done.stderr


def test_the_standard_output_by_its_name(tmp_path):
    plain = shell(f"$T {shlex.join(HEAD)} --quiet")
    named = shell(f"$T {shlex.join(HEAD)} --quiet -o /dev/stdout | cat")
    passed = shell(
        f"$T {shlex.join(HEAD)} --quiet -o >(cat > {tmp_path}/out.csv); sleep 0.5; cat {tmp_path}/out.csv"
    )
    assert named.stdout == plain.stdout == passed.stdout != ""


def test_control_characters_do_not_reach_the_terminal(tmp_path, terrain_est_here):
    log = tmp_path / "run\x1b[2J\u202e.csv"
    log.write_text(BEGINNING.replace("front-left", "front\x1b]0;x\x07left"), "utf-8")
    rover = tmp_path / "rover.toml"
    rover.write_text("[wheel]\nradius = 0.1\nwidth = 0.1\n[soil]\nshear_modulus = 0.02\n", "utf-8")
    for args in (["inspect", log], ["estimate", log, "--segments", "none", "-o", tmp_path / "out.csv"]):
        done = terrain_est_here(*args, "--rover", rover)
        said = done.stdout + done.stderr
        assert not {"\x1b", "\x07", "\u202e"} & set(said)
        assert "\\x1b" in said
    assert "\x1b]0;x\x07" in (tmp_path / "out.csv").read_text("utf-8")


def test_another_module_of_the_name_formats(tmp_path):
    (tmp_path / "formats.py").write_text("", "utf-8")
    done = shell("$T estimate run.csv", cwd=tmp_path, env={"PYTHONPATH": f"{tmp_path}:{ROOT}"})
    assert done.returncode == 2
    assert str(tmp_path / "formats.py") in done.stderr
    assert "Traceback" not in done.stderr


def test_modules_in_the_working_folder_are_none_of_ours(tmp_path):
    for name in ("click", "formats", "numpy", "tomllib"):
        (tmp_path / f"{name}.py").write_text('raise RuntimeError("mine")\n', "utf-8")
    done = shell(f"{sys.executable} -m terrain_cli inspect {RUN}", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "wheel front-left" in done.stdout


def test_a_path_without_the_working_folder_stays_whole(tmp_path):
    (tmp_path / "click.py").write_text("raise RuntimeError('first')\n", "utf-8")
    # What the user puts first himself is his own choice.
    path = {"PYTHONSAFEPATH": "1", "PYTHONPATH": f"{tmp_path}:{ROOT}"}
    done = shell("$T --version", env=path)
    assert "RuntimeError: first" in done.stderr


def test_a_folder_of_the_name_formats(tmp_path, monkeypatch):
    spec = importlib.machinery.ModuleSpec("formats", None, is_package=True)
    spec.submodule_search_locations = [str(tmp_path)]
    monkeypatch.setattr(terrain_cli, "find_spec", lambda _: spec)
    with pytest.raises(terrain_cli.ForeignFormatsError, match=str(tmp_path)):
        terrain_cli.check_formats()
