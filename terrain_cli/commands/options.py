"""Options that several verbs share."""

from __future__ import annotations

import math
import os
import re
import sys
from functools import reduce
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from terrain_cli.commands import paths
from terrain_cli.errors import ConfigurationError, nearest
from terrain_cli.run.settings import Settings
from terrain_cli.vocabulary import choices

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from terrain_cli.rover import Rover

F = TypeVar("F", bound="Callable[..., Any]")

#: TERRAIN_EST_METHOD=ridge stands for --method ridge, in every verb that has the option.
CONTEXT = {"auto_envvar_prefix": "TERRAIN_EST"}

_MOST_FOLDS = 10**6

_QUIET = "Say nothing on stderr but errors."


class _Sane(click.ParamType):  # type: ignore[type-arg]
    """A finite number, not more than anybody has: for click even nan lies within any range."""

    most: float

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        if number > self.most:
            self.fail(f"{value} is more than {self.most:,.0f}.", param, ctx)
        return number


class Amount(_Sane, click.FloatRange):
    """How much of something: gigabytes, seconds, metres or kPa."""

    name = "number"
    most = 1e9  # Beyond any machine, any life and any ground


POSITIVE = Amount(0, min_open=True)


class Count(_Sane, click.IntRange):
    """How many of something."""

    name = "whole number"

    # More samples than any log has, and no more than a sum of it can count
    def __init__(self, least: int, most: int = 10**12) -> None:
        super().__init__(least)
        self.most = most


class Duration(click.ParamType):  # type: ignore[type-arg]
    """Seconds, or a time with its unit, such as 500ms or 10min."""

    name = "duration"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        from terrain_cli.vocabulary import units

        number, symbol = re.fullmatch(r"\s*(.*?)\s*([a-zA-Z]*)\s*", str(value)).groups()  # type: ignore[union-attr]
        unit = units.parse(symbol or "s", "time")
        if unit is None:
            self.fail(f"{value} is no time, such as 500ms, 1s or 10min.", param, ctx)
        return POSITIVE.convert(POSITIVE.convert(number, param, ctx) * unit.factor, param, ctx)


JOBS = click.IntRange(1, 10_000)


class Group(click.Group):
    """Verbs, of which the nearest is named where there is none of the name given."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find a verb, or name the nearest; a shell that asks what may follow is told nothing."""
        verbs = self.list_commands(ctx)
        if args and args[0] not in verbs and not args[0].startswith("-") and not ctx.resilient_parsing:
            ctx.fail(f"no such command: {args[0]}{nearest(args[0], verbs)}")
        return super().resolve_command(ctx, args)


