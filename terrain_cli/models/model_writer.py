"""Writes model files: new ones with comments, old ones with what their user wrote around the values."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import formats
from terrain_cli.models.model_file import FORMAT, SOIL_UNITS, ModelFile, flat
from terrain_cli.vocabulary import toml_files

if TYPE_CHECKING:
    from pathlib import Path

    from tomlkit import TOMLDocument
    from tomlkit.container import Container
    from tomlkit.items import Item

_TOP = ("format", "base", "effects", "shared")
_TABLES = ("fixed", "priors")


def save(file: ModelFile, path: str | Path) -> None:
    """Write a model file whole, or leave the old one as it was.

    Where it was read from a file, only what has changed since is written anew: comments and order
    stay.
    """
    content = edited(file) if file.text else new(file)
    with formats.replacing(str(path)) as temporary, open(temporary, "w", encoding="utf-8") as target:  # noqa: PTH123
        target.write(content)


def new(file: ModelFile) -> str:
    """Write the text of a new model file."""
    soil = ", ".join(f"{name} ({SOIL_UNITS[name]})" for name in file.model.soil)
    lines = [
        "# A model of wheel and soil for terrain-est.",
        f"format = {toml_files.value(FORMAT)}",
        f'base = {toml_files.value(file.model.base)}   # "wong-reece" or "linear"',
        "# Ids of the catalogue (terrain-est effects list), or paths of effect files, beside this file.",
        f"effects = {toml_files.value(file.effects)}",
    ]
    if file.shared:
        lines += ["# One value for all windows of a wheel.", f"shared = {toml_files.value(file.shared)}"]
    lines += [
        "",
        "# Parameters held at a value; the others are estimated, those of the soil window by window.",
        f"# Of the soil: {soil}.",
        "# Of the effects: by the names and in the units that terrain-est model show lists.",
        "[fixed]",
        *_pairs(_tables(file)["fixed"], ()),
    ]
    if file.priors:
        lines += ["", "# What is known beforehand: mean and standard deviation.", "[priors]"]
        lines += _pairs(_tables(file)["priors"], ())
    for entry in file.history:
        lines += _entry(entry)
    return "\n".join(lines) + "\n"


def edited(file: ModelFile) -> str:
    """Bring the text that a model file was read from up to date; all anew if its layout allows no change."""
    whole = new(file)
    try:
        text = _changed(file)
        return text if _content(tomllib.loads(text)) == _content(tomllib.loads(whole)) else whole
    except (ValueError, LookupError, TypeError, RecursionError):
        # What of a strange layout tomlkit cannot do, or does wrongly.
        return whole


def _changed(file: ModelFile) -> str:
    import tomlkit

    before = tomllib.loads(file.text)
    document = tomlkit.parse(file.text)
    for name, value in {"base": file.model.base, "effects": file.effects, "shared": file.shared}.items():
        if _plain(before.get(name, [])) == _plain(value):
            continue
        if name in document:
            document[name] = _item(value)
        else:
            _put_behind(_last(document), _pairs({name: value}, ()))
    for name, entries in _tables(file).items():
        _set_table(document, name, entries)
    lines = [line for entry in file.history[len(before.get("history", ())) :] for line in _entry(entry)]
    text = document.as_string()
    return "\n".join([text.rstrip(), *lines, ""]) if lines else text


def _set_table(document: TOMLDocument, name: str, entries: Mapping[str, Any]) -> None:
    """Change, drop and add the entries of a table of parameters."""
    from tomlkit.items import Table

    missing = dict(entries)
    table: Any = document.get(name)
    for own, value, _ in list(flat({} if table is None else table.unwrap(), name)):
        outer, _, inner = own.partition(".")
        place, key = (table, own) if own in table else (table[outer], inner)
        if own not in missing:
            del place[key]
        elif missing.pop(own) != value:
            place[key] = _item(entries[own])
    lines = _pairs(missing, ())
    if not lines:
        return
    if table is None:
        _put_behind(_last(document, deep=True), ["", f"[{name}]", *lines])
    elif isinstance(table, Table) and not table.is_super_table():
        _put_behind(_last(table.value) or table, lines)
    else:
        for own, value in missing.items():
            table[own] = _item(value)


def _item(value: Any) -> Item:
    """Return a value as it stands in a new file."""
    import tomlkit

    return tomlkit.value(toml_files.value(value))


def _last(container: Container, *, deep: bool = False) -> Item | None:
    """Return the last value of a container, also of the tables in it if deep, but not of the history."""
    from tomlkit.items import AoT, Table

    found = None
    for key, item in container.body:
        if isinstance(item, Table) and (deep or (key and key.is_dotted())):
            found = _last(item.value, deep=deep) or item
        elif key and not isinstance(item, AoT | Table):
            found = item
    return found


def _put_behind(item: Item | None, lines: list[str]) -> None:
    """Put lines behind a value: tomlkit itself would, behind the comment above the next table."""
    if item is not None:
        item.trivia.trail = "\n".join([item.trivia.trail.rstrip("\n"), *lines, ""])


def _tables(file: ModelFile) -> dict[str, dict[str, Any]]:
    """Return the tables of parameters, in the units of the file."""
    fixed = {name: value / file.factor(name) for name, value in file.fixed.items()}
    priors = {
        name: {"mean": prior.mean / file.factor(name), "sd": prior.sd / file.factor(name)}
        for name, prior in file.priors.items()
    }
    return {"fixed": fixed, "priors": priors}


def _pairs(entries: Mapping[str, Any], before: tuple[str, ...]) -> list[str]:
    start = "".join(f"{toml_files.key(name)}." for name in before)
    return [
        f"{start}{toml_files.key(name)} = {toml_files.value(value)}"
        for name, value in entries.items()
        if value is not None
    ]


def _entry(entry: Mapping[str, Any]) -> list[str]:
    """Write an entry of the history; of tables in it each row on a line of its own."""
    lines = ["", "[[history]]"]
    for name, value in entry.items():
        nested = isinstance(value, Mapping) and all(isinstance(inner, Mapping) for inner in value.values())
        lines += _pairs(value, (name,)) if nested and value else _pairs({name: value}, ())
    return lines


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _content(document: dict[str, Any]) -> dict[str, Any]:
    """Return what a document says, however it is laid out."""
    top = {name: document.get(name, []) for name in _TOP}
    tables = {t: {name: value for name, value, _ in flat(document.get(t, {}), t)} for t in _TABLES}
    return {**top, **tables, "history": document.get("history", [])}
