"""The recursive estimate against a Kalman filter written out."""

from __future__ import annotations

import numpy as np
import pytest
from drives import GEOMETRY, drive

from terrain_cli.estimation import estimate_windows, recursive
from terrain_cli.estimation.line.recursive import RecursiveLine
from terrain_cli.mechanics.linear import line_coordinates


def kalman(x, y, noise):
    """Filter the constant state (c, tan φ), sample by sample, from a wide prior."""
    state, covariance = np.zeros(2), np.diag([1e12, 1e4])
    for stress, strength in zip(x, y, strict=True):
        row = np.array([1.0, stress])
        gain = covariance @ row / (row @ covariance @ row + noise)
        state = state + gain * (strength - row @ state)
        covariance = covariance - np.outer(gain, row) @ covariance
        yield state, covariance


@pytest.fixture
def run():
    return drive(3, 120, 7, kind="undulation", share=0.2, noises=(0.0, 0.02, 0.0, 0.0))


@pytest.fixture
def stresses(run):
    return line_coordinates(**run.channels, **GEOMETRY)


def test_follows_the_filter(run, stresses):
    x, y = stresses
    trace = recursive(x, y, run.bounds, **run.channels)
    for start in run.bounds[:-1]:
        states = list(kalman(x[start : start + 120], y[start : start + 120], noise=200.0**2))
        for k in (10, 40, 119):
            state, covariance = states[k]
            assert trace.c[start + k] == pytest.approx(state[0], rel=1e-4, abs=0.1)
            assert np.tan(trace.phi[start + k]) == pytest.approx(state[1], rel=1e-4)
            # Errors of the trace also hold what a filter does not know: the κ3 that the line leaves out.
            assert trace.corr[start + k] == pytest.approx(
                covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), abs=0.05
            )


def test_ends_at_the_batch_answer(run, stresses):
    trace = recursive(*stresses, run.bounds, **run.channels)
    batch = estimate_windows(*stresses, run.bounds, **run.channels, **GEOMETRY, method="recursive")
    last = run.bounds[1:] - 1
    for name in ("c", "c_se", "phi", "phi_se", "corr"):
        np.testing.assert_allclose(getattr(trace, name)[last], getattr(batch, name), rtol=1e-9)


def test_is_every_time_the_batch_answer_so_far(run, stresses):
    x, y = stresses
    trace = recursive(x, y, run.bounds, **run.channels)
    for k in (4, 17, 80):
        part = {name: values[:k] for name, values in run.channels.items()}
        batch = estimate_windows(x[:k], y[:k], [0, k], **part, **GEOMETRY, method="recursive")
        for name in ("c", "c_se", "phi", "phi_se", "corr"):
            assert getattr(trace, name)[k - 1] == pytest.approx(getattr(batch, name)[0], rel=1e-6)


def test_errors_shrink_and_begin_unknown(run, stresses):
    trace = recursive(*stresses, run.bounds, **run.channels)
    for start in run.bounds[:-1]:
        assert np.isnan(trace.phi[start])
        assert np.isnan(trace.phi_se[start : start + 2]).all()
        assert np.isfinite(trace.phi_se[start + 2 : start + 120]).all()
        assert trace.phi_se[start + 119] < 0.5 * trace.phi_se[start + 9]


def test_empty_windows_have_no_samples(stresses, run):
    trace = recursive(*stresses, [0, 0, 120, 240, 360, 360], **run.channels)
    assert len(trace.c) == 360


def test_sample_by_sample_it_is_the_trace(run, stresses):
    """Whatever number of samples comes at once, with sums alone that are held."""
    columns = np.array([*stresses, *(run.channels[name] for name in ("load", "torque", "sinkage", "slip"))])
    columns = columns[:, :120]
    channels = {name: channel[:120] for name, channel in run.channels.items()}
    trace = recursive(*columns[:2], [0, 120], **channels)
    line, done = RecursiveLine(), 0
    for size in (1, 1, 1, 2, 3, 1, 31, 80):
        line.add(columns[:, done : done + size])
        done += size
        now = line.trace()
        for name in ("c", "c_se", "phi", "phi_se", "corr"):
            np.testing.assert_allclose(getattr(now, name)[0], getattr(trace, name)[done - 1], rtol=1e-9)
        np.testing.assert_allclose(line.soil, (trace.c[done - 1], np.tan(trace.phi[done - 1])), rtol=1e-9)
    line.add(columns[:, :0])
    assert line.count == done == 120


def test_a_load_that_does_not_vary_tells_no_soil():
    line = RecursiveLine()
    line.add(np.tile([[1e4], [7e3], [80.0], [3.0], [0.02], [0.3]], 50))
    assert np.isnan(line.soil).all()
