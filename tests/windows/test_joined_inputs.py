"""Windows of samples that were read without a model get what its effects use."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import terrain_cli as terrain
from terrain_cli import effects
from terrain_cli.errors import InputError
from terrain_cli.windows.joined_inputs import with_channels

SLOPE = [effects.find("slope")]


@pytest.fixture(scope="module")
def drive():
    return terrain.simulate(drive="slope", duration=20.0, rate=5.0, noise="3%")


def cut(frame, drive, method="none", **options):
    (samples,) = terrain.from_frame(frame, drive.rover)
    return terrain.segment(samples, method, **options)


def test_what_is_used_is_what_reading_with_the_model_gives(drive, tmp_path):
    model = tmp_path / "model.toml"
    model.write_text('format = "terrain-est/model/1"\nbase = "wong-reece"\neffects = ["slope"]\n')
    (known,) = terrain.from_frame(drive.frame, drive.rover, model=model)
    windows = with_channels(cut(drive.frame, drive), SLOPE)
    assert known.drivers.keys() == windows.samples.drivers.keys() == {"load", "pitch"}
    for name, values in known.drivers.items():
        np.testing.assert_array_equal(windows.samples.drivers[name], values)
    assert with_channels(windows, SLOPE) is windows


def test_samples_without_it_are_set_aside_and_empty_windows_go(drive):
    frame = drive.frame.copy()
    frame.loc[10:34, "pitch"] = np.nan
    windows = cut(frame, drive, "fixed", window_samples=10)
    ready = with_channels(windows, SLOPE)
    assert (len(windows.rows), len(ready.rows)) == (100, 75)
    assert ready.samples.reasons() == {"no pitch": 25}
    assert np.diff(windows.bounds).tolist() == [10] * 10
    assert np.diff(ready.bounds).tolist() == [10, 5, *[10] * 6]
    assert np.isfinite(ready.samples.drivers["pitch"][ready.rows]).all()
    np.testing.assert_array_equal(ready.x, windows.x[np.r_[0:10, 35:100]])


@pytest.mark.parametrize("change", ["drop", "empty"])
def test_what_was_not_measured_is_told_in_one_line(change, drive):
    frame = drive.frame.drop(columns="pitch") if change == "drop" else drive.frame.assign(pitch=np.nan)
    windows = cut(frame, drive)
    with pytest.raises(InputError, match=r"frame: the wheel: .*slope") as error:
        with_channels(windows, SLOPE)
    assert "\n" not in str(error.value)
    assert pd.notna(frame["load"]).all()
