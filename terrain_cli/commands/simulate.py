"""`terrain-est simulate [DRIVE.toml]`."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from terrain_cli.commands import options, paths
from terrain_cli.errors import ConfigurationError, UsageError

_EFFECT = re.compile(r"(?P<name>.+?)(?::(?P<values>[^:/\\]*=[^:/\\]*))?")
_VALUE = re.compile(r"\s*([A-Za-z_]\w*)\s*=\s*(\S+)\s*")


@options.verb(
    "simulate",
    "terrain-est simulate -o run.csv",
    "terrain-est simulate -o run.bag --drive slip-sweep --drive load-steps --noise 3% --truth truth.json",
    "terrain-est simulate -o run.mcap --soil dry-sand --soil clayey-soil --wheels 4 --seed 7",
    "terrain-est simulate -o run.parquet --effect slip-sinkage:n1=0.5 --noise torque=0.02 "
    "--noise sinkage=1mm",
    "terrain-est simulate -o riddle.csv --drive mixed --noise 3% --hide",
    "terrain-est simulate drive.toml -o run.csv --truth truth.csv",
    "terrain-est simulate -q --drive passes --rate 1 | head",
)
@click.argument("drive_file", required=False, type=paths.DRIVE, metavar="[DRIVE.toml]")
@options.value(
    "-o --output FILE",
    paths.RESULT,
    "Write the log here, by its ending: .csv (.gz .bz2 .zst) .parquet .bag .mcap .db3. Otherwise CSV on "
    "stdout.",
    default="-",
)
@click.option(
    "--drive",
    multiple=True,
    metavar="NAME",
    shell_complete=options.suggested(paths.names_in("simulation.drive_file", "PRESETS")),
    help="How to drive (repeatable, one after another): slip-sweep, load-steps, slope, mixed, passes, "
    "reverse, speed-steps, turns, multi.  [mixed]",
)
@click.option(
    "--soil",
    multiple=True,
    metavar="NAME",
    shell_complete=options.suggested(paths.names_in("simulation.scenario", "SOILS")),
    help="Soil (repeatable, one after another over equal distances): dry-sand, sandy-loam, clayey-soil, "
    "snow … or [soils.NAME] of the file.  [dry-sand]",
)
@options.value("--duration S", float, "Length of the whole drive, in s.  [60 for each --drive]")
@click.option(
    "--rate", multiple=True, metavar="HZ", help="Samples in a second; also CHANNEL=HZ (repeatable).  [20]"
)
@options.value("--wheels N", int, "Number of wheels.  [1; 4 for --drive multi]")
@options.value("--load N", float, "Mean load of each wheel, in N.  [80, less on weak soil]")
@options.value("--speed V", float, "Mean speed, in m/s.  [0.1]")
@click.option(
    "--noise",
    multiple=True,
    metavar="NOISE",
    help="White noise (repeatable): 3% of load, torque, sinkage, pull and slip; or CHANNEL=3%, torque=0.02, "
    "sinkage=1mm, torque=3%,outliers=1%.  [none]",
)
@options.value(
    "--model MODEL",
    paths.MODEL,
    "Model that makes the truth: wong-reece, linear, or a model file with its effects.  [wong-reece]",
)
@options.value(
    "--effect EFFECT",
    paths.EFFECT,
    "Add an effect (repeatable): ID, ID:NAME=VALUE,… or FILE.toml. A parameter that is not "
    "given has its typical size.",
    multiple=True,
)
@click.option(
    "--hide",
    is_flag=True,
    help="Add an effect of the catalogue, drawn at random with its size; only the truth names it.",
)
@options.value(
    "--truth FILE",
    paths.OUTPUT,
    "Write the truth here: .json, or a table as .csv.  [none; with --hide OUTPUT.sealed.json]",
)
@click.option(
    "--rover",
    type=paths.OUTPUT,
    # The environment names the rover file to read.
    allow_from_autoenv=False,
    metavar="FILE",
    help="Write the rover file that fits here.  [rover.toml beside the output, if there is none]",
)
@click.option(
    "--drawbar-pull/--no-drawbar-pull", default=None, help="Measure the drawbar pull, or not.  [measured]"
)
@options.value(
    "--seed N", int, "The same seed gives the same file, byte for byte.  [0; with --hide a new one]"
)
@click.option("--force", is_flag=True, help="Replace the files of -o, --truth and --rover if they are there.")
@options.quiet
@click.pass_context
def command(context: click.Context, /, **_: Any) -> None:
    """Make telemetry of a drive whose soils, effects and noise are known.

    Describe the drive on the command line or in DRIVE.toml; options take precedence. The
    truth goes to a file of its own, and never into the log. A rover file that fits is written
    beside it, so that `terrain-est estimate` works at once. Existing files are replaced only with
    --force, except such a rover file that nobody has changed.
    """
    from terrain_cli import simulation
    from terrain_cli.simulation import simulation_files

    given = context.params
    kind = simulation_files.kind_of(given["output"])
    _name_outputs(context)
    truth, rover = given["truth"], given["rover"]
    bag = kind in simulation_files.BAGS
    log = simulation.drive(given["drive_file"], _settings(given), hide=given["hide"], bag=bag)
    simulation_files.write(log, given["output"], truth=truth, rover=rover)
    if given["quiet"]:
        return
    where = "standard output" if given["output"] == "-" else given["output"]
    click.echo(f"{where}: {log.scenario.summary}", err=True)
    if rover:
        click.echo(f"{rover}: the rover file that fits", err=True)
    elif given["output"] != "-":
        beside = _beside(given["output"])
        click.echo(f"{beside} is yours and was left as it is: --rover FILE writes one that fits", err=True)
    if truth:
        hidden = ", the hidden effect included: whoever opens it can read it" if given["hide"] else ""
        click.echo(f"{truth}: the truth{hidden}", err=True)


def _name_outputs(context: click.Context) -> None:
    """Name what goes beside the log, and make sure that no file is lost where all of it goes."""
    import formats

    given = context.params
    if given["hide"] and not given["truth"]:
        if given["output"] == "-":
            raise UsageError("--hide needs a file for the truth", hint="add --truth FILE.json, or -o FILE")
        given["truth"] = f"{given['output'].rstrip('/')}.sealed.json"
    if given["truth"] == "-":
        raise UsageError("--truth needs a file, not standard output", hint="give --truth FILE.json")
    named = [given[name] for name in ("output", "truth", "rover") if given[name]]
    given["rover"] = given["rover"] or _rover_beside(given["output"])
    paths.check(context)
    for name in named:
        formats.check_free(name, replace=given["force"])


def _settings(given: dict[str, Any]) -> dict[str, Any]:
    """Return what the command line says, in the words of the file."""
    settings = {
        name: given[name]
        for name in ("duration", "wheels", "load", "speed", "model", "drawbar_pull", "seed")
        if given[name] is not None
    }
    settings |= {name: list(given[name]) for name in ("drive", "soil") if given[name]}
    for text in given["rate"]:
        key, sign, rate = text.partition("=")
        if sign:
            settings.setdefault("rates", {})[key.strip()] = _number(rate)
        else:
            settings["rate"] = _number(text)
    if given["noise"]:
        settings["noise"] = _noise(given["noise"])
    if given["effect"]:
        settings["effects"] = dict(map(_effect, given["effect"]))
    return settings


def _number(text: str) -> float | str:
    """Return a number, or the text for whoever can say what is wrong with it."""
    try:
        return float(text)
    except ValueError:
        return text.strip()


def _noise(texts: Sequence[str]) -> dict[str, Any]:
    from terrain_cli.simulation.sensors import USUAL, Sensor, share_rule

    noise: dict[str, Any] = {}
    for text in texts:
        channels: Sequence[str] = USUAL
        sensor: dict[str, Any] = {}
        for place, part in enumerate(text.split(",")):
            key, sign, value = part.partition("=")
            key = key.strip()
            if not sign:
                # Of several channels with units of their own, a bare number can only be a share.
                try:
                    share = share_rule(part, "--noise")
                except ConfigurationError as error:
                    raise UsageError(str(error), hint=error.hint) from None
                sensor["white"] = f"{100.0 * share!r}%"
            elif place == 0 and key not in Sensor.__slots__:
                channels, sensor["white"] = (key,), _number(value)
            else:
                sensor[key] = _number(value)
        noise |= {channel: {**noise.get(channel, {}), **sensor} for channel in channels}
    return noise


def _effect(text: str) -> tuple[str, dict[str, float]]:
    match = _EFFECT.fullmatch(text)
    values = {}
    for part in match["values"].split(",") if match and match["values"] else ():
        value = _VALUE.fullmatch(part)
        number = _number(value[2]) if value else ""
        if value is None or not isinstance(number, float):
            raise UsageError(f"--effect {text}: {part!r} is no value", hint="write --effect ID:NAME=NUMBER,…")
        values[value[1]] = number
    return (match["name"] if match else text), values


def _rover_beside(output: str) -> str | None:
    """Return the rover file beside the log; none if a user's own is there."""
    from terrain_cli.simulation import simulation_files

    if output == "-" or simulation_files.rover_is_in_the_way(_beside(output)):
        return None
    return str(_beside(output))


def _beside(output: str) -> Path:
    from terrain_cli.rover.vehicle import FILE_NAME

    return Path(output.rstrip("/")).parent / FILE_NAME
