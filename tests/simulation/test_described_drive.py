"""An effect at random: one that shows, and the same for the same seed."""

from __future__ import annotations

import pytest

from terrain_cli import effects
from terrain_cli.simulation import draw, read, simulate

MIXED = {"drive": ["mixed"], "duration": 20.0, "noise": "3%"}


def hidden(seed, **options):
    scenario = draw(read(None, {**MIXED, "seed": seed, **options}))
    return scenario.effects[-1]


def test_same_seed_same_effect():
    first, again = hidden(7), hidden(7)
    assert (first.effect.id, first.values) == (again.effect.id, again.values)
    assert first.hidden


def test_many_seeds_many_effects():
    names = {hidden(seed).effect.id for seed in range(30)}
    assert len(names) > 8
    assert names <= set(effects.NAMES)


@pytest.mark.parametrize("seed", range(6))
def test_values_are_possible(seed):
    chosen = hidden(seed)
    for parameter in chosen.effect.parameters:
        assert parameter.lower <= chosen.values[parameter.name] <= parameter.upper


def test_what_a_drive_cannot_show_is_not_drawn():
    flat = {"drive": ["slip-sweep"]}
    names = {hidden(seed, **flat).effect.id for seed in range(30)}
    assert not names & {"slope", "side-slip", "multi-pass"}


def test_is_not_what_is_there_already():
    name = hidden(3).effect.id
    with_it = draw(read(None, {**MIXED, "seed": 3, "effects": {name: {}}}))
    assert [chosen.hidden for chosen in with_it.effects] == [False, True]
    assert with_it.effects[1].effect.id != name


def test_noise_is_the_same_with_and_without():
    plain = read(None, {**MIXED, "seed": 1, "noise": {"pitch": 0.01}})
    log, riddle = simulate(plain), simulate(draw(plain))
    assert log.wheels["wheel"].keys() == riddle.wheels["wheel"].keys()
    assert log.wheels["wheel"]["pitch"].values.tolist() == riddle.wheels["wheel"]["pitch"].values.tolist()
