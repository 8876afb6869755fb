"""What residuals may follow."""

from dataclasses import replace

import numpy as np
from known_misfits import Kind, windows_of

from terrain_cli.comparison import drivers


def test_what_an_effect_derives_from_the_misfit_is_no_driver():
    windows = windows_of(1, Kind())
    derived = dict.fromkeys(("rut_slope", "sinkage_rate"), np.zeros(len(windows.samples)))
    asked = replace(windows.samples, drivers={**windows.samples.drivers, **derived})
    assert not derived.keys() & drivers.of_wheel(replace(windows, samples=asked)).keys()


def test_how_far_a_column_scatters_is_no_driver():
    windows = windows_of(1, Kind())
    columns = dict.fromkeys(
        ("Fx_std", "sigma z", "Std", "standing", "wind_std_x"), np.ones(len(windows.samples))
    )
    asked = replace(windows.samples, drivers={**windows.samples.drivers, **columns})
    found = drivers.of_wheel(replace(windows, samples=asked))
    assert columns.keys() & found.keys() == {"standing"}


def test_pitch_and_roll_are_those_of_the_course():
    windows = windows_of(1, Kind())
    samples = windows.samples
    n = len(samples)
    own = {"pitch": np.full(n, 0.1), "roll": np.full(n, 0.2), "yaw_rate": np.full(n, 0.3)}
    omega = np.where(np.arange(n) < n // 2, 1.0, -1.0)
    for turns in ({}, {"angular_velocity": omega}):
        channels = {k: v for k, v in samples.channels.items() if k != "angular_velocity"} | own | turns
        found = drivers.of_wheel(replace(windows, samples=replace(samples, channels=channels)))
        way = np.where(omega[windows.rows] < 0.0, -1.0, 1.0) if turns else 1.0
        for name, column in own.items():
            np.testing.assert_array_equal(
                found[name].values, column[windows.rows] * (way if name != "yaw_rate" else 1.0)
            )
