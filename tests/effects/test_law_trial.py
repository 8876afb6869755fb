"""The values on which a law is tried as its file is read."""

from __future__ import annotations

import numpy as np

from terrain_cli.effects.laws import law_names, law_trial
from terrain_cli.mechanics.effect import QUANTITIES
from terrain_cli.vocabulary.channels import CHANNELS, LABEL


def test_every_quantity_and_channel_has_ordinary_values():
    numeric = {name for name, channel in CHANNELS.items() if channel.dimension != LABEL}
    names = {*QUANTITIES, *numeric, *law_names.reached("shear_stress"), *law_names.ON_DEMAND}
    drawn = law_trial.inputs(())
    assert names <= drawn.keys()
    assert all(np.all(np.isfinite(values)) for values in drawn.values())


def test_they_go_together_as_in_the_model():
    """A law may say over again what the base says, by other names."""
    q = law_trial.inputs(())
    np.testing.assert_allclose(q["sinkage"], q["radius"] * (1.0 - np.cos(q["entry_angle"])))
    driving = q["slip"] >= 0.0
    slip = 1.0 - q["velocity"] / (q["wheel_radius"] * q["angular_velocity"])
    np.testing.assert_allclose(q["slip"][driving], slip[driving], atol=1e-12)
    assert np.all(q["depth"] > 0.0)


def test_always_the_same():
    first, second = law_trial.inputs({"grip"}), law_trial.inputs({"grip"})
    assert all(np.array_equal(first[name], second[name]) for name in first)
