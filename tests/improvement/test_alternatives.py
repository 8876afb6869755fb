"""The models between which a reader chooses: steps of the model, and what it may lack."""

from __future__ import annotations

import pytest
from changed_models import write_all

from terrain_cli import models, processes, rover, telemetry
from terrain_cli.improvement import compared
from terrain_cli.improvement.change_trial import alternatives
from terrain_cli.windows import cut_windows


@pytest.fixture(scope="module")
def sinks(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    write_all(folder)
    samples = telemetry.read(
        str(folder / "sinks.csv"), rover.load(folder / "rover.toml"), effects=[], compared=True
    )
    return [cut_windows.cut(one, "none") for one in samples]


def held_out(alternative):
    return alternative.comparison.channels["torque"].heldout_rmse


def test_a_model_that_lacks_an_effect_stands_beside_the_likeliest(sinks):
    file = models.resolve("wong-reece")
    own = compared(sinks, file)
    assert [one.label for one in alternatives(sinks, file, own, candidates=0)] == ["wong-reece"]
    first, second = alternatives(sinks, file, own, candidates=1)
    assert (first.label, first.own, first.comparison) == ("wong-reece", True, own)
    assert (second.label, second.own) == ("+ slip-sinkage", False)
    assert held_out(second) < 0.5 * held_out(first)
    assert (second.comparison.wheels[0].blocks == own.wheels[0].blocks).all()


def test_a_model_that_fits_stands_beside_its_steps_alone(sinks):
    file = models.added(models.resolve("wong-reece"), ["slip-sinkage"], 0.02).file
    base, own = alternatives(sinks, file, compared(sinks, file), candidates=3)
    assert (base.label, base.own) == ("wong-reece", False)
    assert (own.label, own.own) == ("wong-reece with slip-sinkage", True)
    assert held_out(own) < 0.5 * held_out(base)


def test_in_several_processes_they_are_the_same(sinks):
    file = models.resolve("wong-reece")
    own, told = compared(sinks, file), []
    here = alternatives(sinks, file, own, candidates=2)
    with processes.jobs(2):
        there = alternatives(sinks, file, own, candidates=2, progress=told.append)
    assert told == [one.label for one in here[1:]]
    assert [one.label for one in there] == [one.label for one in here]
    assert [held_out(one) for one in there] == [held_out(one) for one in here]
