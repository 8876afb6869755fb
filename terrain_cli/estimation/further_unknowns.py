"""What a model may lack: the shape of the contact, calibrations of sensors, which are sought, and effects."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from terrain_cli import effects
from terrain_cli.effects.laws.grammar import Law
from terrain_cli.mechanics.effect import QUANTITIES, Effect, Parameter, Prior, Quantities
from terrain_cli.mechanics.wheel_model import STRESSES
from terrain_cli.models import ModelFile
from terrain_cli.telemetry import Samples, effect_inputs
from terrain_cli.telemetry.wheel_samples import Geometry
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.windows.cut_windows import Windows

#: The shape of the contact, as far as soils differ in it. It ends at the lowest point, or before or behind it
#: (θ2 = −c3 θ1; c3 = 0.2 to 0.3 in soil that stays compacted: Ishigami et al. 2007).
#: The stress under the rim is greatest at θm = (c1 + c2 i) θ1: 0.18, 0.32
#: in loose sand and 0.43, 0.32 in compact sand (Wong & Reece 1967); 0.5, 0 in Iagnemma et al. 2004.
_SHAPE = {"max-stress-angle": {"c1": (0.4, 0.15), "c2": (0.2, 0.2)}, "rear-contact": {"c3": (0.0, 0.2)}}
#: What the soil feels is what these show without the error; of the others the model predicts what they show.
_FELT = frozenset({"load", "slip"})
#: What has the noise of a residual: what is predicted, and what the slip is derived from.
_RELATED = frozenset({"torque", "velocity", "angular_velocity"})


def with_contact(file: ModelFile) -> ModelFile:
    """Return a model in which the shape of the contact is sought in every window, within what is published.

    A model says nothing of the shape unless it has those effects itself, and the triangles of the base
    "linear" have none.
    """
    if file.model.base != "wong-reece":
        return file
    there = {effect.id for effect in file.model.effects}
    shapes = {effect: of for effect, of in _SHAPE.items() if effect not in there}
    expected = {f"{effect}.{name}": of for effect, each in shapes.items() for name, of in each.items()}
    model = replace(file.model, effects=(*file.model.effects, *(effects.find(effect) for effect in shapes)))
    priors = {name: Prior(*known) for name, known in expected.items()}
    return replace(file, model=model, priors={**file.priors, **priors}, local=(*file.local, *expected))


def with_rivals(
    file: ModelFile, windows: Windows, rivals: Sequence[Effect]
) -> tuple[ModelFile, dict[str, Array]]:
    """Return a model in which effects are sought too that data did not tell from its own.

    So c and φ, and their errors, allow for each of them. Also return what they read of the usable samples.
    An effect of which something is not known in every sample is left out.
    """
    samples, rows = windows.samples, windows.rows
    there = {*samples.channels, *samples.drivers, *_constants(samples)}
    there |= set() if samples.time is None else {"time"}
    inputs: dict[str, Array] = {}
    for effect in rivals:
        found = effect_inputs.of_samples(samples, [effect])
        further = {name: column[rows] for name, column in found.items()}
        known = all(np.isfinite(column).all() for column in further.values())
        if known and not effect_inputs.missing(effect, there) and not effects.conflict(file.model, effect):
            file = replace(file, model=replace(file.model, effects=(*file.model.effects, effect)))
            inputs |= further
    return file, inputs


class Stated(NamedTuple):
    """An error that rover.toml states of a sensor or of the wheel."""

    of: str  # A channel, "radius" or "width"
    kind: str  # "offset", "gain", or "relative_error" of a size
    size: float  # Standard deviation, in SI or as a share


def stated_errors(samples: Samples, measured: Collection[str]) -> list[Stated]:
    """Return what rover.toml states of the errors of the sensors' calibrations, and of the wheel's sizes."""
    geometry = samples.geometry
    sensors = [
        Stated(name, kind, size)
        for name, noise in samples.noise.items()
        for kind, size in (("offset", noise.offset), ("gain", noise.gain))
        if name in measured and size > 0.0
    ]
    sizes = (
        ("radius", geometry.radius_error / geometry.radius),
        ("width", geometry.width_error / geometry.width),
    )
    return [*sensors, *(Stated(name, "relative_error", share) for name, share in sizes if share > 0.0)]


def with_stated_errors(file: ModelFile, samples: Samples, measured: Collection[str]) -> ModelFile:
    """Return a model in which the errors that rover.toml states are sought in every window."""
    stated = stated_errors(samples, measured)
    added = [_effect(error, samples) for error in stated]
    model = replace(file.model, effects=(*file.model.effects, *added))
    pairs = zip(added, stated, strict=True)
    found = {f"{effect.id}.{error.kind}": Prior(0.0, error.size) for effect, error in pairs}
    return replace(file, model=model, priors={**file.priors, **found}, local=(*file.local, *found))


def with_error(
    error: Stated, by: float, samples: Samples, measured: Mapping[str, Array]
) -> tuple[Geometry, dict[str, Array]]:
    """Return the wheel and what the soil felt if an error were there, so many standard deviations large."""
    geometry, felt = samples.geometry, dict(measured)
    for name, law in _laws(error, samples).items():
        # What is shown of a torque or a sinkage is undone by the opposite error, to first order.
        amount = error.size * (by if name in {*_FELT, "radius"} else -by)
        if name == "radius":
            geometry = geometry._replace(radius=law({name: geometry.radius, error.kind: amount}))
        elif name in felt:
            felt[name] = law({name: felt[name], error.kind: amount})
    return geometry, felt


def suspects(file: ModelFile, windows: Windows) -> tuple[list[Effect], dict[str, Array]]:
    """Return effects that a model lacks and any log would show, and what they read of the usable samples.

    Without those that read what has noise that is in the residuals too, and those that are another law of the
    soil's stresses: of them c and φ are those of the line that touches it, and not those that the law has.
    """
    samples = windows.samples
    there = {*samples.channels, *_constants(samples)} - _RELATED
    found = [
        effect
        for effect in map(effects.find, effects.NAMES)
        if not effect_inputs.missing(effect, there)
        and not _RELATED.intersection((*effect.needs, *effect.any_of))
        and (effect.needs or not STRESSES.intersection(effect.laws))
        and not effects.conflict(file.model, effect)
    ]
    # Parameters of theirs that follow such channels stay at their null.
    further = effect_inputs.of_samples(samples, found)
    return found, {name: column[windows.rows] for name, column in further.items() if name not in _RELATED}


def _constants(samples: Samples) -> set[str]:
    return {name for name in effect_inputs.CONSTANTS if getattr(samples.geometry, name, None)}


def _effect(error: Stated, samples: Samples) -> Effect:
    of, kind, size = error
    unit = QUANTITIES[of] if kind == "offset" else "1"
    # Not of the catalogue: rover.toml says that it is there, and no diagnosis has to find it.
    return Effect(
        id=f"{of}-{kind.removeprefix('relative_')}".replace("_", "-"),
        title=f"{kind.replace('_', ' ').capitalize()} of {of.replace('_', ' ')}",
        kind="sensor",
        parameters=(Parameter(kind, unit, 0.0, size),),
        laws=_laws(error, samples),
        origin="rover.toml",
    )


def _laws(error: Stated, samples: Samples) -> dict[str, Callable[[Quantities], Any]]:
    laws: dict[str, Callable[[Quantities], Any]]
    match error:
        case Stated("width"):
            # All stresses act on another area: soil that is weaker and softer by as much carries the same.
            laws = {"load": Law("load / (1 + relative_error)")}
            return laws | {name: Law(f"{name} * (1 + relative_error)") for name in ("torque", "drawbar_pull")}
        case Stated("radius"):
            laws = {"radius": Law("radius * (1 + relative_error)")}
            if samples.derives("slip"):
                laws |= {"slip": effects.find("wheel-radius").laws["slip"]}
            if samples.derives("sinkage"):
                laws |= {"sinkage": Law("sinkage / (1 + relative_error)")}
            return laws
        case Stated(channel, "offset"):
            return {channel: Law(f"{channel} {'-' if channel in _FELT else '+'} offset")}
    return {error.of: Law(f"{error.of} {'/' if error.of in _FELT else '*'} (1 + gain)")}
