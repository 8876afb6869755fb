"""Scores of every effect, without fitting any, against fitting each."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.diagnosis_drives import Kind, sized, windows_of
from benchmarks.harness import Case, Stage
from terrain_cli import effects, models
from terrain_cli.comparison import blocks, smoothed_model
from terrain_cli.comparison.compare import fit_wheels
from terrain_cli.diagnosis import screening
from terrain_cli.estimation.estimators import FitSettings
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.windows.joined_inputs import by_wheel

if TYPE_CHECKING:
    from pathlib import Path

HIDDEN = "drivetrain-friction"
SECONDS = {"small": 32.0, "medium": 128.0, "full": 500.0}
#: s of a block.
BLOCK = 4.0


def fitted(hypothesis, wheel, data):
    """Fit soil and effect by least_squares with differences, on the forward model that is ours."""
    from scipy.optimize import least_squares

    own = [name for name, p in hypothesis.parameters.items() if not p.shape]
    scale = {name: hypothesis.model.parameters[name].scale for name in own}
    shapes = {name: p.null for name, p in hypothesis.parameters.items() if p.shape}
    soil = {name: float(np.mean(column)) for name, column in wheel.parameters.items()}
    begun = np.concatenate([np.ones(len(wheel.soil)), np.zeros(len(own))])

    def residual(x):
        found = {name: soil[name] * x[j] for j, name in enumerate(wheel.soil)}
        moved = zip(own, x[len(wheel.soil) :], strict=True)
        found |= {
            name: hypothesis.model.parameters[name].null + scale[name] * change for name, change in moved
        }
        numbers = {name: np.full(len(wheel), number) for name, number in {**soil, **shapes, **found}.items()}
        return smoothed_model.residual(
            data, smoothed_model.forecast(hypothesis.model, data, numbers)[0]
        ).ravel()

    return least_squares(residual, begun)


def same_effect(ours, peer) -> str:
    """Compare which effect explains most, and how large it is taken to be."""
    most = max(ours.explained, key=lambda name: ours.explained[name])
    least = min(peer, key=lambda name: peer[name].cost)
    if most != least:
        raise AssertionError(f"{most} to first order, {least} when fitted")
    return f"both find {most} among {len(peer)}"


def screen(size: str, folder: Path) -> Case:  # noqa: ARG001 - every stage is made so
    """Make the case of the scores."""
    every = list(effects.catalogue().values())
    windows = by_wheel(windows_of(11, Kind(sized(HIDDEN), seconds=SECONDS[size]), "none"), every)
    file = models.ModelFile()
    further = tuple(dict.fromkeys(name for effect in every for name in effect.reads))
    wheels, _ = fit_wheels(windows, Model(), FitSettings.of(windows, file), further=further)
    tried = [one for one in screening.hypotheses(file, wheels, every)[0] if one.effects]
    block = [
        own.astype(np.intp) for own in blocks.fine([len(w) for w in wheels], int(BLOCK * Kind.rate), most=40)
    ]
    data = wheels[0].least_squares_data()
    return Case(
        lambda: screening.screen(wheels, block, tried, 1),
        lambda: {one.id: fitted(one, wheels[0], data) for one in tried},
        same_effect,
        None,
        len(tried),
        len(tried),
        "effects",
    )


STAGES = (
    Stage(
        "scores of effects",
        "scipy least_squares with differences, each",
        partial(screen),
        50.0,
        100.0,
        rounds=2,
    ),
)
