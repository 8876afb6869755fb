"""What all tests share: the command as users run it, and the rule for tests of real programs."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack, chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

import profiles
import pytest
from child_processes import TERRAIN_EST

from terrain_cli.app import main

if TYPE_CHECKING:
    from collections.abc import Generator

# Before numpy is imported: threads of BLAS that wait for each other take the cores from the other
# workers of pytest-xdist, and their number must not decide on the last digit of a sum.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

# A process that finds nothing compiled, and may not keep it, compiles the whole program once more.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

ROOT = Path(__file__).resolve().parent.parent
SAMPLE_ROVER = ["--rover", str(ROOT / "sample_data" / "rover.toml")]

# A shell that starts this in the background lets it ignore Ctrl-C, and so all that it starts.
signal.signal(signal.SIGINT, signal.default_int_handler)

profiles.settings.load_profile("default")


#: Each has one test, or a fixture, of many seconds: at their end no worker waits for it alone.
FIRST = ("test_tutorial.py", "test_blind_study.py", "test_paper.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest."""
    items.sort(key=lambda item: item.path.name not in FIRST)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test marked ``real("program", …)`` where one of the programs is not installed."""
    for mark in item.iter_markers("real"):
        for program in mark.args:
            if shutil.which(program) is None:
                pytest.skip(f"{program} is not installed")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item,
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where CI is set, turn the skip of a test of a real program into a failure: it proves nothing."""
    report = yield
    skipped = report.skipped and not hasattr(report, "wasxfail")
    if skipped and os.environ.get("CI") and item.get_closest_marker("real"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else report.longrepr
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} needs a real program and was skipped: {reason}"
    return report


@pytest.fixture(scope="session")
def bin_folder(tmp_path_factory):
    """Return a folder with the command `terrain-est`, for shells to find: this source, this Python."""
    folder = tmp_path_factory.mktemp("bin")
    command = folder / "terrain-est"
    path, python = shlex.quote(str(ROOT)), shlex.quote(sys.executable)
    command.write_text(f'#!/bin/sh\nPYTHONPATH={path} exec {python} -m terrain_cli "$@"\n')
    command.chmod(0o755)
    return folder


@pytest.fixture
def terrain_est(bin_folder):
    """Return a function that runs the command in a process of its own."""

    def run(*args, env=None, **options):
        options = {"capture_output": True, "text": True, **options}
        command = [bin_folder / "terrain-est", *map(str, args)]
        return subprocess.run(command, env={**os.environ, **(env or {})}, check=False, **options)

    return run


@pytest.fixture(scope="session")
def terrain_est_here():
    """Return a function that runs the command in this process, and returns what another one would."""

    def run(*args, cwd=None, env=None):
        with ExitStack() as stack:
            out, err = (stack.enter_context(TemporaryFile("w+", encoding="utf-8")) for _ in range(2))
            stack.enter_context(redirect_stdout(out))
            stack.enter_context(redirect_stderr(err))
            stack.enter_context(chdir(cwd or Path.cwd()))
            patch = stack.enter_context(pytest.MonkeyPatch.context())
            for name, value in (env or {}).items():
                patch.setenv(name, value)
            with pytest.raises(SystemExit) as end:
                main([str(arg) for arg in args])
            texts = []
            for stream in (out, err):
                stream.seek(0)
                texts.append(stream.read())
        return subprocess.CompletedProcess(args, end.value.code or 0, *texts)

    return run


@pytest.fixture(scope="session")
def logs(tmp_path_factory):
    """Return a folder of logs of which it is known what a model lacks, to be copied."""
    from changed_models import write_all

    path = tmp_path_factory.mktemp("logs")
    write_all(path)
    return path


class FollowingProcess(subprocess.Popen):
    """A process whose output is read line by line while it goes on."""

    def line(self):
        """Return the next line; what comes behind it stays for `communicate`."""
        text = b""
        while not text.endswith(b"\n") and (byte := os.read(self.stdout.fileno(), 1)):
            text += byte
        return text.decode()


@pytest.fixture
def start(tmp_path):
    """Return a function that starts to follow something in a process of its own, with the sample rover."""
    begun = []

    def run(*args, **options):
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1"}
        begun.append(
            FollowingProcess(
                [*TERRAIN_EST, "estimate", "--follow", *map(str, args), *SAMPLE_ROVER],
                **{"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "stdin": subprocess.PIPE} | options,
                env=environment,
                text=True,
                cwd=tmp_path,
            )
        )
        return begun[-1]

    yield run
    for process in begun:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            stream.close()
