"""Offsets that a sensor may have, as unknowns of the full model and as errors of the line."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from terrain_cli.mechanics.effect import QUANTITIES, Effect, Parameter, Prior

if TYPE_CHECKING:
    from collections.abc import Collection, Mapping

    from terrain_cli.mechanics.effect import Law
    from terrain_cli.models import ModelFile
    from terrain_cli.telemetry import Samples

#: What the soil feels is what these show without the offset; of the others the model predicts what they show.
_FELT = frozenset({"load", "slip"})


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
