"""Where the output goes: a pipe that closes, a disk that is full."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from wheel_table import HEADER, ROVER, good, text, write

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Work in a folder that holds a rover file and nothing else."""
    (tmp_path / "rover.toml").write_text(ROVER)
    monkeypatch.chdir(tmp_path)
    # The quickest: what is written where is the same for all estimators.
    monkeypatch.setenv("TERRAIN_EST_METHOD", "least-squares")
    return tmp_path


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Return a table whose estimates are more than a pipe holds."""
    folder = tmp_path_factory.mktemp("many")
    (folder / "rover.toml").write_text(ROVER)
    rows = good()
    lines = [",".join(("run", *HEADER))]
    lines += [",".join((str(k), *row)) for k in range(400) for row in rows[:20]]
    (folder / "run.csv").write_text("\n".join(lines) + "\n")
    return folder / "run.csv"


@pytest.mark.parametrize(
    "args", [("estimate", "-q", "--segments", "none", "--method", "least-squares"), ("inspect", "--json")]
)
def test_a_closed_pipe_is_no_error(many, args):
    command = [sys.executable, "-m", "terrain_cli", *args, str(many)]
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=env) as process:
        assert process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


FULL = Path("/dev/full")


@pytest.mark.skipif(not FULL.exists(), reason="there is no /dev/full")
@pytest.mark.parametrize("verb", ["inspect", "estimate"])
def test_a_full_disk_under_the_standard_output(folder, terrain_est, verb):
    write("run.csv", text(good()))
    with FULL.open("w") as full:
        result = terrain_est(
            verb, "run.csv", cwd=folder, capture_output=False, stdout=full, stderr=subprocess.PIPE
        )
    assert result.returncode == 73
    (line,) = result.stderr.splitlines()
    assert line.casefold() in {
        "terrain-est: standard output: no space left on device",
        "terrain-est: standard output: no space left on the device",
    }


@pytest.fixture
def limit(monkeypatch):
    """Limit the size of files in this process to 4 KiB."""
    # Python would keep the part of a compiled module that it may write, and trip over it for ever.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    signal.signal(signal.SIGXFSZ, before)


@pytest.mark.parametrize(
    "output",
    [
        f"soil.{kind}"
        for kind in ("csv", "parquet", "json", "geojson", "geojsonl", "geojsons", "gpkg", "mcap")
    ],
)
def test_a_full_disk_under_a_file(folder, many, output, request, terrain_est_here):
    """A limit on the size of files fails a write in the middle, as a full disk does."""
    write(output, "as it was")
    request.getfixturevalue("limit")
    result = terrain_est_here("estimate", many, "--segments", "none", "-o", output, "--force")
    assert result.returncode == 73, result.stderr
    message, *hint = result.stderr.splitlines()
    assert message.startswith(f"terrain-est: {output}: ")
    assert hint in ([], ["  is there space left on the device?"])
    assert sorted(path.name for path in folder.iterdir()) == sorted(["rover.toml", output])
    assert Path(output).read_text() == "as it was"
