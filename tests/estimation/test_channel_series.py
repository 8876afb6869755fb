"""What channels say of their noise: inputs that only seem to vary, spikes, and how large it can be."""

import numpy as np
import pytest
from simulator import (
    SANDY_LOAM,
    UPLAND_SANDY_LOAM,
    Drive,
    Sensor,
    Track,
    Wheel,
    base_contact,
    constant,
    scatter,
    simulate,
    steps,
    undulation,
)

from terrain_cli.estimation.wheel_fit import fit
from terrain_cli.estimation.wheel_fit.channel_series import LargestNoise, spikes, steadied
from terrain_cli.estimation.wheel_fit.fit_data import collect
from terrain_cli.mechanics.wheel_model import Model, WheelGeometry

WHEEL = Wheel(radius=0.125, width=0.1)
CHANNELS = ("load", "torque", "sinkage", "slip", "drawbar_pull")
GEOMETRY = WheelGeometry(WHEEL.radius, WHEEL.width)
SECONDS, NOISE, RATE = 60.0, 0.03, 10.0


def driven(soil, load, slip, seed=3):
    noisy = Sensor(relative=NOISE)
    drive = Drive(
        [Track("wheel", [(base_contact(soil), SECONDS)], load, slip)],
        WHEEL,
        constant(0.1),
        rate=RATE,
        sensors={**dict.fromkeys(CHANNELS[:4], noisy), "drawbar_pull": Sensor(absolute=10.0 * NOISE)},
        channels=(*CHANNELS, "angular_velocity", "velocity"),
        seed=seed,
    )
    columns = simulate(drive).wheels["wheel"].aligned()
    return {name: columns[name] for name in CHANNELS}


def held(channels):
    """Return the inputs that are held at their means."""
    data = collect(Model(), channels, [0, len(channels["slip"])], "sinkage")
    found = steadied(data, RATE)
    constant = np.ptp(found.given, axis=1) < 1e-12
    np.testing.assert_array_equal(found.steady[:, 0], constant)
    return {name for name, still in zip(found.inputs, constant, strict=True) if still}


ROUGH = undulation(80.0, 0.2, 7.0, 1)


@pytest.mark.parametrize("load", [ROUGH, constant(80.0)], ids=["rough", "constant"])
def test_what_only_seems_to_vary_is_held(load):
    steady = set() if load is ROUGH else {"load"}
    assert held(driven(UPLAND_SANDY_LOAM, load, constant(0.2))) == {"slip", *steady}
    assert held(driven(UPLAND_SANDY_LOAM, load, undulation(0.3, 0.5, 9.0, 2))) == steady
    # From sample to sample, as noise does; but the torque follows it.
    assert held(driven(UPLAND_SANDY_LOAM, load, scatter(0.2, 0.1, 0.1, seed=4))) == steady


def test_a_slip_that_steps_with_the_load_is_not_held():
    """By a twentieth: what it varies is within its noise, and sinkage and load step together."""
    low, high = [(size, 20.0) for size in (70.0, 0.21)], [(size, 40.0) for size in (110.0, 0.2)]
    load, slip = (steps([first, then]) for first, then in zip(low, high, strict=True))
    assert held(driven(UPLAND_SANDY_LOAM, load, slip)) == set()


def test_so_it_is_where_the_noise_lasts():
    channels, size = driven(UPLAND_SANDY_LOAM, ROUGH, constant(0.2)), round(SECONDS * RATE)
    series = [remembering(np.random.default_rng(seed).standard_normal(size), 0.5) for seed in range(8)]
    found = [held({**channels, "slip": 0.2 * (1.0 + NOISE * one)}) for one in series]
    # Now and then sinkage or torque seems to follow it.
    assert found.count({"slip"}) >= 7


def test_and_where_torque_and_slip_drift():
    """Two drifts seem to follow one another: slip was free, k 3 mm for 7, and c 6 standard errors too low."""
    channels, size = driven(UPLAND_SANDY_LOAM, ROUGH, constant(0.2)), round(SECONDS * RATE)
    found = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        slip, torque = (remembering(rng.standard_normal(size), np.exp(-3.0 / size)) for _ in range(2))
        drifting = {**channels, "torque": channels["torque"] * (1.0 + 0.7 * NOISE * torque)}
        drifting["slip"] = channels["slip"] * (1.0 + 0.7 * NOISE * slip)
        found.append(held(drifting))
    assert found.count({"slip"}) >= 7


