"""Tests whether the residuals of an extended model still depend on the drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.comparison.bootstrap import max_test
from terrain_cli.diagnosis import diagnosis_criteria as criteria
from terrain_cli.diagnosis import drafted_laws, effect_scores

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from terrain_cli.diagnosis.refits import Ground, Refit

    Array = NDArray[np.float64]


def follows(data: Ground, one: Refit, seed: int) -> tuple[float, float]:
    """Test what is left against every driver: the p-value, and what the strongest takes off the squares."""
    tables, shrunk, most = [], 1.0, 0.0
    for index, solution in enumerate(one.solutions):
        part, wheel, rows = data.data[index], data.wheels[index], data.rows[index]
        columns = []
        for name, values in drafted_laws.drivers(wheel).items():
            # Measured sinkage has its own noise in common with what is left of it.
            column = part.inputs.get(name, one.predicted[index].get(name, values[rows]))
            known = column[np.isfinite(column)]
            if name == drafted_laws.ANGLE or len(known) == 0 or float(np.std(known)) == 0.0:
                continue
            unit = np.nan_to_num((column - float(np.mean(known))) / float(np.std(known)))
            columns += [unit, unit**2]
        if not columns:
            continue
        shapes = np.stack([np.ones(len(part.use)), *columns], axis=1)
        seen = part.seen
        every = np.concatenate(
            [
                part.white(
                    {
                        other: shapes if other == channel else np.zeros_like(shapes)
                        for other in part.white.channels
                    },
                    seen,
                )
                for channel in part.white.channels
            ],
            axis=2,
        )
        found, _ = effect_scores.scores(
            solution.residual, solution.design, every, part.window, data.block[index], data.blocks
        )
        gains = found.total**2 / np.maximum(np.diag(found.cross), 1e-300)
        most = max(
            most, float(np.where(found.surviving > criteria.REST_SURVIVES, gains, 0.0).max(initial=0.0))
        )
        tables.append(np.where(found.surviving > criteria.REST_SURVIVES, found.blocks, 0.0))
        shrunk = min(shrunk, found.shrunk)
    if not tables:
        return 1.0, 0.0
    found_p = max_test(np.concatenate(tables, axis=1), shrunk=shrunk, seed=seed).p_values
    return float(found_p.min(initial=1.0)), most
