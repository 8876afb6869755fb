"""Reads a user's own effect from TOML: strictly, with its units checked and its law tried out."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from formats.content import failure
from terrain_cli.effects.laws import dimensions, expression, grammar, law_names, law_trial
from terrain_cli.effects.laws.dimensions import Dimension
from terrain_cli.effects.laws.grammar import Law, LawError
from terrain_cli.effects.laws.law_names import FILE, LONGEST_NAME, NAME_FORM
from terrain_cli.effects.laws.law_trial import Trial
from terrain_cli.errors import ConfigurationError, nearest
from terrain_cli.mechanics.effect import Effect, Kind, Parameter
from terrain_cli.vocabulary import toml_files

_KIND: dict[str, Kind] = {
    **dict.fromkeys(("cohesion", "tan_phi", "shear_modulus", "stiffness", "sinkage_exponent"), "soil"),
    **dict.fromkeys(("normal_stress", "shear_stress"), "stress"),
    **dict.fromkeys(("radius", "max_stress_angle", "exit_angle", "shear_radius"), "contact"),
    **dict.fromkeys(("load", "drawbar_pull"), "force"),
    **dict.fromkeys(("slip", "sinkage", "torque"), "sensor"),
}
_FORCES = frozenset({"load", "drawbar_pull", "torque"})  # What is as large as the wheel


@dataclass(frozen=True)
class Understood:
    """What a file says."""

    effect: Effect
    units: dict[str, dict[str, str]]  # Law by what it changes → unit of each name that it reads
    trials: dict[str, Trial]  # Law by what it changes → how it did at the null values
    warnings: list[str]


def load(path: str | Path) -> Effect:
    """Read an effect; a place in a law that is wrong is given by line and column."""
    return read(path).effect


def parse(text: str, name: str = "draft") -> Effect:
    """Read an effect that is in no file yet."""
    return _Reader(name, text, FILE(toml_files.parse(text, name), f"{name}: ")).understood().effect


def read(path: str | Path) -> Understood:
    try:
        raw = toml_files.read_text(path)
    except ConfigurationError as error:
        if isinstance(error.__cause__, FileNotFoundError | PermissionError | NotADirectoryError):
            raise failure(str(path), error.__cause__) from error
        raise
    content = FILE(toml_files.parse(raw, path), f"{path}: ")
    return _Reader(str(path), raw, content).understood()


class _Reader:
    """One file on its way to an effect."""

    def __init__(self, path: str, raw: str, content: dict[str, Any]) -> None:
        self.path, self.raw, self.content = path, raw, content
        self.warnings: list[str] = []

    def fail(self, problem: str, advice: str = "") -> ConfigurationError:
        return ConfigurationError(f"{self.path}: {problem}", hint=advice)

    def understood(self) -> Understood:
        content = self.content
        self.check_keys()
        self.needs = tuple(content.get("needs", ()))
        self.columns: dict[str, str] = content.get("columns", {})
        self.check_needs()
        self.parameters, self.scales = self.read_parameters()
        laws, units = {}, {}
        sizes = {name: dimensions.parse(unit).factor for name, unit in self.columns.items()}
        rates = {f"{name}_rate": size for name, size in sizes.items()}
        factors = {name: size for name, size in (rates | sizes).items() if size != 1.0}
        texts: dict[str, str] = content.get("laws") or {content["changes"]: content["law"]}
        for quantity, text in texts.items():
            try:
                laws[quantity] = law = Law(text, factors)
                units[quantity] = self.check_law(quantity, law)
            except LawError as error:
                raise self.located(quantity, error) from None
        self.check_use(laws)
        needs = self.needs
        if "load" not in needs and any("load" in law.reads for law in laws.values()):
            needs = (*needs, "load")
        own = [f"{n}: {v['reference']}" for n, v in content["parameters"].items() if v.get("reference")]
        effect = Effect(
            id=content["id"],
            title=content["title"],
            kind=content.get("kind", _KIND[next(iter(laws))]),
            parameters=self.parameters,
            laws=laws,
            needs=needs,
            formula="; ".join(f"{quantity} = {' '.join(law.text.split())}" for quantity, law in laws.items()),
            explanation=" ".join(content.get("explanation", "").split()),
            shows=content.get("shows", ""),
            reference="; ".join(filter(None, [content.get("reference", ""), *own])),
            settled_by=content.get("settled_by", ""),
            origin=self.path,
        )
        trials = {quantity: self.try_out(effect, quantity, law) for quantity, law in laws.items()}
        return Understood(self.with_shapes(effect), units, trials, self.warnings)

    def check_keys(self) -> None:
        content = self.content
        toml_files.require(content, self.path, "id", "title")
        if "laws" in content:
            for key in ("law", "changes"):
                if key in content:
                    raise self.fail(f"give {key} or [laws], not both")
        else:
            toml_files.require(content, self.path, "changes", "law")
        if not content.get("laws", True):
            raise self.fail("[laws] is empty", 'such as torque = "torque + friction"')
        if not content.get("parameters"):
            raise self.fail(
                "there is no parameter",
                "an effect has a number to be estimated: [parameters.NAME] with unit, null and scale",
            )

    def check_needs(self) -> None:
        for name in self.needs:
            problem = law_names.refused_need(name)
            if problem:
                raise self.fail(f"needs: {problem}", f"take {name} out of needs")
            if not grammar.written(name):
                raise self.fail(f"needs: {name!r} is no name that a law can read", grammar.NAME_FORM)
        for name, unit in self.columns.items():
            try:
                dimensions.parse(unit)
            except ConfigurationError as error:
                raise self.fail(f"columns.{name}: {error}", error.hint) from None
            if not law_names.is_column(name):
                raise self.fail(f"columns.{name}: the unit of a channel is known", "take it out of [columns]")
            if not {name, f"{name}_rate"} & set(self.needs):
                raise self.fail(f"columns.{name}: not among the needs{nearest(name, self.needs)}")
        for name in self.needs:
            if law_names.is_column(name) and not {name, name.removesuffix("_rate")} & self.columns.keys():
                self.warnings.append(
                    f"{name} is no channel: it is taken for a further column of plain numbers, as it "
                    f'stands in the data; [columns] {toml_files.key(name)} = "…" would give its unit'
                )

    def read_parameters(self) -> tuple[tuple[Parameter, ...], dict[str, Dimension]]:
        parameters, measures = [], {}
        changed = {*self.content.get("laws", [self.content.get("changes")])}
        grows = (float(changed <= _FORCES), float(changed == {"torque"}))
        for name, values in self.content["parameters"].items():
            place = f"parameters.{name}"
            if not grammar.NAME.fullmatch(name) or len(name) > LONGEST_NAME:
                raise self.fail(f"{place}: {name[:LONGEST_NAME]!r} is no name of a parameter", NAME_FORM)
            taken = law_names.refused_parameter(name) or "one of the needs" * (name in self.needs)
            if taken:
                raise self.fail(f"{place}: {name} is {taken}", "give the parameter another name")
            toml_files.require(values, f"{self.path}: {place}", "unit", "null", "scale")
            try:
                scale = dimensions.parse(values["unit"])
            except ConfigurationError as error:
                raise self.fail(f"{place}.unit: {error}", error.hint) from None
            low, null, high = values.get("lower", -math.inf), values["null"], values.get("upper", math.inf)
            if not low < high:
                raise self.fail(f"{place}: lower = {low:g} must be below upper = {high:g}")
            if not low <= null <= high:
                raise self.fail(
                    f"{place}: null = {null:g} is not between lower and upper, {low:g} and {high:g}"
                )
            measures[name] = scale.dimension
            parameters.append(
                Parameter(
                    name=name,
                    unit=values["unit"].strip() or "1",
                    null=null * scale.factor,
                    scale=values["scale"] * scale.factor,
                    lower=low * scale.factor,
                    upper=high * scale.factor,
                    meaning=values.get("meaning", ""),
                    factor=scale.factor,
                    # Of a force or a torque, or of either per angle, speed or kelvin.
                    grows=grows if scale.dimension.powers[0] == 1 else (0.0, 0.0),
                    absolute=True,
                    held=values.get("held", ""),
                )
            )
            if not (math.isfinite(parameters[-1].null) and 0.0 < parameters[-1].scale < math.inf):
                raise self.fail(f"{place}: null or scale is beyond all bounds")
        return tuple(parameters), measures

    def check_law(self, quantity: str, law: Law) -> dict[str, str]:
        """Refuse names that the law cannot read and units that do not match; return the units."""
        units = law_names.measured(self.needs, self.columns) | law_names.reached(quantity)
        known = {name: dimensions.parse(unit).dimension for name, unit in units.items()} | self.scales
        for place in expression.names(law.tree):
            if place.id not in known:
                problem, advice = law_names.unreadable(place.id, quantity, known, self.needs)
                raise LawError(problem, law.text, *expression.span(place), advice)
        gives, wanted = dimensions.Inference(law.text, known).of(law.tree), known[quantity]
        if gives not in (None, wanted):
            problem = f"the law gives {gives}, and {quantity} is {wanted}"
            raise LawError(problem, law.text, *expression.span(law.tree))
        return {name: units[name] for name in law.reads if name in units}

    def check_use(self, laws: Mapping[str, Law]) -> None:
        """Refuse a parameter that no law reads; warn of a need that none reads."""
        read = {name for law in laws.values() for name in law.reads}
        for parameter in self.parameters:
            if parameter.name not in read:
                near = nearest(parameter.name, read)
                raise self.fail(f"parameters.{parameter.name}: no law reads {parameter.name}{near}")
        for need, name in zip(self.needs, law_names.measured(self.needs, self.columns), strict=True):
            if name not in read:
                how = f"; a law reads it as {name}" if name != need else ""
                self.warnings.append(f"needs {need}, which no law reads{how}")

    def located(self, quantity: str, error: LawError) -> ConfigurationError:
        """Give an error in a law its line and column in the file."""
        key = f"laws.{quantity}" if "laws" in self.content else "law"
        name = f"(?:laws[.])?{quantity}" if "laws" in self.content else "law"
        start = re.search(rf"(?m)^[ \t]*{name}[ \t]*=", self.raw)
        first = self.raw.find(error.text, start.end()) if start else -1
        if first < 0:
            # Written with escapes or in a table on one line: only the place in the law is sure.
            return self.fail(f"{key}: {error}", error.hint)
        place = first + error.start
        line = self.raw.count("\n", 0, place) + 1
        column = place - self.raw.rfind("\n", 0, place)
        return self.fail(f"{key}: line {line}, column {column}: {error.problem}", error.hint)

    def try_out(self, effect: Effect, quantity: str, law: Law) -> Trial:
        """Refuse a law that does not give back its quantity at the null values."""
        result = law_trial.at_null(effect, quantity, law.reads)
        key = f"laws.{quantity}" if "laws" in self.content else "law"
        nulls = ", ".join(f"{p.name} = {p.null / p.factor:g}" for p in effect.parameters)
        if math.isnan(result.deviation):
            raise self.fail(
                f"{key}: gives no number when every parameter has its null value: {nulls}",
                f"for instance at {_listed(result.example)} (SI)",
            )
        if result.deviation > law_trial.ROUNDING and not result.skids_only:
            raise self.fail(
                f"{key}: does not give back {quantity} when every parameter has its null value: "
                f"{result.gave:.6g} instead of {result.wanted:.6g}",
                f"at {_listed(result.where)} (SI)\n"
                f"a law gives the whole {quantity}, not its change: {quantity} + …, {quantity} * (1 + …)",
            )
        if result.deviation > law_trial.ROUNDING:
            self.warnings.append(
                f"{key}: at the null values it gives back {quantity} only where slip is not negative"
            )
        if result.no_number:
            self.warnings.append(
                f"{key}: gives no number for {result.no_number:.0%} of ordinary values, "
                f"for instance at {_listed(result.example)} (SI)"
            )
        return result

    def with_shapes(self, effect: Effect) -> Effect:
        """Mark the parameters that shape what others bring; warn of those the data cannot determine."""
        at_null, typical = {}, {}
        for parameter in effect.parameters:
            sizes = [
                law_trial.influence(effect, quantity, law.reads, parameter.name)
                for quantity, law in effect.laws.items()
                if isinstance(law, Law) and parameter.name in law.reads
            ]
            at_null[parameter.name] = [size for size, _ in sizes]
            typical[parameter.name] = any(size for _, size in sizes)
        led = any(any(sizes) for sizes in at_null.values())
        parameters = []
        for parameter in effect.parameters:
            name = parameter.name
            idle = not any(at_null[name])
            if not all(map(math.isfinite, at_null[name])):
                self.warnings.append(f"{name}: the derivative of the law is not finite at its null value")
            elif idle and not typical[name]:
                self.warnings.append(f"{name}: has no influence on the law")
            elif idle and not led:
                self.warnings.append(
                    f"{name}: the law has no slope at its null value, from where its search starts"
                )
            shape = idle and typical[name] and led and not parameter.held
            parameters.append(replace(parameter, shape=shape))
        return replace(effect, parameters=tuple(parameters))


def _listed(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {number:.4g}" for name, number in values.items())
