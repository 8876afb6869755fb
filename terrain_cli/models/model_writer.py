"""Writes model files: new ones with comments, old ones with what their user wrote around the values."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import formats
from terrain_cli.models.model_file import FORMAT, SOIL_UNITS, ModelFile
from terrain_cli.models.model_reader import flat
from terrain_cli.toml import toml_text

if TYPE_CHECKING:
    from pathlib import Path

_TOP = ("format", "base", "effects", "shared")
_TABLES = ("fixed", "priors")


def save(file: ModelFile, path: str | Path) -> None:
    """Write a model file whole, or leave the old one as it was.

    Where it was read from a file, only what has changed since is written anew: comments and order
    stay.

    Raises
    ------
    formats.errors.CannotWriteError
    """
    content = edited(file) if file.text else new(file)
    with formats.replacing(str(path)) as temporary, open(temporary, "w", encoding="utf-8") as target:  # noqa: PTH123
        target.write(content)


def new(file: ModelFile) -> str:
    """Write the text of a new model file."""
    soil = ", ".join(f"{name} ({SOIL_UNITS[name]})" for name in file.model.soil)
    lines = [
        "# A model of wheel and soil for terrain-est.",
        f"format = {toml_text.value(FORMAT)}",
        f'base = {toml_text.value(file.model.base)}   # "wong-reece" or "linear"',
        "# Ids of the catalogue (terrain-est effects list), or paths of effect files, beside this file.",
        f"effects = {toml_text.value(file.effects)}",
    ]
    if file.shared:
        lines += ["# One value for all windows of a wheel.", f"shared = {toml_text.value(file.shared)}"]
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
    """Bring the text that a model file was read from up to date.

    Returns
    -------
    str
        The same text but for what has changed; all anew if its layout allows no change.
    """
    before = tomllib.loads(file.text)
    pieces = _Pieces(file.text)
    for name, value in {"base": file.model.base, "effects": file.effects, "shared": file.shared}.items():
        if _plain(before.get(name, [])) != _plain(value):
            pieces.set_top(name, value)
    for table, entries in _tables(file).items():
        pieces.set_table(table, entries)
    for entry in file.history[len(before.get("history", ())) :]:
        pieces.append(_entry(entry)[pieces.text.endswith("\n\n") :])
    try:
        right = _content(tomllib.loads(pieces.text)) == _content(tomllib.loads(new(file)))
    except tomllib.TOMLDecodeError:
        right = False
    return pieces.text if right else new(file)


def _tables(file: ModelFile) -> dict[str, dict[str, Any]]:
    """Return the tables of parameters, in the units of the file."""
    fixed = {name: value / file.factor(name) for name, value in file.fixed.items()}
    priors = {
        name: {"mean": prior.mean / file.factor(name), "sd": prior.sd / file.factor(name)}
        for name, prior in file.priors.items()
    }
    return {"fixed": fixed, "priors": priors}


def _pairs(entries: Mapping[str, Any], before: tuple[str, ...]) -> list[str]:
    start = "".join(f"{toml_text.key(name)}." for name in before)
    return [
        f"{start}{toml_text.key(name)} = {toml_text.value(value)}"
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


class _Pieces:
    """A text in pieces that are TOML on their own: a header, a key with its value, or a comment."""

    def __init__(self, text: str) -> None:
        self.pieces: list[str] = []
        #: Table in which each piece stands; None from the first [[history]] on.
        self.places: list[tuple[str, ...] | None] = []
        place: tuple[str, ...] | None = ()
        piece = ""
        for line in text.splitlines(keepends=True):
            piece += line
            try:
                content = tomllib.loads(piece)
            except tomllib.TOMLDecodeError:
                # A value of several lines goes on.
                continue
            if piece.lstrip().startswith("["):
                place = _header(content)
            self.pieces.append(piece)
            self.places.append(place)
            piece = ""

    @property
    def text(self) -> str:
        """The pieces together."""
        return "".join(self.pieces)

    def insert(self, index: int, lines: list[str], place: tuple[str, ...] | None) -> None:
        """Put lines before a piece."""
        if index and not self.pieces[index - 1].endswith("\n"):
            self.pieces[index - 1] += "\n"
        self.pieces[index:index] = [f"{line}\n" for line in lines]
        self.places[index:index] = [place] * len(lines)

    def append(self, lines: list[str]) -> None:
        """Put lines at the end."""
        self.insert(len(self.pieces), lines, None)

    def end(self, place: tuple[str, ...]) -> int | None:
        """Return the index behind the last header or key of a table."""
        inside = [k for k, p in enumerate(self.places) if p == place and not self.is_comment(k)]
        return inside[-1] + 1 if inside else None

    def is_comment(self, index: int) -> bool:
        """Whether a piece is a comment or empty."""
        return self.pieces[index].lstrip()[:1] in {"", "#"}

    def set_top(self, name: str, value: Any) -> None:
        """Change a key above all tables, or add it."""
        line = f"{name} = {toml_text.value(value)}"
        for index, (piece, place) in enumerate(zip(self.pieces, self.places, strict=True)):
            if place == () and name in tomllib.loads(piece):
                self.pieces[index] = line + _comment(piece) + "\n"
                return
        self.insert(self.end(()) or 0, [line], ())

    def set_table(self, table: str, entries: Mapping[str, Any]) -> None:
        """Change, drop and add the entries of a table of parameters."""
        missing = dict(entries)
        for index, place in enumerate(self.places):
            if place is None or (place and place[0] != table) or self.is_comment(index):
                continue
            if self.pieces[index].lstrip().startswith("["):
                continue
            content: Any = tomllib.loads(self.pieces[index])
            if not place:
                content = content.get(table, {})
            elif len(place) > 1:
                content = {".".join(place[1:]): content}
            old = {name: value for name, value, _ in flat(content, table)}
            kept = {name: missing.pop(name) for name in old if name in missing}
            if kept != old:
                inside = ".".join(place[1:])
                own = {name[len(inside) + 1 if inside else 0 :]: value for name, value in kept.items()}
                lines = _pairs(own, () if place else (table,))
                rest = _comment(self.pieces[index]) if len(lines) == 1 else ""
                self.pieces[index] = "".join(f"{line}{rest}\n" for line in lines)
        if missing:
            end = self.end((table,))
            if end is not None:
                self.insert(end, _pairs(missing, ()), (table,))
                return
            first = next((k for k, place in enumerate(self.places) if place is None), len(self.pieces))
            self.insert(first, ["", f"[{table}]", *_pairs(missing, ()), ""], (table,))


def _header(content: dict[str, Any]) -> tuple[str, ...] | None:
    place: list[str] = []
    inner: Any = content
    while isinstance(inner, dict) and inner:
        name, inner = next(iter(inner.items()))
        place.append(name)
    return None if isinstance(inner, list) or place[:1] == ["history"] else tuple(place)


def _comment(piece: str) -> str:
    """Return the comment behind the value of a line, with the blanks before it."""
    whole = tomllib.loads(piece)
    for index, character in enumerate(piece):
        if character != "#":
            continue
        try:
            if tomllib.loads(piece[:index]) == whole:
                value = piece[:index].rstrip(" \t")
                return piece[len(value) :].rstrip("\n")
        except tomllib.TOMLDecodeError:
            continue
    return ""