def suggested(
    known: Callable[[click.Context], Iterable[str]],
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """Let a shell suggest names that can be told at once, without reading a log."""

    def complete(context: click.Context, _option: click.Parameter, begun: str) -> list[CompletionItem]:
        return [CompletionItem(name) for name in known(context) if name.startswith(begun)]

    return complete


def _wheels(context: click.Context) -> Iterable[str]:
    # An option without its value ends the reading of the line, and the inputs are then only words.
    inputs = context.params.get("inputs") or context.args
    try:
        return load_rover(context.params.get("rover"), inputs).wheels
    except ConfigurationError:
        # The command itself will say what is wrong with it.
        return ()


def _bound_copies(_context: click.Context, _option: click.Parameter, gigabytes: float | None) -> None:
    """Note in the environment what may be copied, where second processes find it too."""
    if gigabytes is not None:
        from formats.limits import COPY_VARIABLE

        os.environ[COPY_VARIABLE] = str(gigabytes)


def verb(
    name: str, *examples: str, cls: type[click.Command] = paths.Verb, short_help: str | None = None
) -> Callable[[Callable[..., Any]], click.Command]:
    """Return the decorator of a verb, whose help ends with examples, each what a person types.

    Every verb takes --quiet: a script that gives it to all of them need not know which have something to say.
    """
    make = click.command(
        name, cls=cls, context_settings=CONTEXT, short_help=short_help, epilog=_epilog(examples)
    )

    def decorated(function: Callable[..., Any]) -> click.Command:
        made = make(function)
        if all(option.name != "quiet" for option in made.params):
            made.params.append(click.Option(["-q", "--quiet"], is_flag=True, expose_value=False, help=_QUIET))
        return made

    return decorated


def group(name: str, *examples: str) -> Callable[[Callable[..., Any]], click.Group]:
    """Return the decorator of a verb that has verbs of its own, with examples as those of `verb`."""
    return click.group(name, cls=Group, context_settings=CONTEXT, epilog=_epilog(examples))


def _epilog(examples: Iterable[str]) -> str:
    return "\b\nExamples:\n" + "".join(f"  {example}\n" for example in examples)


def value(shown: str, kind: Any, told: str, **more: Any) -> Callable[[F], F]:
    """Return an option that takes a value, of a type of click or of `paths`; `told` is its help.

    It is `shown` as there: ``-o --output FILE``; a name that only the program uses stands before FILE.
    """
    *names, metavar = shown.split()
    return click.option(*names, type=kind, metavar=metavar, help=told, **more)


def together(*options: Callable[[F], F]) -> Callable[[F], F]:
    """Return the decorator that gives a command several options, in the order of its help."""
    return lambda command: reduce(lambda inner, option: option(inner), reversed(options), command)


inputs = click.argument("inputs", nargs=-1, required=True, type=paths.INPUT, metavar="INPUT…")
rover = value(
    "--rover FILE",
    paths.ROVER,
    "Rover file. Otherwise rover.toml beside the first input, or in the current folder.",
)
model = value(
    "--model FILE|linear|wong-reece",
    paths.MODEL,
    "Model of wheel and soil: a base, or a model file that adds effects to one.  [wong-reece]",
)
wheel = click.option(
    "--wheel",
    "wheels",
    multiple=True,
    envvar="TERRAIN_EST_WHEEL",
    metavar="NAME",
    shell_complete=suggested(_wheels),
    help="Only the wheel of exactly this name (repeatable).",
)
segments = click.option(
    "--segments",
    type=click.Choice(choices.SEGMENTS),
    default=choices.SEGMENTS[0],
    show_default=True,
    help="Cut segments where the soil changes, at a fixed length, by terrain label, or not at all.",
)
window_distance = value(
    "--window-distance M",
    POSITIVE,
    "Length of a segment in metres: exact for fixed, the least for auto.  "
    f"[auto: {choices.MIN_DISTANCE:.2f}]",
)
window_samples = value("--window-samples N", Count(3), "Length of a fixed segment in samples.")
where = click.option(
    "--where",
    metavar="CONDITION",
    help='Keep only the samples that satisfy it: "slip_angle_deg == 0 and load > 50".',
)
method = click.option(
    "--method",
    type=click.Choice(choices.METHODS),
    default=choices.METHODS[0],
    show_default=True,
    help="Estimator of c, φ and strength. auto: the full model, or what --model says; for long tables and "
    "the linear model least squares, and ridge where that is ill-conditioned. recursive: Kalman filter. "
    "wong-reece: the full model, however long the log.",
)
min_samples = value(
    "--min-samples N",
    Count(3),
    f"Fewest samples of a segment.  [{choices.CUT_SAMPLES} to cut, {choices.FIT_SAMPLES} to estimate]",
)
folds = value(
    "--folds N",
    Count(2, _MOST_FOLDS),
    "Choose the ridge's δ by cross-validation over N blocks.  [leave-one-out]",
)
at_stress = value(
    "--at-stress KPA",
    Amount(0.0),
    "Compare strengths at this normal stress, in kPa.  [typical of this wheel: 1, 2, 5, 10 …]",
)
robust = click.option(
    "--robust",
    is_flag=True,
    help="Give outliers less weight, where they are more than a tenth of the samples. Fewer are left out "
    "anyway.",
)
crs = click.option(
    "--crs",
    metavar="CODE",
    help="Reference system of longitude and latitude, such as IAU_2015:49900 (Mars) or IAU_2015:30100 "
    "(Moon). Positions in x and y stay a site frame.  [EPSG:4326]",
)
places = value(
    "--places FILE",
    paths.PLACES,
    "Localisation table (CSV, Parquet): gives samples longitude and latitude, or x and y, by its "
    "columns site, drive and pose, or by time.",
)
salvage = click.option(
    "--salvage",
    is_flag=True,
    help="Read what is left of files that are cut off, damaged or without index, and say how much that is.",
)
largest = value(
    "--largest GB",
    POSITIVE,
    "Largest input that is copied to the disk before it is read: a pipe, a packed recording, an object "
    "of a store.  [16]",
    expose_value=False,
    callback=_bound_copies,
)
as_json = click.option(
    "--json", "as_json", is_flag=True, envvar="TERRAIN_EST_JSON", help="Write JSON instead of tables."
)
force = click.option(
    "--force", is_flag=True, help="Replace existing files, even those that are not earlier results."
)
quiet = click.option("-q", "--quiet", is_flag=True, help=_QUIET)
verbose = click.option("-v", "--verbose", is_flag=True, help="Say on stderr where each channel comes from.")


def plot(told: str) -> Callable[[F], F]:
    """Return the option --plot, with what is drawn told in the help."""
    return value("--plot DIR", paths.PICTURES, told)


def jobs(told: str) -> Callable[[F], F]:
    """Return the option --jobs, with what it does told in the help."""
    return value("--jobs N", JOBS, told, default=1, show_default=True)


#: What decides on the numbers of an estimate.
estimation = together(
    *(rover, model, wheel, method, segments, min_samples, window_distance, window_samples),
    *(folds, robust, at_stress, where, crs, places, salvage, largest),
)


def settings(given: Mapping[str, Any]) -> Settings:
    """Return what `estimation` was given, checked as far as it can be before any input is read."""
    from terrain_cli.estimation import estimators
    from terrain_cli.presentation import segment_files
    from terrain_cli.windows import locations as tables

    segment_files.check(None, None, given["crs"])
    lengths = ("min_samples", "window_samples", "window_distance")
    others = ("method", "segments", "folds", "where", "model", "robust", "at_stress", "salvage")
    chosen = Settings(
        **{name: given[name] for name in (*lengths, *others)},
        wheels=tuple(given["wheels"]),
        places=tables.load(given["places"], given["crs"]) if given["places"] else None,
        samples=bool(given.get("samples")),
        joint=sys.maxsize if given.get("posterior") else choices.MOST_VALLEYS if given.get("plot") else 0,
        whole=any(given.get(name) for name in ("rejects", "trace", "samples", "posterior", "plot")),
    )
    # Whether the model can be read, and goes with the method.
    estimators.choose(chosen.method, chosen.model, robust=chosen.robust)
    return chosen


def load_rover(path: str | None, inputs: Sequence[str]) -> Rover:
    """Find the rover file of some inputs, the one that ``--rover`` names if it names one, and read it."""
    from terrain_cli import rover as rovers

    return rovers.load(rovers.find(path, inputs[0] if inputs else None))


def configured(context: click.Context, logs: Sequence[str], *, but: str = "") -> Rover:
    """Read the rover file, and let it give what neither the command line nor the environment gives.

    Its table [estimate] has long names of options; what the command lacks is left out, and so is `but`.
    """
    found, named = load_rover(context.params["rover"], logs), False
    parameters = {option.lstrip("-"): p for p in context.command.params for option in p.opts}
    default = click.core.ParameterSource.DEFAULT
    for name, value in found.estimate.items():
        parameter = parameters.get(name)
        if (
            parameter is None
            or name == but
            or context.get_parameter_source(parameter.name or "") is not default
        ):
            continue
        given = [value] if parameter.multiple and not isinstance(value, list) else value
        context.params[parameter.name] = parameter.type_cast_value(context, given)
        named = named or isinstance(parameter.type, paths.Named)
    if named:
        paths.check(context)
    paths.check_others(context)
    return found
