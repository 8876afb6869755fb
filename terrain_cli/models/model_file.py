"""Model files, read strictly and written: new ones with comments, old ones with what their user wrote."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import formats
from formats.errors import FormatError
from terrain_cli import effects
from terrain_cli.effects.laws import effect_file
from terrain_cli.errors import ConfigurationError, TerrainError, nearest
from terrain_cli.mechanics.effect import Effect, Prior
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.choices import BASES, MOST_SCALES, PRIOR_SHARES, SOIL_BOUNDS

if TYPE_CHECKING:
    from tomlkit import TOMLDocument
    from tomlkit.container import Container
    from tomlkit.items import Item

FORMAT = "terrain-est/model/1"
#: What a document says is compared by.
_TOP, _TABLES = ("format", "base", "effects", "shared"), ("fixed", "priors")
#: Parameters of the soil, with the unit of their values and what they are.
SOIL = {
    "cohesion": ("Pa", "cohesion c of the soil"),
    "tan_phi": ("1", "tangent of its friction angle φ"),
    "shear_modulus": ("m", "shear deformation modulus k of the soil"),
    "stiffness": ("Pa/m^n", "sinkage modulus keq = kc/b + kφ of the soil under this wheel"),
    "sinkage_exponent": ("1", "exponent n of pressure against sinkage"),
}
SOIL_UNITS = {name: unit for name, (unit, _) in SOIL.items()}


@dataclass(frozen=True, kw_only=True)
class ModelFile:
    """A model, and what is known of its parameters."""

    model: Model = field(default_factory=Model)
    effects: tuple[str, ...] = ()  # The effects as the file names them: ids, or paths beside the file
    # Parameters held, in SI units, such as ``shear_modulus`` and ``slip-sinkage.n1``
    fixed: Mapping[str, float] = field(default_factory=dict)
    # In SI units; those of k and keq are log-normal
    priors: Mapping[str, Prior] = field(default_factory=dict)
    shared: tuple[str, ...] = ()  # Parameters of the soil that are one for all windows of a wheel
    local: tuple[str, ...] = ()  # Parameters of effects that have a value of their own in every window
    history: tuple[Mapping[str, Any], ...] = ()  # What `model add` and `model remove` did; kept as it is
    path: Path | None = None  # None for a base without a file
    # The file as it was read, so that `save` keeps its comments
    text: str = field(default="", repr=False, compare=False)

    def factor(self, name: str) -> float:
        """Return the SI value of one unit of a parameter in the file; 1 but for effects of a user."""
        own = self.model.parameters.get(name)
        return own.factor if own else 1.0

    @property
    def units(self) -> dict[str, str]:
        """Unit of every parameter, of the soil and of the effects."""
        own = {name: parameter.unit for name, parameter in self.model.parameters.items()}
        return {name: SOIL_UNITS[name] for name in self.model.soil} | own

    @property
    def plain(self) -> bool:
        """Whether it is the linear model and nothing else, for which the estimators of the line do."""
        beyond = (self.effects, self.fixed, self.priors, self.shared)
        return self.model.base == "linear" and not any(beyond)


def resolve(name: str) -> ModelFile:
    """Return the model that ``--model`` names: a base, or the path of a model file."""
    for base in BASES:
        if name == base:
            return ModelFile(model=Model(base))
    if not Path(name).exists():
        near = nearest(name, BASES)
        raise ConfigurationError(
            f"{name}: no such model file{near}",
            hint=f"a model is {' or '.join(BASES)}, or a file: terrain-est model new {name}",
        )
    return load(name)


def load(path: str | Path) -> ModelFile:
    """Read a model file and the effects it names."""
    path = Path(path)
    text = toml_files.read_text(path)
    content = toml_files.parse(text, path)
    if content.get("format") != FORMAT:
        said = (
            f"format is {content['format']!r}"
            if "format" in content
            else "is not a model file: the key format is missing"
        )
        raise ConfigurationError(f"{path}: {said}", hint=f'this version reads format = "{FORMAT}"')
    content = _FILE(content, f"{path}: ")
    toml_files.require(content, str(path), "base")
    named = tuple(content.get("effects", ()))
    model = _model(content["base"], named, path.parent, f"{path}: ")
    fixed = {
        name: parameter(model, name, value, where)
        for name, value, where in flat(content.get("fixed", {}), f"{path}: fixed")
    }
    priors = {
        name: _prior(model, name, value, where)
        for name, value, where in flat(content.get("priors", {}), f"{path}: priors")
    }
    for name in sorted(fixed.keys() & priors.keys()):
        raise ConfigurationError(f"{path}: priors.{name}: is held by [fixed]", hint="keep one of the two")
    shared = tuple(content.get("shared", ()))
    for index, name in enumerate(shared):
        _known(name, model.soil, f"{path}: shared[{index}]")
    return ModelFile(
        model=model,
        effects=named,
        fixed=fixed,
        priors=priors,
        shared=shared,
        history=tuple(content.get("history", ())),
        path=path,
        text=text,
    )


def build(
    base: str, effects: Sequence[str] = (), fixed: Mapping[str, float] | None = None, folder: Path = Path()
) -> ModelFile:
    """Make a model that is not in a file yet; paths of effects begin in `folder`, values are SI."""
    model = _model(base, effects, folder)
    values = {name: parameter(model, name, value) for name, value in (fixed or {}).items()}
    return ModelFile(model=model, effects=tuple(effects), fixed=values)


def _model(base: Any, named: Sequence[str], folder: Path, place: str = "") -> Model:
    found = []
    for index, name in enumerate(named):
        try:
            found.append(find_effect(name, folder))
        except (TerrainError, FormatError) as error:
            where = f"{place}effects[{index}]: " if place else ""
            raise ConfigurationError(f"{where}{error}", hint=error.hint) from None
    try:
        return Model(base, tuple(found))
    except TerrainError as error:
        raise ConfigurationError(f"{place}{error}", hint=error.hint) from None


def is_path(name: str) -> bool:
    """Tell the file of an effect from an id of the catalogue."""
    return name.endswith(".toml") or "/" in name


def find_effect(name: str, folder: Path = Path()) -> Effect:
    """Return an effect of the catalogue, or one of a file whose path begins in `folder`."""
    if is_path(name):
        return effect_file.load(folder / name)
    return effects.find(name)


def flat(table: Any, place: str) -> Iterator[tuple[str, Any, str]]:
    """Flatten a table in which effects may have tables of their own: qualified name, value and place."""
    for name, value, where in toml_files.each(table, place):
        if isinstance(value, dict) and not {"mean", "sd"} & value.keys():
            for inner, number, inside in toml_files.each(value, where):
                yield f"{name}.{inner}", number, inside
        else:
            yield name, value, where


def parameter(model: Model, name: str, value: Any, place: str = "") -> float:
    """Check a value, in the unit of a parameter with a qualified name; return it in SI units."""
    place = place or name
    _known(name, (*model.soil, *model.parameters), place)
    return _within(model, name, value, place, "a number", *_bounds(model, name)[1])


def _bounds(model: Model, name: str) -> list[tuple[float, float]]:
    """Return the least and the greatest value of a parameter in SI, under a small wheel and under any."""
    if name not in model.parameters:
        return 2 * [SOIL_BOUNDS[name]]
    own = model.parameters[name]
    return [
        (max(p.lower, p.null - MOST_SCALES * p.scale), min(p.upper, p.null + MOST_SCALES * p.scale))
        for p in (own, own.anywhere)
    ]


def _within(model: Model, name: str, value: Any, place: str, what: str, low: float, high: float) -> float:
    """Check a value in a parameter's own unit against bounds in SI units, and return it in SI units."""
    own = model.parameters.get(name)
    factor = own.factor if own else 1.0
    unit = own.unit if own else SOIL_UNITS[name]
    in_unit = "" if unit == "1" else f" in {unit}"
    what = f"{what}{in_unit} from {low / factor:g} to {high / factor:g}"
    checked: float = toml_files.number(what, low / factor, high / factor)(value, place)
    return checked * factor


