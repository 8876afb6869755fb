"""Which effects stand out of what a model leaves, before any of them is fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli import effects as catalogues
from terrain_cli.comparison.comparison_outcome import EffectScores
from terrain_cli.diagnosis import alarm, screening
from terrain_cli.diagnosis import diagnosis_criteria as criteria

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from terrain_cli.comparison.fitted_wheel import FittedWheel
    from terrain_cli.diagnosis.screening import Screened
    from terrain_cli.effects import Effect
    from terrain_cli.models import ModelFile


def missing_effects(file: ModelFile) -> list[Effect]:
    """Return the effects of the catalogue that a model does not have."""
    there = {effect.id for effect in file.model.effects}
    return [effect for effect in catalogues.catalogue().values() if effect.id not in there]


def score(
    wheels: Sequence[FittedWheel], block: Sequence[NDArray[np.intp]], file: ModelFile, seed: int
) -> EffectScores:
    """Score every effect of the catalogue on a model as it was fitted.

    As in a diagnosis, chance must give neither the largest score nor a gain on held-out blocks, and the
    effect must be large enough; here gain and size are to first order.
    """
    effects = missing_effects(file)
    hypotheses, _ = screening.hypotheses(file, wheels, effects)
    scored = [one for one in hypotheses if one.effects]
    if any(wheel.one_soil for wheel in wheels):
        scored, _ = screening.on_changing_soil(scored)
    unrecorded = screening.unrecorded(effects, wheels)
    if 1 + max(int(one.max(initial=-1)) for one in block) < criteria.BLOCKS_OF_ALARM or not scored:
        return EffectScores(p_value=1.0, raised=False, unrecorded=unrecorded)
    found = screening.screen(wheels, block, scored, seed)
    order = sorted(found.p_values, key=lambda name: -found.explained[name])
    p_value = of_scores(found, order[0]) if order else 1.0
    raised = p_value < criteria.LEVEL and found.share(order[0]) >= criteria.SMALLEST_SHARE
    return EffectScores(p_value=p_value, raised=raised, effects=tuple(order), unrecorded=unrecorded)


def of_scores(found: Screened, first: str) -> float:
    """Return how often chance gives such scores, and to the first effect such a gain on held-out blocks."""
    gain = alarm.of_gain(found.held_out_gain(first))
    return max(min(found.p_values.values()), gain * criteria.LEVEL / criteria.GAINED)
