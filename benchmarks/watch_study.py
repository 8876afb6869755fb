"""How often `model_watch` raises a false alarm, beside the rate that it is set to.

    python benchmarks/watch_study.py [HOURS]

writes benchmarks/results/watch_study.txt. HOURS of driving with white noise, 400 by default, and a quarter as many
with noise that lasts, of the simulator's wheel under the program's own model, in some 50 minutes; the same HOURS
give the same table.
"""

from __future__ import annotations

import os

# One thread each: the samples of a segment are too few for more.
os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import chi2

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE.parent / "tests")]

from simulator import (  # noqa: E402 - found through the path above
    CLAYEY_SOIL,
    DRY_SAND,
    LETE_SAND,
    UPLAND_SANDY_LOAM,
    base_contact,
    one_wheel,
    simulate,
    undulation,
    wave,
)

import terrain_cli  # noqa: E402 - as above
from benchmarks.published import publish  # noqa: E402 - found through the path above
from terrain_cli import models  # noqa: E402 - as above
from terrain_cli.mechanics.wheel_model import Model  # noqa: E402 - as above
from terrain_cli.rover import rover_file  # noqa: E402 - as above
from terrain_cli.stream import model_watch  # noqa: E402 - as above

RESULT = HERE / "results" / "watch_study.txt"
SOILS = (DRY_SAND, UPLAND_SANDY_LOAM, CLAYEY_SOIL, LETE_SAND)
#: Seconds of one segment, and Hz.
LENGTH, RATE = 450.0, 20.0
FIRST, APART = 9_620_000, 10_000
#: Seconds over which noise is correlated: 2 and 10 samples.
LASTING = (0.1, 0.5)
#: Alarms in an hour that the charts are set to.
RATES = (100.0, 30.0, 10.0, 3.0, 1.0, 0.1, model_watch.FALSE_ALARMS)
ROVER = rover_file.of_text("[wheel]\nradius = 0.125\nwidth = 0.1\n[soil]\nshear_modulus = 0.018\n")


