"""What the fit of the full wheel model does not take."""

from __future__ import annotations

import numpy as np
import pytest
from wheel_samples import WHEEL, free

from terrain_cli.errors import InputError
from terrain_cli.estimation.wheel_fit import fit
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry


def run(channels, bounds, *, leave_out=(), **options):
    kept = {name: column for name, column in channels.items() if name not in leave_out}
    return fit(Model(), WheelGeometry(WHEEL.radius, WHEEL.width), kept, bounds, correlated=False, **options)


def test_what_cannot_be_fitted_is_said_in_one_line():
    truth = free(2, 5, 15)
    channels = truth.measured(1, 0.0)
    with pytest.raises(InputError, match="without sinkage") as error:
        run(channels, truth.bounds, leave_out=("sinkage",))
    assert "load" in error.value.hint
    with pytest.raises(InputError, match="without slip"):
        run(channels, truth.bounds, leave_out=("slip",))
    with pytest.raises(InputError, match="nothing to fit"):
        run(channels, truth.bounds, leave_out=("load", "torque", "drawbar_pull"))
    halves = np.arange(10) % 2 == 0
    gaps = {
        **channels,
        "sinkage": np.where(halves, channels["sinkage"], np.nan),
        "slip": np.where(halves, np.nan, channels["slip"]),
    }
    with pytest.raises(InputError, match="no sample has sinkage and slip"):
        run(gaps, truth.bounds)
