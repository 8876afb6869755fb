"""What a fit predicts along the stretches of a wheel, for a model with a late channel to be fitted behind."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from terrain_cli.estimation.wheel_fit import Fit
from terrain_cli.mechanics.past import along
from terrain_cli.mechanics.wheel_model import predict
from terrain_cli.vocabulary.arrays import Array
from terrain_cli.windows.cut_windows import Windows


def of_fit(
    whole: Windows, thinned: Windows, channels: Mapping[str, Array], fit: Fit, fixed: Mapping[str, ArrayLike]
) -> dict[str, Any]:
    """Return what a fit to the samples of `thinned` predicts of all, as those see it, without what is late.

    `channels` are of all usable samples; of steady test points there is nothing.
    """
    samples, rows, wheel = whole.samples, whole.rows, whole.samples.geometry.wheel
    if samples.time is None:
        return {}
    values = {name: np.repeat(one, np.diff(whole.bounds)) for name, one in fit.of_windows(fixed).items()}
    with np.errstate(all="ignore"):
        found = predict(fit.model, wheel, channels, values)
        shown = {"torque": found.torque, "drawbar_pull": found.drawbar_pull}
        if fit.model.base != "linear" and "load" in channels:
            shown["sinkage"] = predict(fit.model, wheel, channels, values, given="load", forces=False).sinkage
    velocity = samples.channels.get("velocity")
    velocity = None if velocity is None else velocity[rows]
    measured = {name: samples.channels[name][rows] for name in shown.keys() & samples.channels.keys()}
    past = along(samples.time[rows], samples.stretch[rows], velocity, shown, measured)
    return {name: column[np.searchsorted(rows, thinned.rows)] for name, column in past.items()}
