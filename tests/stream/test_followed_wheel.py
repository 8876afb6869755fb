"""One wheel that is followed: skidding, effects, and what is set aside."""

from __future__ import annotations

import numpy as np
from streams import ROVER, Told, begun, followed, lines, text

from terrain_cli.models import build
from terrain_cli.run import one_log
from terrain_cli.run.settings import Settings
from terrain_cli.stream.arriving_samples import ArrivingSamples
from terrain_cli.stream.followed_wheel import CommonStress, FollowedWheel

NUMBERS = ("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg", "strength_kPa")


def changed(some, column, value, rows):
    place = some[0].split(",").index(column)
    cells = [line.split(",") for line in some[1:]]
    for number in rows:
        cells[number][place] = value
    return [some[0], *map(",".join, cells)]


def offline(some, folder, **settings):
    path = folder / "run.csv"
    path.write_bytes(text(some))
    return one_log.run(str(path), ROVER, Settings(**settings)).table


def same(told, table, names):
    for name in names:
        np.testing.assert_allclose(told.table[name], table[name], rtol=1e-6, err_msg=name)


def test_a_wheel_that_skids_is_in_the_full_model_and_not_on_the_line(tmp_path):
    some = changed(lines((60.0, 60.0))[:601], "slip", "-0.1", range(200, 260))
    for method in ("recursive", "wong-reece"):
        told = followed(text(some), method=method, segments="none")
        same(told, offline(some, tmp_path, method=method, segments="none"), NUMBERS)


def test_what_is_set_aside_is_counted_with_the_segment_before(tmp_path):
    some = changed(lines((60.0, 60.0))[:401], "load", "-1.0", [0, 1, 150, 399])
    settings = {"method": "recursive", "segments": "fixed", "window_samples": 149}
    told = followed(text(some), block=300, **settings)
    table = offline(some, tmp_path, **settings)
    assert list(told.table["n_rejected"]) == list(table["n_rejected"]) == [3, 0, 1]


def test_effects_that_follow_rates_have_the_samples_behind_too(tmp_path):
    """A rate of the newest sample is not known yet; when the segment closes it is."""
    some = lines((60.0, 60.0))[:601]
    model = build("wong-reece", ["acceleration-torque"])
    told = followed(text(some), block=200, model=model, segments="none")
    same(told, offline(some, tmp_path, model=model, segments="none"), NUMBERS)


def test_nothing_is_open_before_a_sample_came():
    wheel = FollowedWheel(Settings(), None, CommonStress(None))
    assert wheel.open_row() is None
    assert list(wheel.end()) == []
    rows = begun(lines((60.0, 60.0))[:2])
    for part in ArrivingSamples(rows, ROVER, Settings(), None).take(rows.take()):
        assert list(wheel.take(part)) == []
    assert wheel.soil[2] == 1
    assert np.isnan(wheel.soil[0])
    assert wheel.open_row()["status"] == ["too-few-samples"]


def test_all_wheels_are_compared_at_one_stress():
    told = followed(text(lines((60.0,), ("left", "right"))[:401]), method="recursive", told=Told())
    assert len(set(told.table["stress_kPa"])) == 1
    given = followed(text(lines((60.0,))[:201]), method="recursive", at_stress=3.0)
    assert list(given.table["stress_kPa"]) == [3.0]
