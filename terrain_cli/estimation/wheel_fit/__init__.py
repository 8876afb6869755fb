"""Fit of the full wheel–soil model to windows of samples, with noise in every channel.

The most probable parameters of soil and effects, given what the sensors' noise is, what published
soils are like, and that the true load, sinkage and slip of each sample are not known either:
`linearised` says how, `gauss_newton` finds them, `posterior` gives their errors.
"""

from terrain_cli.estimation.wheel_fit.excess_scatter import NOISE_LASTS, samples_a_second
from terrain_cli.estimation.wheel_fit.fit_data import Noise
from terrain_cli.estimation.wheel_fit.fit_result import Fit, as_window_estimates
from terrain_cli.estimation.wheel_fit.fitting import fit
from terrain_cli.estimation.wheel_fit.unknowns import DEFAULT
from terrain_cli.mechanics.effect import Prior

__all__ = [
    "DEFAULT",
    "NOISE_LASTS",
    "Fit",
    "Noise",
    "Prior",
    "as_window_estimates",
    "fit",
    "samples_a_second",
]
