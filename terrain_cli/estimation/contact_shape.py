"""The shape of the contact, which is sought in every window of the full model."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from terrain_cli.models import ModelFile

#: The shape of the contact, as far as soils differ in it. It ends at the lowest point, or before or behind it
#: (θ2 = −c3 θ1; c3 = 0.2 to 0.3 in soil that stays compacted: Ishigami et al. 2007).
#: The stress under the rim is greatest at θm = (c1 + c2 i) θ1: 0.18, 0.32
#: in loose sand and 0.43, 0.32 in compact sand (Wong & Reece 1967); 0.5, 0 in Iagnemma et al. 2004.
_SHAPE = {
    "max-stress-angle": {"c1": (0.4, 0.15), "c2": (0.2, 0.2)},
    "rear-contact": {"c3": (0.0, 0.2)},
}


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
