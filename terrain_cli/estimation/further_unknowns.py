"""What a model may lack: the shape of the contact, calibrations of sensors, which are sought, and effects."""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from terrain_cli import effects
from terrain_cli.effects.laws.grammar import Law
from terrain_cli.mechanics.effect import QUANTITIES, Effect, Parameter, Prior
from terrain_cli.mechanics.wheel_model import STRESSES
from terrain_cli.models import ModelFile
from terrain_cli.telemetry import Samples, effect_inputs
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


def calibrations(samples: Samples, measured: Collection[str]) -> list[tuple[str, str, float]]:
    """Return channels, "offset" or "gain", and the standard deviations that rover.toml states of them, SI."""
    return [
        (name, kind, size)
        for name, noise in samples.noise.items()
        for kind, size in (("offset", noise.offset), ("gain", noise.gain))
        if name in measured and size > 0.0
    ]


def with_calibrations(file: ModelFile, samples: Samples, measured: Collection[str]) -> ModelFile:
    """Return a model in which the stated errors of the sensors' calibrations are sought in every window."""
    stated = calibrations(samples, measured)
    added = [_effect(*error) for error in stated]
    model = replace(file.model, effects=(*file.model.effects, *added))
    found = {
        f"{effect.id}.{kind}": Prior(0.0, size) for effect, (_, kind, size) in zip(added, stated, strict=True)
    }
    return replace(file, model=model, priors={**file.priors, **found}, local=(*file.local, *found))


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


def _effect(channel: str, kind: str, size: float) -> Effect:
    plus, times = ("-", "/") if channel in _FELT else ("+", "*")
    offset = kind == "offset"
    # Not of the catalogue: rover.toml says that it is there, and no diagnosis has to find it.
    return Effect(
        id=f"{channel.replace('_', '-')}-{kind}",
        title=f"{kind.capitalize()} of {channel.replace('_', ' ')}",
        kind="sensor",
        parameters=(Parameter(kind, QUANTITIES[channel] if offset else "1", 0.0, size),),
        laws={channel: Law(f"{channel} {plus} offset" if offset else f"{channel} {times} (1 + gain)")},
        origin="rover.toml",
    )
