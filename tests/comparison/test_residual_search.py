"""The search of the residuals: what is most of them, and what chance makes of few blocks."""

import numpy as np
import pytest

from terrain_cli.comparison import shapes
from terrain_cli.comparison.residual_scores import ResidualEvidence, Slopes
from terrain_cli.comparison.residual_search import Search

BLOCKS, LONG = 16, 50
NOISE = {"torque": 1.0}


def slow(rng):
    """Return values that last for a block."""
    return np.repeat(rng.normal(size=BLOCKS), LONG)


def search_of(residual, drivers, *, soil=None):
    n = len(residual)
    slopes = {"torque": Slopes(np.ones((n, 1)) if soil is None else soil, np.zeros((n, 0)))}
    block = np.repeat(np.arange(BLOCKS), LONG)
    group = np.zeros(n, dtype=np.intp)
    evidence = ResidualEvidence(
        residuals={"torque": residual}, slopes=slopes, drivers=drivers, group=group, block=block
    )
    every = [shape for name, values in drivers.items() for shape in shapes.of_number(name, values)]
    return Search([evidence], {"torque": every}, NOISE, precision=np.zeros((1, 1)), blocks=BLOCKS)


def searched(residual, drivers, *, soil=None):
    search = search_of(residual, drivers, soil=soil)
    return search.forward(NOISE, {"torque": len(residual)}, level=0.05, seed=1)


def test_what_is_most_of_the_residual_is_found_though_it_lasts_as_long_as_the_drive():
    rng = np.random.default_rng(1)
    rising = np.linspace(-1.0, 1.0, BLOCKS * LONG)
    # Bent a little: the scores of all blocks are what is missing, and none is chance.
    residual = 20.0 * rising + 3.0 * rising**3 + rng.normal(size=len(rising))
    first = searched(residual, {"slip": rising, "load": slow(rng)})[0]
    assert (first.term.channel, first.term.shape.driver) == ("torque", "slip")
    assert first.p_value < 0.01


def test_of_what_varied_alike_the_usual_driver_is_named():
    rng = np.random.default_rng(2)
    rising = np.linspace(-1.0, 1.0, BLOCKS * LONG)
    alike = rising + 0.15 * np.sin(9.0 * rising)
    residual = 20.0 * alike + rng.normal(size=len(rising))
    first = searched(residual, {"wheel_speed": alike, "slip": rising})[0]
    assert first.term.shape.driver == "slip"
    assert "wheel_speed" in first.alternatives


def test_the_usual_driver_is_named_though_its_shape_that_is_alike_is_not_beyond_chance():
    """Its line is alike, and its step explains as much."""
    rising = np.linspace(-1.0, 1.0, BLOCKS * LONG)
    search = search_of(rising, {"angular_velocity": rising, "slip": rising})
    speed, slip, step = (
        next(k for k, one in enumerate(search.terms) if (one.shape.driver, one.shape.name) == what)
        for what in (("angular_velocity", "linear"), ("slip", "linear"), ("slip", "step"))
    )
    count = len(search.terms)
    cross, explained = np.eye(count), np.zeros(count)
    cross[speed, slip] = cross[slip, speed] = 0.95
    explained[[speed, slip, step]] = 1.0, 0.66, 1.03
    beyond = np.isin(np.arange(count), [speed, step])
    every = np.ones(count, dtype=bool)
    assert search._usual(speed, explained, beyond, every, cross) == step
    assert search._usual(speed, explained, beyond, every, np.eye(count)) == speed


@pytest.mark.parametrize(("share", "usual"), [(0.96, True), (0.9, False)])
def test_the_usual_driver_need_not_be_beyond_chance_where_it_explains_about_as_much(share, usual):
    """Few test points: a column of which nothing is known just is, and slip just is not."""
    rising = np.linspace(-1.0, 1.0, BLOCKS * LONG)
    search = search_of(rising, {"rim_speed": rising, "slip": rising})
    speed, slip = (
        next(
            k for k, one in enumerate(search.terms) if (one.shape.driver, one.shape.name) == (what, "linear")
        )
        for what in ("rim_speed", "slip")
    )
    count = len(search.terms)
    explained = np.zeros(count)
    explained[[speed, slip]] = 1.0, share
    beyond, every = np.arange(count) == speed, np.ones(count, dtype=bool)
    assert search._usual(speed, explained, beyond, every, np.eye(count)) == (slip if usual else speed)


@pytest.mark.parametrize(("column", "named"), [("Fy_std", "slip"), ("pitch", "pitch")])
def test_a_column_of_which_nothing_is_known_gives_way_to_slip(column, named):
    rng = np.random.default_rng(4)
    rising = np.linspace(-1.0, 1.0, BLOCKS * LONG)
    both_ends = (rising**2 - np.mean(rising**2)) / np.std(rising**2)
    other = np.repeat(rng.permutation(np.linspace(-1.0, 1.0, BLOCKS)), LONG)
    other -= both_ends * np.mean(other * both_ends)
    # Slip explains three quarters of what the column does.
    together = both_ends + 0.58 * other / np.std(other)
    first = searched(20.0 * together + rng.normal(size=len(rising)), {column: together, "slip": rising})[0]
    assert first.term.shape.driver == named


@pytest.mark.parametrize("lasting", [1.0, 10.0], ids=["mixed", "lasting"])
def test_chance_that_lasts_for_a_block_is_chance(lasting):
    found = 0
    for seed in range(200):
        rng = np.random.default_rng([3, seed])
        drivers = {name: slow(rng) for name in ("slip", "load", "pitch")}
        residual = lasting * slow(rng) + rng.normal(size=BLOCKS * LONG)
        found += bool(searched(residual, drivers))
    # One in twenty, and what the bootstrap of few blocks counts too rarely.
    assert found <= 24
