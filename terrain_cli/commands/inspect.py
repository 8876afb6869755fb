"""`terrain-est inspect INPUT…`."""

from typing import TYPE_CHECKING, Any

import click

from terrain_cli.commands import options
from terrain_cli.presentation.terminal import Progress, complain, in_lines, say

if TYPE_CHECKING:
    from formats import FormatError


@options.verb(
    "inspect",
    "terrain-est inspect run.bag",
    "terrain-est inspect day1/*.mcap --rover rover.toml --json",
    "terrain-est inspect --salvage downlink/*.db3",
)
@options.inputs
@options.rover
@options.wheel
@options.salvage
@options.largest
@options.as_json
@options.quiet
@options.verbose
def command(**given: Any) -> int:
    """Say what is inside each INPUT, and for each channel what would be used, in which unit.

    Where something is missing it gives the lines of rover.toml that would supply it. Rates, gaps
    and the samples that would be set aside are counted by reading the file. A file that cannot be
    opened is named with what is wrong with it; the others are shown. If a rover file does not fit a
    log, or columns contradict each other, the content comes first and then the problem.
    """
    import formats
    from formats.recovery import Notice
    from terrain_cli.presentation import inspection

    logs = formats.expand(given["inputs"])
    rovers = options.load_rover(given["rover"], logs)
    read = {name: given[name] for name in ("wheels", "salvage")}
    documents: list[dict[str, Any]] = []
    failed: list[FormatError] = []
    with Progress(len(logs), enabled=not given["quiet"]) as progress:
        for path in logs:
            progress.say(path, "")
            try:
                documents.append(inspection.inspect(path, rovers, **read))
            except formats.FormatError as error:
                if len(logs) == 1:
                    raise
                failed.append(error)
            progress.advance()
    problems: list[dict[str, Any]] = [
        {"source": one.path, "error": str(one), "hint": one.hint, "exit_code": one.exit_code}
        for one in failed
    ]
    problems += [{"source": one["source"], **one["problem"]} for one in documents if one["problem"]]
    if given["as_json"]:
        say({"format": inspection.FORMAT, "inputs": documents} | ({"failed": problems} if problems else {}))
    elif documents:
        # The lines for rover.toml are lines of a file.
        shown = [in_lines(one) | {"rover_toml": one["rover_toml"]} for one in documents]
        say("\n\n".join(inspection.text(one, verbose=given["verbose"]) for one in shown))
    # What is shown as text has them.
    for document in documents if given["as_json"] and not given["quiet"] else ():
        for remark in (remark for remark in document["remarks"] if isinstance(remark, Notice)):
            click.echo(f"{document['source']}: {remark}", err=True)
    for one in problems:
        where = "" if one["source"] in one["error"] else f"{one['source']}: "
        complain(where + one["error"], one["hint"])
    return problems[0]["exit_code"] if problems else 0