@pytest.mark.parametrize("load", [ROUGH, constant(80.0)], ids=["rough", "constant"])
@pytest.mark.parametrize("soil", [UPLAND_SANDY_LOAM, SANDY_LOAM], ids=lambda soil: soil.name)
@pytest.mark.parametrize("slip", [0.1, 0.25])
def test_one_slip_does_not_tell_the_shear_modulus(soil, slip, load):
    """Noise of the slip that the torque does not follow made k 5 mm and c 0.2 kPa, with small errors."""
    channels = driven(soil, load, constant(slip))
    found = fit(Model(), GEOMETRY, channels, [0, len(channels["slip"])])
    within(found, soil)
    k = found.values["shear_modulus"][0]
    assert found.errors["shear_modulus"][0] > 0.3 * k


def within(found, soil):
    true = {"cohesion": soil.cohesion, "tan_phi": np.tan(soil.friction_angle)}
    for name, value in true.items():
        assert abs(found.values[name][0] - value) < 3.0 * found.errors[name][0], name


def test_noise_of_a_slip_that_hardly_varies_is_not_made_of_the_torque():
    """Without a pull the slip was learnt to have 1.7 times its noise, and the torque 0.6 times."""
    ratio = {"slip": [], "torque": []}
    for seed in range(3, 8):
        channels = driven(UPLAND_SANDY_LOAM, ROUGH, undulation(0.15, 0.13, 9.0, seed), seed)
        channels.pop("drawbar_pull")
        found = fit(Model(), GEOMETRY, channels, [0, len(channels["slip"])], second=RATE)
        for name, of in ratio.items():
            learnt = found.noise.variance(name, channels[name]).mean()
            of.append(np.sqrt(learnt / np.mean(channels[name] ** 2)) / NOISE)
    for name, of in ratio.items():
        assert 0.85 < np.mean(of) < 1.15, name


def test_spikes_of_an_input_are_left_out():
    """A slip of 0.8 among those of 0.2 with the torque of these made k small, and φ with it."""
    channels = driven(UPLAND_SANDY_LOAM, ROUGH, undulation(0.2, 0.3, 9.0, 2))
    n = len(channels["slip"])
    clean = collect(Model(), channels, [0, n], "sinkage")
    assert not spikes(clean).any()
    at = np.array([1, 40, 42, 200, n - 2])
    channels["slip"][at] = 0.8
    data = collect(Model(), channels, [0, n], "sinkage")
    np.testing.assert_array_equal(np.flatnonzero(spikes(data)), at)
    within(fit(Model(), GEOMETRY, channels, [0, n], second=RATE), UPLAND_SANDY_LOAM)
    # Steps are none.
    channels["slip"][:] = np.where(np.arange(n) < n // 2, 0.1, 0.5) + clean.channels["slip"] - 0.2
    data = collect(Model(), channels, [0, n], "sinkage")
    assert not spikes(data).any()


@pytest.mark.parametrize("lasting", [0.0, 0.1, 0.3])
def test_noise_is_at_most_what_neighbours_differ_by(lasting):
    """Whether it lasts or not, beside a slow change many times as large."""
    n, noise = 3000, 0.02
    rho = np.exp(-1.0 / (lasting * RATE)) if lasting else 0.0
    series = remembering(np.random.default_rng(7).standard_normal(n), rho)
    slow = 0.1 * np.sin(2.0 * np.pi * np.arange(n) / (20.0 * RATE))
    channels = dict.fromkeys(("load", "torque", "sinkage"), np.ones(n))
    channels["slip"] = 0.3 + slow + noise * series
    data = collect(Model(), channels, [0, n // 2, n], "sinkage")
    largest = LargestNoise.of(channels["slip"], data, np.zeros(2, dtype=bool), RATE)
    np.testing.assert_allclose(np.sqrt(largest.variance), noise, rtol=0.15)


def remembering(series, rho):
    for step in range(1, len(series)):
        series[step] = rho * series[step - 1] + np.sqrt(1.0 - rho**2) * series[step]
    return series
