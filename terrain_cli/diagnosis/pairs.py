"""Two effects that are missing together, of which neither alone explains what is seen.

Step by step the first effect added is the one that imitates both best, which need not be one of them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from terrain_cli.diagnosis import refits, screening, signatures
from terrain_cli.diagnosis.parts import Hypothesis
from terrain_cli.mechanics.model import Model

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from terrain_cli.diagnosis.refits import Ground, Refit
    from terrain_cli.diagnosis.screening import Screened

#: Pairs that are fitted: those that explain most to first order.
_FITTED = 8


def best(
    data: Ground,
    found: Screened,
    ranked: Sequence[tuple[Hypothesis, Refit]],
    progress: Callable[[str], None],
) -> tuple[Hypothesis, Refit] | None:
    """Find the two effects that together predict held-out blocks best.

    Parameters
    ----------
    data : Ground
    found : Screened
    ranked : sequence of (Hypothesis, Refit)
        Each of them alone.
    progress : callable

    Returns
    -------
    (Hypothesis, Refit) or None
        None where there is none that nature could have.
    """
    alone = {one.id: (one, refit) for one, refit in ranked if one.effects}
    effects = [one for one, _ in alone.values()]
    fitted = []
    for first, second in screening.promising_pairs(found, effects)[:_FITTED]:
        pair = _both(data, first, second)
        if pair is None:
            continue
        progress(f"fitting with {first.id} and {second.id}")
        after = [alone[one.id][1] for one in (first, second)]
        refit = refits.refit(data, pair, after=after)
        if not (refits.at_bounds(pair, refit) or refits.imitates(data, pair, refit)):
            fitted.append((pair, refit))
    return min(fitted, key=lambda one: float(one[1].loss.sum()), default=None)


def _both(data: Ground, first: Hypothesis, second: Hypothesis) -> Hypothesis | None:
    model = data.wheels[0].model
    if signatures.possible(first.model, second.effects[0]):
        return None
    effects = (*first.effects, *second.effects)
    return Hypothesis(
        f"{first.id} and {second.id}",
        f"{first.title}; {second.title}",
        Model(model.base, (*model.effects, *effects)),
        {**first.fixed, **second.fixed},
        {**first.priors, **second.priors},
        effects,
    )
