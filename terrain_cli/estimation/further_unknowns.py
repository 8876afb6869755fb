"""What is sought in every window beside the soil: the shape of the contact, and offsets of sensors."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from terrain_cli.mechanics.effect import QUANTITIES, Effect, Parameter, Prior

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from terrain_cli.mechanics.effect import Law
    from terrain_cli.models import ModelFile
    from terrain_cli.telemetry import Samples

#: The shape of the contact, as far as soils differ in it. It ends at the lowest point, or before or behind it
#: (θ2 = −c3 θ1; c3 = 0.2 to 0.3 in soil that stays compacted: Ishigami et al. 2007).
#: The stress under the rim is greatest at θm = (c1 + c2 i) θ1: 0.18, 0.32
#: in loose sand and 0.43, 0.32 in compact sand (Wong & Reece 1967); 0.5, 0 in Iagnemma et al. 2004.
_SHAPE = {"max-stress-angle": {"c1": (0.4, 0.15), "c2": (0.2, 0.2)}, "rear-contact": {"c3": (0.0, 0.2)}}
#: What the soil feels is what these show without the offset; of the others the model predicts what they show.
_FELT = frozenset({"load", "slip"})


def with_contact(file: ModelFile) -> ModelFile:
    """Return a model in which the shape of the contact is sought in every window, within what is published.

    A model says nothing of the shape unless it has those effects itself, and the triangles of the base
    "linear" have none.
    """
    from terrain_cli import effects, models

    if file.model.base != "wong-reece":
        return file
    there = {effect.id for effect in file.model.effects}
    shapes = {effect: of for effect, of in _SHAPE.items() if effect not in there}
    expected = {f"{effect}.{name}": of for effect, each in shapes.items() for name, of in each.items()}
    model = replace(file.model, effects=(*file.model.effects, *(effects.find(effect) for effect in shapes)))
    priors = {name: models.Prior(*known) for name, known in expected.items()}
    return replace(file, model=model, priors={**file.priors, **priors}, local=(*file.local, *expected))


def offsets(samples: Samples) -> dict[str, float]:
    """Return the standard deviations of the sensors' offsets that rover.toml states, SI, by channel."""
    return {name: noise.offset for name, noise in samples.noise.items() if noise.offset > 0.0}


def with_offsets(file: ModelFile, samples: Samples, measured: Collection[str]) -> ModelFile:
    """Return a model in which the stated offsets of sensors are sought in every window."""
    stated = {name: size for name, size in offsets(samples).items() if name in measured}
    added = [_effect(name, size) for name, size in stated.items()]
    model = replace(file.model, effects=(*file.model.effects, *added))
    found = {
        f"{effect.id}.offset": Prior(0.0, size) for effect, size in zip(added, stated.values(), strict=True)
    }
    return replace(file, model=model, priors={**file.priors, **found}, local=(*file.local, *found))


def _effect(channel: str, size: float) -> Effect:
    sign = -1.0 if channel in _FELT else 1.0

    def shifted(q: Mapping[str, Any]) -> Any:
        return q[channel] + sign * q["offset"]

    laws: dict[str, Law] = {channel: shifted}
    # Not of the catalogue: rover.toml says that it is there, and no diagnosis has to find it.
    return Effect(
        id=f"{channel.replace('_', '-')}-offset",
        title=f"Offset of {channel.replace('_', ' ')}",
        kind="sensor",
        parameters=(Parameter("offset", QUANTITIES[channel], 0.0, size),),
        laws=laws,
        origin="rover.toml",
    )
