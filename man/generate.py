"""Write the man pages and the completion scripts afresh from the commands: python man/generate.py.

One page for `terrain-est` and one for each verb. Not click-man: it passes over the verbs of a lazy
group and all epilogs, where our examples are.
"""

from __future__ import annotations

import re
import sys
import textwrap
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import click  # noqa: E402 - in one block with the import that needs the path above

from terrain_cli.app import cli  # noqa: E402
from terrain_cli.version import __version__  # noqa: E402

NAME = "terrain-est"
#: The function that click defines in zsh.
ZSH = "_terrain_est_completion"
#: Special to roff, or turned by it into typographic signs that nobody can type.
ESCAPES = {"\\": r"\e", "-": r"\-", "'": r"\(aq", "`": r"\(ga", "^": r"\(ha", "~": r"\(ti"}
#: "0 done  1 unexpected  2 wrong use"
EXIT_CODE = re.compile(r"(\d+) (.+?)(?=\s{2,}\d|$)", re.MULTILINE)


def typed(words: str) -> str:
    """Write words in roff so that they are shown as they stand."""
    lines = (
        "".join(ESCAPES.get(c, c) if c.isascii() else rf"\[u{ord(c):04X}]" for c in line)
        for line in words.splitlines()
    )
    # A line that begins with a full stop would be a request.
    return "\n".join(rf"\&{line}" if line.startswith(".") else line for line in lines)


def prose(words: str) -> str:
    """Write sentences in roff, wrapped."""
    return typed(textwrap.fill(words, 78, break_long_words=False, break_on_hyphens=False))


def bold(words: str) -> str:
    """Write what is typed as it stands."""
    return rf"\fB{typed(words)}\fR"


def italic(words: str) -> str:
    """Write what stands for something else."""
    return rf"\fI{typed(words)}\fR"


def blocks(epilog: str | None) -> dict[str, str]:
    """Split an epilog into its unwrapped blocks: heading → lines."""
    parts = (part.strip("\n").partition("\n") for part in (epilog or "").split("\b\n"))
    return {heading.rstrip(":"): textwrap.dedent(body).rstrip() for heading, _, body in parts if body}


def short_help(command: click.Command) -> str:
    """Return the line that stands for a command."""
    return command.short_help or (command.help or "").partition("\n")[0]


def variable(option: click.Option, context: click.Context) -> str | None:
    """Return the environment variable that stands for an option."""
    if isinstance(option.envvar, str):
        return option.envvar
    if context.auto_envvar_prefix and option.allow_from_autoenv and not option.is_eager:
        return f"{context.auto_envvar_prefix}_{str(option.name).upper()}"
    return None


def _options(context: click.Context) -> list[str]:
    lines = []
    for option in context.command.get_params(context):
        record = option.get_help_record(context) if isinstance(option, click.Option) else None
        if record:
            names = (
                bold(word.rstrip(",")) + "," * word.endswith(",") if word.startswith("-") else italic(word)
                for word in record[0].split()
            )
            lines += [".TP", " ".join(names), prose(" ".join(record[1].split()))]
    return lines


def _environment(context: click.Context) -> list[str]:
    options = (option for option in context.command.params if isinstance(option, click.Option))
    names = [name for option in options if (name := variable(option, context))]
    if names:
        listed = [f".BR {typed(name)} ," for name in names[:-1]] + [f".BR {typed(names[-1])} :"]
        return [
            ".SH ENVIRONMENT",
            *listed,
            "each sets the option of that name. Precedence: command line, environment, rover.toml.",
        ]
    if context.parent is None:
        return [
            f".SH ENVIRONMENT\n.TP\n{bold('TERRAIN_EST_')}{italic('OPTION')}",
            "Sets a long option of a verb. Precedence: command line, environment, rover.toml.",
            f".TP\n{bold('TERRAIN_EST_TRACEBACK')}",
            "Set it to see where the program failed, instead of one line.",
        ]
    return []


def title(context: click.Context) -> str:
    """Return the name of a command's page."""
    return context.command_path.replace(" ", "-")


