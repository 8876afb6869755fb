"""Few samples with which several noises go, each with a soil of its own."""

from dataclasses import replace

import numpy as np
import pytest
from simulator import RUBICON_SANDY_LOAM, Wheel, base_contact, forces, sinkage_under

from terrain_cli.effects import find as effect_of
from terrain_cli.estimation.wheel_fit import fit, fitting, noise_modes
from terrain_cli.estimation.wheel_fit.posterior import Posterior
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry


def known(t, own, common, shared, gain):
    """Return a posterior of one window, of which the rest says nothing."""
    size = len(t) + len(common)
    rest = dict.fromkeys(("sure", "wide"), np.ones((1, size)))
    rest |= dict.fromkeys(("misfit", "dof", "inflation", "excess"), np.ones(1))
    return Posterior(
        t=np.array([t]),
        own=np.array([own]),
        common=np.array(common),
        shared=np.array(shared),
        gain=np.array([gain]),
        at_bound=np.zeros((1, len(t)), dtype=bool),
        by_model=np.zeros((1, len(t), len(t))),
        **rest,
    )


def whole(found):
    """Return mean and covariance of own and shared unknowns together."""
    along = np.vstack([found.gain[0], np.eye(len(found.common))])
    own = np.zeros((3, 3))
    own[:2, :2] = found.own[0]
    return np.concatenate([found.t[0], found.common]), own + along @ found.shared @ along.T


def test_a_mixture_has_the_mean_and_the_covariance_of_its_draws():
    gain = [[0.4], [-0.2]]
    parts = [
        known([0.0, 1.0], [[1.0, 0.3], [0.3, 0.5]], [0.2], [[0.3]], gain),
        known([2.0, -1.0], [[0.2, -0.1], [-0.1, 0.4]], [-0.5], [[0.1]], gain),
    ]
    likely = [noise_modes.Learnt(problem=None, log_weight=weight) for weight in (-7.0, -7.0 + np.log(0.5))]
    found = noise_modes.mixed(parts, likely)
    rng = np.random.default_rng(1)
    drawn = np.concatenate(
        [
            rng.multivariate_normal(*whole(part), size=number)
            for part, number in zip(parts, (400_000, 200_000), strict=True)
        ]
    )
    mean, covariance = whole(found)
    np.testing.assert_allclose(mean, drawn.mean(axis=0), atol=0.01)
    np.testing.assert_allclose(covariance, np.cov(drawn.T), atol=0.02)
    # What no prior holds is as far apart.
    assert np.all(found.sure > 1.0)


def points(seed):
    """Return six steady points of a wheel that sinks as it slips, which the model does not know."""
    wheel, rng = Wheel(0.157, 0.165), np.random.default_rng(seed)
    soil = base_contact(RUBICON_SANDY_LOAM)
    slip = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.6])
    rows = []
    for i in slip:
        sinking = replace(soil, exponent=soil.exponent + 0.5 * i)
        depth = sinkage_under(sinking, wheel, 80.0, i)
        found = forces(sinking, wheel, depth, i)
        rows.append((80.0, found.torque, depth, i, found.pull))
    noise = 1.0 + 0.02 * rng.standard_normal((len(slip), 5))
    noise[:, 3] = 1.0
    return dict(zip(("load", "torque", "sinkage", "slip", "drawbar_pull"), (noise * rows).T, strict=True))


@pytest.fixture
def model():
    return Model(effects=tuple(effect_of(name) for name in ("max-stress-angle", "rear-contact")))


def estimated(model, channels):
    return fit(model, WheelGeometry(0.157, 0.165), channels, [0, 6], local=model.parameters, correlated=False)


def test_no_beginning_decides(model, monkeypatch):
    """A slip that errs goes with another soil than a torque that errs, and either with these points."""
    channels = points(5)
    together = estimated(model, channels)
    alone = []
    for place in (0, 1):

        def one(*of, place=place):
            yield list(noise_modes.beginnings(*of))[place]

        with monkeypatch.context() as patch:
            patch.setattr(fitting, "beginnings", one)
            alone.append(estimated(model, channels))
    phi = sorted(float(np.degrees(found.phi[0])) for found in alone)
    assert phi[0] + 5.0 < phi[1]
    assert phi[0] < np.degrees(together.phi[0]) < phi[1]
    assert together.phi_se[0] > 1.2 * min(found.phi_se[0] for found in alone)
