"""The command `terrain-est`: its verbs, and the message and exit code of every error."""

import errno
import gc
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any, NoReturn

import click

from terrain_cli import ForeignFormatsError, check_formats, processes, version
from terrain_cli.commands.options import Group
from terrain_cli.presentation import terminal
from terrain_cli.version import __version__

#: Each verb with the line that stands for it in the help: a verb's module is imported only when it runs.
VERBS = {
    "inspect": "Say what a log holds, and what would be used of it.",
    "init": "Write a rover.toml from what a log holds.",
    "estimate": "Estimate cohesion and friction angle, segment by segment.",
    "batch": "Estimate many files into one folder, resumable.",
    "model": "Write, show and improve model files.",
    "effects": "Show the effects that a model can have, and check your own.",
    "compare": "Compare a model with measurements, and see where it fails.",
    "diagnose": "Name the physical effect that a model lacks.",
    "report": "Write one page on soil, model and misfit.",
    "simulate": "Simulate telemetry with a known truth.",
    "completion": "Print the completion script of a shell.",
}

_NEW_OBJECTS = 10_000  # New objects after which Python looks for garbage

EPILOG = """\b
Examples:
  terrain-est inspect run.bag
  terrain-est init run.bag -o rover.toml
  terrain-est estimate run.bag
  terrain-est estimate run.bag > soil.csv
  terrain-est estimate run.mcap -o soil.gpkg --crs IAU_2015:49900
  zcat run.csv.gz | terrain-est estimate - --rover rover.toml --summary soil.json
  terrain-est compare run.bag
  terrain-est diagnose run.bag
  terrain-est model new model.toml
  terrain-est model add model.toml slip-sinkage --data run.bag
  terrain-est estimate run.bag --model model.toml -o soil.gpkg

\b
Exit codes:
  0 done, also estimate --follow ended by a signal  1 unexpected  2 wrong use
  65 bad data  66 no such input
  73 cannot write  75 batch finished with failures
  78 bad rover, model or effect file
  129 ended by SIGHUP  130 by Ctrl-C  143 by SIGTERM (batch: 130)
"""


class ReaderGoneError(Exception):
    """Whoever read the standard output (| head) has what it wanted."""


class Verbs(Group):
    """Commands that are imported when they are called."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run a verb; click would end with 1 for a broken pipe, which is no failure."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError as error:
            raise ReaderGoneError from error

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        return list(VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        if cmd_name not in VERBS:
            return None
        module = importlib.import_module(f"terrain_cli.commands.{cmd_name.replace('-', '_')}")
        command: click.Command = module.command
        command.short_help = VERBS[cmd_name]
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        with formatter.section("Commands"):
            formatter.write_dl(list(VERBS.items()))


def _show_version(context: click.Context, _option: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        click.echo(f"terrain-est, version {__version__}\n{version.details()}")
        context.exit()


@click.group(
    cls=Verbs,
    epilog=EPILOG,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
    },
)
@click.option(
    *("-V", "--version"),
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_version,
    help="Show the version, Python and where the program is installed, and exit.",
)
def cli() -> None:
    """Estimate the soil under a wheel from rover telemetry.

    Reads load, torque, sinkage and slip from CSV, Parquet and ROS 1 and ROS 2 bags, cuts them into
    segments of homogeneous terrain, and gives cohesion c and internal friction angle φ of each with
    their uncertainty.

    Where the wheel–soil model does not fit, compare shows where it fails, diagnose names the physical
    effect that is missing, and model add adds it and shows by how much the error falls.
    """


def fail(message: str, hint: str, code: int) -> NoReturn:
    terminal.complain(message, hint)
    sys.exit(code)


def main(args: Sequence[str] | None = None) -> NoReturn:
    """Run the command line, ``sys.argv[1:]`` if none is given, and end the process."""
    processes.one_thread_of_algebra()
    # Modules are many and garbage is little: to look for it as often as Python does took 4 % of a trial.
    gc.set_threshold(_NEW_OBJECTS)
    with terminal.prepared():
        _run(args)


def _run(args: Sequence[str] | None) -> NoReturn:
    try:
        check_formats()
        with processes.heeded():
            code: Any = cli.main(args=args, prog_name="terrain-est", standalone_mode=False)
            sys.stdout.flush()
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        fail("interrupted; nothing was written", "", 130)
    except processes.EndedError as end:
        fail(f"ended by {end.name}; nothing is left half-written", "", end.code)
    except (ReaderGoneError, BrokenPipeError):
        sys.exit(0)
    except Exception as error:  # noqa: BLE001 - the last place where an error can become one clear line
        _fail_with(error)
    sys.exit(code if isinstance(code, int) else 0)


def _fail_with(error: Exception) -> NoReturn:
    if isinstance(error, ForeignFormatsError):
        fail(str(error), "rename it, or work in another folder", 2)
    from formats.errors import FormatError
    from terrain_cli.errors import TerrainError

    if isinstance(error, TerrainError | FormatError):
        fail(str(error), error.hint, error.exit_code)
    if os.environ.get("TERRAIN_EST_TRACEBACK"):
        raise error
    if isinstance(error, MemoryError):
        fail("out of memory", "cut the input into smaller files", 1)
    if isinstance(error, OSError) and error.filename is None:
        # Only the standard output has no name of its own.
        closed = error.errno == errno.EBADF
        fail(f"standard output: {'is closed' if closed else error.strerror or error}", "", 73)
    fail(
        f"unexpected {type(error).__name__}: {error}",
        "this is a fault of the program: please report it; TERRAIN_EST_TRACEBACK=1 shows where",
        1,
    )