def page(context: click.Context, date: str) -> str:
    """Write the page of a command.

    Parameters
    ----------
    context : click.Context
        The command's own.
    date : str
        Of its last change, YYYY-MM-DD.

    Returns
    -------
    str
    """
    command, verbs = context.command, verbs_of(context)
    name, summary = title(context), short_help(command).rstrip(".")
    usage = [bold(context.command_path), *map(italic, command.collect_usage_pieces(context))]
    paragraphs = [prose(" ".join(part.split())) for part in (command.help or "").split("\n\n")]
    related = [title(verb) for verb in verbs.values()] or [title(context.find_root())]
    lines = [
        f'.TH {name.upper()} 1 {date} "{NAME} {__version__}" "{NAME} manual"',
        # Names that are typed are neither broken nor spread over the line.
        ".nh\n.ad l",
        f".SH NAME\n{typed(name)} \\- {prose(summary[0].lower() + summary[1:])}",
        f".SH SYNOPSIS\n{' '.join(usage)}",
        ".SH DESCRIPTION\n" + "\n.PP\n".join(paragraphs),
        *([".SH COMMANDS"] if verbs else []),
        *(f".TP\n.BR {typed(title(v))} (1)\n{prose(short_help(v.command))}" for v in verbs.values()),
        ".SH OPTIONS",
        *_options(context),
        *_environment(context),
        ".SH EXIT STATUS",
        *(
            f".TP\n{bold(code)}\n{prose(meaning)}"
            for code, meaning in EXIT_CODE.findall(blocks(cli.epilog)["Exit codes"])
        ),
        f".SH EXAMPLES\n.EX\n{typed(blocks(command.epilog)['Examples'])}\n.EE",
        ".SH SEE ALSO",
        " ,\n".join(f".BR {typed(other)} (1)" for other in related),
    ]
    return "\n".join(lines) + "\n"


def verbs_of(context: click.Context) -> dict[str, click.Context]:
    """Return the context of each verb of a group; none for a command that is no group."""
    group = context.command
    if not isinstance(group, click.Group):
        return {}
    verbs = {name: group.get_command(context, name) for name in group.list_commands(context)}
    return {
        name: click.Context(verb, info_name=name, parent=context, **verb.context_settings)
        for name, verb in verbs.items()
        if verb
    }


def contexts(top: click.Context | None = None) -> Iterator[click.Context]:
    """Yield the context of `terrain-est` and of every verb, however deep."""
    top = top or click.Context(cli, info_name=NAME, **cli.context_settings)
    yield top
    for verb in verbs_of(top).values():
        yield from contexts(verb)


def pages(date: str) -> dict[str, str]:
    """Write every page.

    Parameters
    ----------
    date : str
        YYYY-MM-DD.

    Returns
    -------
    dict of str to str
        File name → content.
    """
    return {f"{title(context)}.1": page(context, date) for context in contexts()}


def undated(content: str) -> str:
    """Return a page without the date of its last change."""
    return re.sub(r"(?m)^(\.TH \S+ 1) \S+", r"\1", content)


def scripts() -> dict[Path, str]:
    """Write what each shell loads, under the name by which it is found.

    It asks the installed command for the script, since what the two say to each other changes with the
    version of click.
    """
    folder = HERE.parent / "completions"
    return {
        folder / "bash" / NAME: f'eval "$({NAME} completion bash)"\n',
        folder / "zsh" / f"_{NAME}": f'#compdef {NAME}\neval "$({NAME} completion zsh)"\n{ZSH} "$@"\n',
        folder / "fish" / f"{NAME}.fish": f"{NAME} completion fish | source\n",
    }


def main() -> None:
    """Write the pages that have changed, and remove those of verbs that are no more."""
    new = pages(datetime.now(UTC).date().isoformat())
    for old in HERE.glob("*.1"):
        if old.name not in new:
            old.unlink()
    for name, content in new.items():
        path = HERE / name
        if not path.exists() or undated(path.read_text("utf-8")) != undated(content):
            path.write_text(content, encoding="utf-8")
            print(f"man/{name}")
    for path, content in scripts().items():
        path.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    main()
