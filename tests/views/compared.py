"""Comparisons whose truth is known: drives of the simulator, with a torque that is wrong above a slip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from simulator.drive import CHANNELS, Drive, Track
from simulator.noise import Sensor
from simulator.profiles import undulation, wave
from simulator.soils import DRY_SAND, SANDY_LOAM

from formats import Labels
from terrain_cli.comparison.comparison_outcome import (
    UNITS,
    ChannelErrors,
    Comparison,
    Driver,
    Finding,
    Series,
    WheelComparison,
)
from terrain_cli.estimation.wheel_fit import fit
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.telemetry.wheel_samples import Geometry, Samples
from terrain_cli.windows import cut_windows

GEOMETRY = Geometry(0.125, 0.1, 0.018)
#: N m that the torque has too much above a slip of `ABOVE`.
EXCESS, ABOVE = 0.6, 0.4
#: What was fitted to a log of a wheel, which is kept so that no other takes its place: no test changes a fit.
_FITTED = {}


def drive(seconds=12.0, rate=10.0):
    soils = [(DRY_SAND, seconds), (SANDY_LOAM, seconds)]
    tracks = [
        Track("front-left", soils, undulation(80.0, 0.25, 7.0), wave(0.3, 0.6, 11.0)),
        Track("front-right", soils, undulation(70.0, 0.25, 5.0), wave(0.35, 0.6, 9.0)),
    ]
    return Drive(
        tracks,
        rate=rate,
        sensors={name: Sensor(relative=0.02) for name in ("load", *UNITS)},
        channels=(*CHANNELS, "drawbar_pull", "pitch"),
        pitch=wave(0.05, 1.0, 13.0),
        heading=0.4,
        seed=3,
    )


def samples_of(log, source):
    """Put what was measured of a wheel where the program has it after reading."""
    channels = log.aligned()
    time = channels.pop("time")
    channels["slip"] = 1.0 - channels["velocity"] / (GEOMETRY.radius * channels["angular_velocity"])
    channels["torque"] = channels["torque"] + EXCESS * (channels["slip"] > ABOVE)
    names = tuple(stretch.soil.name for stretch in log.stretches)
    soil = np.searchsorted(log.boundaries, time, side="right").astype(np.int32)
    return Samples(
        source=source,
        wheel=log.name,
        geometry=GEOMETRY,
        origin=0.0,
        time=time,
        channels=channels,
        labels={"terrain": Labels(soil, names)},
        stretch=np.zeros(len(time), dtype=np.intp),
        distance=np.hypot(channels["x"], channels["y"]),
        set_aside=Labels(np.full(len(time), -1, dtype=np.int32), ()),
    )


def wheel_of(log, source, extra):
    samples = samples_of(log, source)
    cut = cut_windows.cut(samples, "fixed", window_samples=60)
    rows = cut.rows
    drivers = {
        name: Driver(name, unit, samples.channels[name][rows])
        for name, unit in (("slip", "1"), ("load", "N"), ("sinkage", "m"), ("pitch", "rad"))
    }
    drivers["time"] = Driver("time", "s", samples.time[rows])
    noise = np.random.default_rng(0).normal(size=len(rows))
    drivers[extra] = Driver(extra, "", noise)
    drivers["constant"] = Driver("constant", "", np.ones(len(rows)))
    series = {
        name: Series(
            measured=samples.channels[name][rows],
            predicted=log.truth[name][rows],
            heldout=log.truth[name][rows],
        )
        for name in UNITS
    }
    terrain = samples.labels["terrain"]
    drivers["terrain"] = Driver("terrain", "", terrain.codes[rows].astype(float), terrain.names)
    channels = {name: samples.channels[name][rows] for name in ("load", "slip", *UNITS)}
    if id(log) not in _FITTED:
        _FITTED[id(log)] = log, fit(Model(), GEOMETRY.wheel, channels, cut.bounds)
    return WheelComparison(
        source=source,
        wheel=log.name,
        samples=samples,
        windows=cut,
        segments=cut,
        fit=_FITTED[id(log)][1],
        model=Model(),
        series=series,
        errors={},
        drivers=drivers,
        blocks=np.zeros(len(rows), dtype=np.intp),
    )


def errors_of(wheels, name):
    measured, predicted = (
        np.concatenate([getattr(wheel.series[name], which) for wheel in wheels])
        for which in ("measured", "predicted")
    )
    residual = measured - predicted
    rmse = float(np.sqrt(np.mean(residual**2)))
    return ChannelErrors(
        name=name,
        unit=UNITS[name],
        n=len(measured),
        rmse=rmse,
        bias=float(residual.mean()),
        nrmse=rmse / float(np.sqrt(np.mean(measured**2))),
        noise=0.02 * float(np.abs(measured).mean()),
        heldout_rmse=1.1 * rmse,
        heldout_low=0.9 * rmse,
        heldout_high=1.4 * rmse,
    )


def comparison_of(run, *, source="run.csv", extra="bus_voltage", failures=True, warnings=()):
    wheels = [wheel_of(log, source, extra) for log in run.wheels.values()]
    finding = Finding(
        channel="torque",
        driver="slip",
        shape="step",
        p_value=0.001,
        share=0.72,
        amplitude=EXCESS,
        unit="N m",
        at=ABOVE,
        sentence=f"the model predicts {EXCESS:.1f} N m too little torque above slip {ABOVE}",
        worst_segments=((source, "front-left", 1),),
    )
    return Comparison(
        model={"base": "wong-reece", "effects": []},
        wheels=wheels,
        channels={name: errors_of(wheels, name) for name in UNITS},
        failures=[finding] if failures else [],
        warnings=list(warnings),
    )


def halved(comparison):
    """Return a comparison that leaves half of each residual, and half the error and noise."""
    wheels = [
        replace(
            wheel,
            series={
                name: replace(one, predicted=0.5 * (one.predicted + one.measured))
                for name, one in wheel.series.items()
            },
        )
        for wheel in comparison.wheels
    ]
    channels = {
        name: replace(one, heldout_rmse=0.5 * one.heldout_rmse, noise=0.5 * one.noise)
        for name, one in comparison.channels.items()
    }
    return replace(comparison, wheels=wheels, channels=channels)
