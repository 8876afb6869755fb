"""Options that several verbs share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeVar

import click

from terrain_cli.settings import MIN_DISTANCE, SEGMENTS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from terrain_cli.rover import Rover

F = TypeVar("F", bound="Callable[..., Any]")

#: TERRAIN_EST_METHOD=ridge stands for --method ridge, in every verb that has the option.
CONTEXT = {"auto_envvar_prefix": "TERRAIN_EST"}

#: Lets shells complete names of files; what is wrong with one is told by whoever opens it.
FILE = click.Path(readable=False, allow_dash=True)

inputs = click.argument("inputs", nargs=-1, required=True, type=FILE, metavar="INPUT…")
rover = click.option(
    "--rover",
    type=FILE,
    metavar="FILE",
    help="Rover file. Otherwise rover.toml beside the first input, or in the current folder.",
)
model = click.option(
    "--model",
    type=FILE,
    metavar="FILE|linear|wong-reece",
    help="Model of wheel and soil: a base, or a model file that adds effects to one.  [linear]",
)
wheel = click.option(
    "--wheel",
    "wheels",
    multiple=True,
    envvar="TERRAIN_EST_WHEEL",
    metavar="NAME",
    help="Only this wheel (repeatable).",
)
segments = click.option(
    "--segments",
    type=click.Choice(SEGMENTS),
    default=SEGMENTS[0],
    show_default=True,
    help="Windows: where the soil's line changes, of a fixed length, by terrain label, or none.",
)
window_distance = click.option(
    "--window-distance",
    type=click.FloatRange(min=0, min_open=True),
    metavar="M",
    help=f"Length of a window in metres: exact for fixed, the least for auto.  [auto: {MIN_DISTANCE:.2f}]",
)
window_samples = click.option(
    "--window-samples", type=click.IntRange(min=3), metavar="N", help="Length of a fixed window in samples."
)
where = click.option(
    "--where",
    metavar="CONDITION",
    help='Keep only the samples that satisfy it: "slip_angle_deg == 0 and load > 50".',
)
as_json = click.option(
    "--json", "as_json", is_flag=True, envvar="TERRAIN_EST_JSON", help="Write JSON instead of tables."
)
quiet = click.option("-q", "--quiet", is_flag=True, help="Say nothing on stderr but errors.")
verbose = click.option("-v", "--verbose", is_flag=True, help="Say on stderr where each channel comes from.")


def load_rover(path: str | None, inputs: Sequence[str]) -> Rover:
    """Find and read the rover file of some inputs.

    Parameters
    ----------
    path : str or None
        What ``--rover`` names.
    inputs : sequence of str

    Returns
    -------
    Rover
    """
    from terrain_cli import rover as rovers

    return rovers.load(rovers.find(path, inputs[0] if inputs else None))


def with_defaults(context: click.Context, settings: Mapping[str, Any]) -> None:
    """Let rover.toml give what neither the command line nor the environment gives.

    Parameters
    ----------
    context : click.Context
    settings : mapping of str to value
        Long options without dashes, from the table of the verb in rover.toml.

    Raises
    ------
    click.BadParameter
        A value that the option does not take.
    """
    parameters = {option.lstrip("-"): p for p in context.command.params for option in p.opts}
    for name, value in settings.items():
        parameter = parameters[name]
        if (
            parameter.name is None
            or context.get_parameter_source(parameter.name) is not click.core.ParameterSource.DEFAULT
        ):
            continue
        given = [value] if parameter.multiple and not isinstance(value, list) else value
        context.params[parameter.name] = parameter.type_cast_value(context, given)
