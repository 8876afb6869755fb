"""Model files, read strictly: every key and parameter must be known, and every value possible."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from formats.errors import FormatError
from terrain_cli import effects
from terrain_cli.effects.laws import effect_file
from terrain_cli.errors import ConfigurationError, TerrainError, nearest
from terrain_cli.mechanics.effect import Prior
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.choices import BASES, EFFECT_SCALES, PRIOR_SHARES, SOIL_BOUNDS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from terrain_cli.mechanics.effect import Effect


FORMAT = "terrain-est/model/1"
#: Parameters of the soil with the unit of their values.
SOIL_UNITS = {
    "cohesion": "Pa",
    "tan_phi": "1",
    "shear_modulus": "m",
    "stiffness": "Pa/m^n",
    "sinkage_exponent": "1",
}
#: What they are, in words.
SOIL_MEANINGS = {
    "cohesion": "cohesion c of the soil",
    "tan_phi": "tangent of its friction angle φ",
    "shear_modulus": "shear deformation modulus k of the soil",
    "stiffness": "sinkage modulus keq = kc/b + kφ of the soil under this wheel",
    "sinkage_exponent": "exponent n of pressure against sinkage",
}


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
        said = f"format is {content['format']!r}" if "format" in content else "format is missing"
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
    for name in fixed.keys() & priors.keys():
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
    """Flatten a table of parameters, in which effects may have tables of their own.

    Of ``{"slip-sinkage.n1": 0.4}`` or ``{"slip-sinkage": {"n1": 0.4}}``: qualified name, value and place.
    """
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
    low, high = _bounds(model, name)
    return _within(model, name, value, place, "a number", low, high)


def _bounds(model: Model, name: str) -> tuple[float, float]:
    """Return the least and the greatest value that a parameter may have, in SI units."""
    own = model.parameters.get(name)
    if own is None:
        return SOIL_BOUNDS[name]
    farthest = EFFECT_SCALES * own.scale
    return max(own.lower, own.null - farthest), min(own.upper, own.null + farthest)


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
    low, high = _bounds(model, name)
    least, most = (share * (high - low) for share in PRIOR_SHARES)
    return Prior(
        _within(model, name, values["mean"], f"{place}.mean", "a number", low, high),
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