def drive(seed, extra=0.0, lasting=0.0):
    """Return the samples of a segment.

    From its middle on the torque is so many N m larger; noise is correlated over so many seconds.
    """
    rng = np.random.default_rng(seed)
    plain = one_wheel(
        [(base_contact(SOILS[seed % len(SOILS)]), LENGTH)],
        load=undulation(80.0, rng.uniform(0.1, 0.3), rng.uniform(4.0, 12.0), seed=seed),
        slip=wave(rng.uniform(0.2, 0.4), rng.uniform(0.2, 0.5), rng.uniform(6.0, 20.0)),
        noise=0.03,
        rate=RATE,
        seed=seed,
    )
    sensors = {name: replace(sensor, correlation_time=lasting) for name, sensor in plain.sensors.items()}
    run = simulate(replace(plain, sensors=sensors))
    import pandas as pd

    table = pd.DataFrame(run.columns())
    table.loc[len(table) // 2 :, "torque"] += extra
    return terrain_cli.from_frame(table, ROVER)[0]


class Recorded(model_watch.ControlChart):
    """A chart that keeps its innovations, in standard deviations, and raises no alarm."""

    def __init__(self):
        super().__init__()
        self.innovations = []

    def add(self, innovation, deviation, _time):
        self.innovations.append(innovation / deviation)


def innovations(seed, extra=0.0, lasting=0.0):
    """Return the innovations of every channel of a segment, and the steps of all its charts in an hour."""
    samples = drive(seed, extra, lasting)
    samples, learnt = samples.taken(samples.usable), model_watch.LEARNT
    file = models.ModelFile(model=Model("wong-reece"))
    watch = model_watch.SegmentWatch(file, samples.taken(slice(0, learnt)))
    watch.charts = {name: Recorded() for name in watch.charts}
    seconds = (len(samples) - learnt) // watch.size
    watch.add(samples.taken(slice(learnt, learnt + seconds * watch.size)))
    steps = 3600.0 / (watch.size / RATE) * len(watch.charts)
    return {name: np.array(chart.innovations) for name, chart in watch.charts.items()}, steps


def alarms(series, limit):
    """Count alarms of one chart that begins anew after each; return also the steps to the first."""
    chart, count, first = model_watch.ControlChart(), 0, None
    for step, z in enumerate(series):
        chart.add(z, 1.0, float(step))
        if chart.alarm("", limit):
            chart, count = model_watch.ControlChart(), count + 1
            first = step if first is None else first
    return count, first


def report(hours):
    yield from ("False alarms of the watch on a model, beside those it is set to", "")
    yield from false_alarms(hours, FIRST, 0.0)
    for number, lasting in enumerate(LASTING, 1):
        yield ""
        yield from false_alarms(0.25 * hours / len(LASTING), FIRST + APART * number, lasting)
    yield from delays()


def false_alarms(hours, first, lasting):
    """Count the alarms of drives with nothing wrong, whose noise is correlated over so many seconds."""
    count = max(int(hours * 3600.0 / LENGTH), 2)
    found = [innovations(seed, lasting=lasting) for seed in range(first, first + count)]
    # All charts together make so many steps in an hour: fewer where the noise lasts, and means are longer.
    driven = sum(sum(map(len, series.values())) / steps for series, steps in found)
    yield from (
        f"{count} segments of {LENGTH:g} s at {RATE:g} Hz, the program's own model, 3 % of noise on every channel that is",
        f"{f'correlated over {lasting:g} s' if lasting else 'white'};",
        f"{driven:.1f} h after what the fits took. Standard deviation of the innovations, and correlation from one to the",
        "next, 1 and 0 if all is as assumed:",
        "",
    )
    for name in found[0][0]:
        z = np.concatenate([series[name] for series, _ in found])
        lagged = np.concatenate([series[name][1:] * series[name][:-1] for series, _ in found])
        yield f"{name:<14}{z.std():8.2f}{lagged.mean() / z.var():8.2f}"
    yield from ("", "Alarms an hour, and what that rate is below by 95 % (Poisson)", "")
    yield f"{'set to, 1/h':>14}{'limit':>8}{'seen':>8}{'1/h':>10}{'below':>10}"
    for rate in RATES:
        model_watch.FALSE_ALARMS, before = rate, model_watch.FALSE_ALARMS
        limits = [model_watch.limit(steps) for _, steps in found]
        model_watch.FALSE_ALARMS = before
        seen = sum(
            alarms(one, limit)[0]
            for (series, _), limit in zip(found, limits, strict=True)
            for one in series.values()
        )
        below = chi2.ppf(0.95, 2 * (seen + 1)) / 2.0 / driven
        yield f"{rate:14g}{np.median(limits):8.1f}{seen:8d}{seen / driven:10.4f}{below:10.4f}"


def delays():
    """Say how soon a torque that goes wrong is told."""
    limit = model_watch.limit(innovations(FIRST)[1])
    yield from (
        "",
        "A torque that is too large from the middle on: seconds until the alarm, in 8 segments of white noise",
        "",
    )
    for extra in (0.05, 0.1, 0.2, 0.5):
        found = []
        for seed in range(FIRST, FIRST + 8):
            series, _ = innovations(seed, extra)
            begun = len(series["torque"]) - int(LENGTH / 2.0)
            _, first = alarms(series["torque"][begun:], limit)
            found.append(np.inf if first is None else first + 1)
        told = [f"{delay:.0f}" if np.isfinite(delay) else "–" for delay in found]
        yield f"{extra:6g} N m  {' '.join(f'{text:>5}' for text in told)}"


def main():
    publish(report(float(sys.argv[1]) if len(sys.argv) > 1 else 400.0), RESULT)


if __name__ == "__main__":
    main()