def _known(name: Any, known: Sequence[str], place: str) -> None:
    if name not in known:
        raise ConfigurationError(
            f"{place}: the model has no parameter {name!r}{nearest(str(name), known)}",
            hint=f"it has {', '.join(known)}",
        )


def _prior(model: Model, name: str, value: Any, place: str) -> Prior:
    _known(name, (*model.soil, *model.parameters), place)
    values = _PRIOR(value, place)
    toml_files.require(values, place, "mean", "sd")
    bounds = _bounds(model, name)
    least, most = (share * (high - low) for share, (low, high) in zip(PRIOR_SHARES, bounds, strict=True))
    return Prior(
        _within(model, name, values["mean"], f"{place}.mean", "a number", *bounds[1]),
        _within(model, name, values["sd"], f"{place}.sd", "a standard deviation", least, most),
    )


_PRIOR = toml_files.table({"mean": toml_files.number("a number"), "sd": toml_files.number("a number")})
_FILE = toml_files.table(
    {
        "format": toml_files.text,
        "base": toml_files.choice(*BASES),
        "effects": toml_files.several(toml_files.text),
        "shared": toml_files.several(toml_files.text),
        "fixed": toml_files.tables(lambda value, _: value),
        "priors": toml_files.tables(lambda value, _: value),
        "history": toml_files.several(toml_files.tables(lambda value, _: value)),
    }
)


