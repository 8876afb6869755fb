"""Reads what to simulate: a prepared drive or a TOML file, and what the command line says of the same."""

import tomllib
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from terrain_cli import models
from terrain_cli.errors import ConfigurationError
from terrain_cli.mechanics.wheel_model import WheelGeometry
from terrain_cli.simulation import perfect_sensors, scenario
from terrain_cli.simulation.scenario import Chosen, DrivePart, Scenario
from terrain_cli.simulation.sensors import CHANNELS_WRITTEN, KEYS, sensors_rule
from terrain_cli.vocabulary import toml_files
from terrain_cli.vocabulary.choices import BASES, Base
from terrain_cli.vocabulary.units import STANDARD_GRAVITY

_PREPARED = tomllib.loads(Path(__file__).with_name("drives.toml").read_text("utf-8"))
#: What is not said of a part; and preset → what differs from that.
CALM: dict[str, Any] = _PREPARED["calm"]
PRESETS: dict[str, dict[str, Any]] = _PREPARED["drives"]
WHEELS = {"multi": 4}  # Wheels of a drive that is about several
DURATION = 60.0  # s, of a part whose duration is not given


def _texts(value: Any, place: str) -> list[str]:
    several = [value] if isinstance(value, str) else value
    texts: list[str] = toml_files.several(toml_files.text)(several, place)
    if not texts:
        raise ConfigurationError(f"{place}: names nothing")
    return texts


_DRIVE = toml_files.choice(*PRESETS)
_PROFILES = {name: scenario.profile_rule(**entry) for name, entry in KEYS["profiles"].items()}
_PART = toml_files.rules(
    {"drive": "drive", "duration": KEYS["file"]["duration"], **{name: name for name in _PROFILES}},
    {"drive": _DRIVE, **_PROFILES},
)
_RULES = toml_files.rule_of_each(
    KEYS["file"],
    {
        "drive": lambda value, place: [_DRIVE(name, place) for name in _texts(value, place)],
        "parts": toml_files.several(_PART),
        "names": _texts,
        "soils": scenario.soils_rule,
        "wheel": toml_files.rules(KEYS["wheel"]),
        "rates": toml_files.rules(dict.fromkeys(CHANNELS_WRITTEN, KEYS["file"]["rate"])),
        "effects": scenario.effects_rule,
        "noise": sensors_rule,
    },
)
_FILE = toml_files.table(_RULES)
_EITHER = {"drive": "part", "part": "drive"}  # Of the two, the last one said counts
#: The wheel of the paper, with lugs for what needs them.
WHEEL = {"radius": 0.125, "width": 0.100, "grouser_count": 12, "grouser_height": 0.010}
SOIL = "dry-sand"
_AS_THEY_ARE = ("speed", "rate", "rates", "seed", "start", "drawbar_pull")  # Keys that a scenario has too
COMMAND_LINE = "--"  # What messages about options begin with
_OPTIONS = {"effects": "effect", "rates": "rate"}  # Where the option is called otherwise
#: N, the largest first: what each wheel carries if nothing is said and the soil bears it.
LOADS = (80.0, 60.0, 40.0, 30.0, 20.0, 10.0, 5.0, 2.0, 1.0)


