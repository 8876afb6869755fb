"""Priors with the moments of the soils from which tests draw."""

from __future__ import annotations

import numpy as np
from simulator.paper import TABLE_II
from wheel_samples import WHEEL

from terrain_cli.estimation.wheel_fit import Prior

#: The ranges from which the tests draw, densely.
DRAWN = {name: np.linspace(*ends, 201) for name, ends in TABLE_II.items()}
STIFFNESS = np.add.outer(DRAWN["cohesive_modulus"] / WHEEL.width, DRAWN["frictional_modulus"]).ravel()


def prior_of(values, *, positive=False):
    """Return the prior with the mean and the variance of values, or of their logarithms if positive."""
    if positive:
        return Prior.factor(np.exp(np.log(values).mean()), np.exp(np.log(values).std()))
    return Prior(float(np.mean(values)), float(np.std(values)))


PRIORS = {
    "cohesion": prior_of(DRAWN["cohesion"]),
    "tan_phi": prior_of(np.tan(DRAWN["friction_angle"])),
    "shear_modulus": prior_of(DRAWN["shear_modulus"], positive=True),
    "stiffness": prior_of(STIFFNESS, positive=True),
    "sinkage_exponent": prior_of(DRAWN["exponent"]),
}