def save(file: ModelFile, path: str | Path) -> None:
    """Write a model file whole or not at all; of one that was read, comments and order stay."""
    content = edited(file) if file.text else new(file)
    with formats.replacing(str(path)) as temporary, open(temporary, "w", encoding="utf-8") as target:  # noqa: PTH123
        target.write(content)


def new(file: ModelFile) -> str:
    soil = ", ".join(f"{name} ({SOIL_UNITS[name]})" for name in file.model.soil)
    lines = [
        "# A model of wheel and soil for terrain-est.",
        f"format = {toml_files.value(FORMAT)}",
        f'base = {toml_files.value(file.model.base)}   # "wong-reece" or "linear"',
        "# Ids of the catalogue (terrain-est effects list), or paths of effect files, beside this file.",
        f"effects = {toml_files.value(file.effects)}",
    ]
    if file.shared:
        lines += ["# One value for all segments of a wheel.", f"shared = {toml_files.value(file.shared)}"]
    lines += [
        "",
        "# Parameters held at a value; the others are estimated, those of the soil in each segment.",
        f"# Of the soil: {soil}.",
        "# Of the effects: by the names and in the units that terrain-est model show lists.",
        "[fixed]",
        *toml_files.lines(_tables(file)["fixed"]),
    ]
    if file.priors:
        lines += ["", "# What is known beforehand: mean and standard deviation.", "[priors]"]
        lines += toml_files.lines(_tables(file)["priors"])
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
        if before.get(name, []) == (list(value) if isinstance(value, tuple) else value):
            continue
        if name in document:
            document[name] = _item(value)
        else:
            _put_behind(_last(document), toml_files.lines({name: value}))
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
    lines = toml_files.lines(missing)
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


def _entry(entry: Mapping[str, Any]) -> list[str]:
    """Write an entry of the history; of tables in it each row on a line of its own."""
    lines = ["", "[[history]]"]
    for name, value in entry.items():
        nested = isinstance(value, Mapping) and all(isinstance(inner, Mapping) for inner in value.values())
        rows = nested and bool(value)
        lines += toml_files.lines(value if rows else {name: value}, f"{toml_files.key(name)}." * rows)
    return lines


def _content(document: dict[str, Any]) -> dict[str, Any]:
    """Return what a document says, however it is laid out."""
    top = {name: document.get(name, []) for name in _TOP}
    tables = {t: {name: value for name, value, _ in flat(document.get(t, {}), t)} for t in _TABLES}
    return {**top, **tables, "history": document.get("history", [])}
