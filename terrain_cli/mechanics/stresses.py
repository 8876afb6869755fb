"""Stresses under the rim, as the model integrates them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from terrain_cli.mechanics.effect import Effect
from terrain_cli.mechanics.wheel_model import Model, predict

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike

    from terrain_cli.mechanics.wheel_model import WheelGeometry
    from terrain_cli.vocabulary.arrays import Array


#: Angles under the rim.
_NODES = 80


def stresses(
    model: Model,
    wheel: WheelGeometry,
    channels: Mapping[str, ArrayLike],
    values: Mapping[str, ArrayLike],
) -> tuple[Array, Array, Array]:
    """Return angles from the exit to the entry angle, rad, and normal and shear stress there, Pa; (nodes, n).

    Equations [7] and [8] of Iagnemma et al. 2004, and what the effects of the model make of them, at angles
    of which half are on each side of the angle of maximum stress. `channels`, shape (n,), are slip, sinkage,
    and what the effects need; `values` every parameter of the soil and of the effects; SI units.
    ConfigurationError: the base is linear, whose stresses are triangles; InputError: a channel is missing.
    """
    seen: dict[str, list[Any]] = {"angle": [], "normal_stress": [], "shear_stress": []}

    def look(q: Mapping[str, Any], *names: str) -> Any:
        for name in names:
            seen[name].append(q[name])
        return q[names[-1]]

    # A law sees the stresses at the nodes, and the last one sees them as all others left them.
    witness = Effect(
        id="stresses-looked-at",
        title="",
        kind="stress",
        parameters=(),
        laws={
            "normal_stress": lambda q: look(q, "angle", "normal_stress"),
            "shear_stress": lambda q: look(q, "shear_stress"),
        },
    )
    predict(Model(model.base, (*model.effects, witness)), wheel, channels, values, order=_NODES // 2)
    angle, normal, shear = (np.concatenate(parts, axis=1) for parts in seen.values())
    order = np.argsort(angle, axis=0)
    angle, normal, shear = (np.take_along_axis(column, order, axis=0) for column in (angle, normal, shear))
    return angle, normal, shear