def read(
    path: str | None, options: Mapping[str, Any], *, seed: int = 0, label: str = COMMAND_LINE
) -> Scenario:
    """Read what to simulate: options, which messages call `label`, stand above the same keys of the file."""
    # Effects, noise and rates are added to those of the file. The seed holds if neither says one.
    content: dict[str, Any] = {"seed": seed}
    places_of: dict[str, str] = {}
    for source, place in (
        (toml_files.parse(toml_files.read_text(path), path) if path else {}, str(path)),
        (dict(options), label),
    ):
        if place == COMMAND_LINE:
            checked = {key: _RULES[key](value, _said(place, key)) for key, value in source.items()}
        else:
            checked = _FILE(source, f"{place}: ")
        if "drive" in checked and "part" in checked:
            raise ConfigurationError(f"{place}: give one of drive and part, or drive inside a part")
        for key, value in checked.items():
            if key == "effects" and place != label:
                beside = Path(place).parent
                value = {str(beside / n) if models.is_path(n) else n: own for n, own in value.items()}  # noqa: PLW2901
            content.pop(_EITHER.get(key, ""), None)
            merged = {**content.get(key, {}), **value} if key in {"effects", "noise", "rates"} else value
            content[key], places_of[key] = merged, place
    # A model that the options name begins in the current folder.
    folder = Path(path).parent if path and places_of.get("model") != label else Path()
    return _scenario(content, defaultdict(lambda: label, places_of), folder)


def _said(place: str, key: str) -> str:
    """Return how messages call a key: of the command line by its option."""
    return f"{place}{_OPTIONS.get(key, key)}" if place == COMMAND_LINE else f"{place}: {key}"


def _scenario(content: Mapping[str, Any], places_of: Mapping[str, str], folder: Path) -> Scenario:
    wheel = {**WHEEL, **content.get("wheel", {})}
    under = content.get("load", LOADS[0]), wheel["radius"]
    base, effects = _model(content, folder, under)
    for name, given in content.get("effects", {}).items():
        chosen = scenario.choose(name, given, _said(places_of["effects"], "effects"), under)
        effects[chosen.effect.id] = chosen
    own, soil_place = content.get("soils", {}), _said(places_of["soil"], "soil")
    count = (WHEELS.get(drive, 1) for drive in content.get("drive", ()))
    found = Scenario(
        parts=_parts(content),
        soils=tuple(scenario.find(name, own, soil_place) for name in content.get("soil", [SOIL])),
        geometry=WheelGeometry(**wheel, gravity=content.get("gravity", STANDARD_GRAVITY)),
        wheels=scenario.places(content.get("wheels", max(count, default=1))),
        load=content.get("load", LOADS[0]),
        base=base,
        effects=tuple(effects.values()),
        sensors=content.get("noise", {}),
        **{key: content[key] for key in _AS_THEY_ARE if key in content},
    )
    # Made only now, it refuses an effect that the base does not have.
    _ = found.model
    return found if "load" in content else replace(found, load=perfect_sensors.bearable(found, LOADS))


def _model(
    content: Mapping[str, Any], folder: Path, under: tuple[float, float]
) -> tuple[Base, dict[str, Chosen]]:
    name = content.get("model", "wong-reece")
    if name not in BASES:
        name = str(folder / name)
    found = models.resolve(name)
    chosen = {}
    for effect in found.model.effects:
        names = {p.name: effect.qualified(p) for p in effect.parameters}
        own = {name: found.fixed[full] for name, full in names.items() if full in found.fixed}
        chosen[effect.id] = scenario.settle(effect, own, name, under)
    return found.model.base, chosen


def _parts(content: Mapping[str, Any]) -> tuple[DrivePart, ...]:
    asked = content.get("part") or [{"drive": drive} for drive in content.get("drive", ["mixed"])]
    share = content["duration"] / len(asked) if "duration" in content else DURATION
    parts = []
    for part in asked:
        preset = PRESETS[part["drive"]] if "drive" in part else {}
        plain = {name: _PROFILES[name](value, name) for name, value in (CALM | preset).items()}
        own = {name: value for name, value in part.items() if name in _PROFILES}
        parts.append(DrivePart(part.get("duration", share), plain | own))
    if "part" in content and "duration" in content:
        total = sum(part.duration for part in parts)
        parts = [replace(part, duration=part.duration * content["duration"] / total) for part in parts]
    if sum(part.duration for part in parts) > KEYS["file"]["duration"]["high"]:
        raise ConfigurationError("the parts of the drive last longer than 10 h together")
    return tuple(parts)
