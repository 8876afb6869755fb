"""Effects with a parameter that only shapes them: found in whichever shape nature has."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_drives import Kind, Rover, sized, windows_of
from simulator import DRY_SAND, SOILS, Wheel

from terrain_cli import effects
from terrain_cli.diagnosis import diagnose
from terrain_cli.effects import catalogue
from terrain_cli.improvement.change_trial import compared
from terrain_cli.models import ModelFile, added
from terrain_cli.windows.joined_inputs import by_wheel

SEED = 42000011


@pytest.mark.parametrize("form", ["catalogue", "other"])
def test_slip_sinkage_is_named_whatever_power_of_slip_it_follows(form):
    among = [effects.find(name) for name in ("slip-sinkage", "max-stress-angle", "sinkage-bias")]
    drive = windows_of(SEED, Kind(sized("slip-sinkage", form=form), seconds=64.0))
    found = diagnose(drive, ModelFile(), effects=among)
    assert (found.verdict, found.effect) == ("effect", "slip-sinkage")
    bend = found.candidates[0].sizes["bend"]
    if form == "catalogue":
        assert abs(bend.value) < 3.0 * bend.se
    else:
        assert bend.value > 3.0 * bend.se


@pytest.mark.parametrize("form", ["catalogue", "other"])
def test_passes_are_named_whatever_share_the_first_one_does(form):
    among = [effects.find(name) for name in ("multi-pass", "slip-sinkage", "load-bias")]
    drive = windows_of(SEED, Kind(sized("multi-pass", form=form)))
    found = diagnose(drive, ModelFile(), effects=among)
    assert (found.verdict, found.effect) == ("effect", "multi-pass")
    further = found.candidates[0].sizes["further"]
    if form == "catalogue":
        assert abs(further.value) < 3.0 * further.se
    else:
        # The first pass does all of it: 37 % less for each further one.
        assert further.value < -0.25


def test_a_firm_layer_is_found_under_a_larger_wheel():
    rover = Rover(wheel=Wheel(radius=0.2, width=0.15), load=260.0, speed=0.1, soils=(DRY_SAND, DRY_SAND))
    drive = windows_of(SEED, Kind(sized("hardpan", 2.0, rover=rover), share=0.01, rover=rover))
    among = [effects.find(name) for name in ("hardpan", "slip-sinkage", "load-bias")]
    found = diagnose(drive, ModelFile(), effects=among)
    assert (found.verdict, found.effect) == ("effect", "hardpan")
    assert found.candidates[0].sizes["top"].value == pytest.approx(0.02, abs=5e-4)


def test_a_firm_layer_lowers_the_printed_error_where_the_fitted_soil_hides_it():
    # Without the layer the exponent of sinkage is 1.3 here, from which no step leads to a layer.
    soil = replace(SOILS["Rubicon sandy loam"], shear_modulus=0.03)
    rover = Rover(wheel=Wheel(radius=0.073, width=0.06), load=30.0, speed=0.03, soils=(soil, soil))
    hidden = sized("hardpan", rover=rover)
    wheels = by_wheel(windows_of(SEED, Kind(hidden, share=0.01, rover=rover), "none"), catalogue().values())
    ratios = {}
    for name, file in {"without": ModelFile(), "with": added(ModelFile(), ["hardpan"], 0.018).file}.items():
        comparison = compared(wheels, file)
        ratios[name] = comparison.channels["sinkage"].heldout_rmse / comparison.channels["sinkage"].noise
    assert ratios["without"] > 1.1
    assert ratios["with"] < 1.05


def test_shapes_are_tried_within_what_the_drive_reaches():
    top = next(p for p in effects.find("hardpan").parameters if p.name == "top")
    shallow = top.tried([{"sinkage": np.linspace(0.002, 0.01, 50)}, {"sinkage": np.array([np.nan, 0.01])}])
    assert len(shallow) == 4
    assert 0.001 < shallow[0] < shallow[-1] < 0.0075
    assert top.tried([{"load": np.ones(3)}]) == pytest.approx((0.003, 0.01, 0.03))
    bend = next(p for p in effects.find("slip-sinkage").parameters if p.name == "bend")
    assert bend.tried([{"sinkage": np.ones(3)}]) == (0.0,)
