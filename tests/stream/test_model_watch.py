"""A watch on a model: silent while the model holds, and soon heard where it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from simulator import DRY_SAND, base_contact, one_wheel, simulate, undulation, wave
from streams import ROVER, followed, lines, text

import terrain_cli
from terrain_cli import effects
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.models import ModelFile
from terrain_cli.stream import model_watch
from terrain_cli.stream.model_watch import ControlChart, SegmentWatch, limit

SECONDS = (90.0,)


def spoilt(some, column, extra, after):
    """Return the lines with something added to a column from a time on."""
    names = some[0].split(",")
    place, clock = names.index(column), names.index("time")
    rows = [line.split(",") for line in some[1:]]
    start = float(rows[0][clock])
    for row in rows:
        if float(row[clock]) - start >= after:
            row[place] = repr(float(row[place]) + extra)
    return [some[0], *map(",".join, rows)]


def test_sums_of_chance_pass_the_limit_as_often_as_stated(monkeypatch):
    """White innovations, 3 charts of one step a second: 40 alarms in an hour are asked for."""
    monkeypatch.setattr(model_watch, "FALSE_ALARMS", 40.0)
    monkeypatch.setattr(model_watch, "_LONG_RUN", 1.0)
    bound, rng, count, hours = limit(3 * 3600.0), np.random.default_rng(0), 0, 2
    for _ in range(3):
        chart = ControlChart()
        for step, z in enumerate(rng.standard_normal(3600 * hours)):
            chart.add(z, 1.0, float(step))
            if chart.alarm("torque", bound):
                chart, count = ControlChart(), count + 1
    assert count / hours == pytest.approx(40.0, rel=0.35)


def test_a_lower_rate_needs_a_larger_sum(monkeypatch):
    usual = limit(3 * 3600.0)
    monkeypatch.setattr(model_watch, "FALSE_ALARMS", model_watch.FALSE_ALARMS / 100.0)
    assert limit(3 * 3600.0) == pytest.approx(usual + np.log(100.0) * 1.2, rel=0.01)


def test_a_model_that_holds_is_not_blamed():
    told = followed(text(lines(SECONDS)), model="wong-reece", segments="none")
    assert not [remark for remark in told.remarks if "misses" in remark]


def test_noise_that_lasts_is_not_taken_for_a_misfit(monkeypatch):
    """Correlated over half a second: 3 alarms an hour are asked for, 27 came from means of a second."""
    monkeypatch.setattr(model_watch, "FALSE_ALARMS", 3.0)
    file, alarms, driven = ModelFile(model=Model("wong-reece")), 0, 0.0
    for seed in range(6):
        plain = one_wheel(
            [(base_contact(DRY_SAND), 300.0)],
            load=undulation(80.0, 0.2, 7.0, seed=seed),
            slip=wave(0.3, 0.4, 11.0),
            noise=0.03,
            rate=20.0,
            seed=seed,
        )
        sensors = {name: replace(one, correlation_time=0.5) for name, one in plain.sensors.items()}
        run = pd.DataFrame(simulate(replace(plain, sensors=sensors)).columns())
        samples = terrain_cli.from_frame(run, ROVER)[0]
        watch = SegmentWatch(file, samples.taken(slice(0, model_watch.LEARNT)))
        assert watch.size > 60
        rest = samples.taken(slice(model_watch.LEARNT, None))
        charts, count = watch.charts, len(rest) // watch.size
        for step in range(count):
            told = watch.add(rest.taken(slice(step * watch.size, (step + 1) * watch.size)))
            alarms += len(told)
            charts.update({miss.channel: ControlChart() for miss in told})
        driven += count * watch.size / 20.0 / 3600.0
    assert driven > 0.4
    assert alarms <= 3


def test_a_torque_that_shifts_is_told_once_with_its_size_and_time():
    some = spoilt(lines(SECONDS), "torque", 0.3, 45.0)
    told = followed(text(some), model="wong-reece", segments="none")
    (said,) = [remark for remark in told.remarks if "torque" in remark]
    assert said.startswith("the wheel: the model predicts 0.")
    assert "N m too little torque since " in said
    size = float(said.partition("predicts ")[2].split()[0])
    since = float(said.partition("since ")[2].split()[0])
    assert size == pytest.approx(0.3, abs=0.1)
    assert since == pytest.approx(45.0, abs=5.0)
    assert said.endswith("Next: terrain-est diagnose LOG --model wong-reece")


@pytest.mark.parametrize("block", [4096, 1 << 20])
def test_a_change_of_soil_is_no_fault_of_the_model(block):
    told = followed(text(lines((60.0, 60.0))), block=block, model="wong-reece")
    assert len(told.rows) == 2
    assert not [remark for remark in told.remarks if "misses" in remark]


def test_without_a_model_nothing_is_watched():
    some = spoilt(lines(SECONDS), "torque", 0.3, 45.0)
    assert len(followed(text(some), method="recursive", segments="none").remarks) == 1


@pytest.mark.parametrize(
    ("name", "lags"),
    [
        ("sensor-lag", {"torque_lag": 0.31, "filtered": 1.0}),
        ("sensor-lag", {"torque_lag": 0.12, "drawbar_pull_lag": -0.2, "filtered": 0.0}),
        ("sensor-lag", {"torque_lag": -0.3, "filtered": 1.0}),
        ("sinkage-relaxation", {"length": 0.03}),
    ],
)
def test_what_is_late_is_watched_as_if_all_came_at_once(name, lags):
    """Whatever comes together, and however the wheel drove: what is predicted is that of the whole drive."""
    run = pd.DataFrame([line.split(",")[1:] for line in lines(SECONDS)[1:]], dtype=float)
    run.columns = lines(SECONDS)[0].split(",")[1:]
    samples = terrain_cli.from_frame(run, ROVER)[0]
    file = ModelFile(
        model=Model("wong-reece", (effects.find(name),)),
        fixed={f"{name}.{key}": value for key, value in lags.items()},
    )
    watch = SegmentWatch(file, samples.taken(slice(0, model_watch.LEARNT)))
    whole, by_whole = watch.residuals(samples, 0, len(samples))
    count = len(samples)
    for begin, end in ((400, 420), (420, 520), (1037, 1038), (count - 60, count)):
        part, by_part = watch.residuals(samples, begin, end)
        for channel in watch.compared:
            np.testing.assert_allclose(part[channel], whole[channel][begin:end], atol=1e-9)
            np.testing.assert_allclose(by_part[channel], by_whole[channel][begin:end], rtol=1e-4, atol=1e-6)
    # It would not be so without what came before.
    alone, _ = watch.residuals(samples.taken(slice(1000, 1020)), 0, 20)
    assert any(np.abs(alone[c] - whole[c][1000:1020]).max() > 1e-3 * np.std(whole[c]) for c in whole)
