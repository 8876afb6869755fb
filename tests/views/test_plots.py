"""Pictures as files."""

from __future__ import annotations

import errno
import os
import stat
import sys
from dataclasses import replace
from xml.etree import ElementTree as ET

import pytest
from matplotlib import image
from matplotlib.figure import Figure

from formats import CannotWriteError
from terrain_cli import version
from terrain_cli.errors import ConfigurationError
from terrain_cli.estimation.estimators import estimate_lines
from terrain_cli.mechanics.wheel_model import Model
from terrain_cli.presentation import segment_table
from terrain_cli.run.one_log import Outcome
from terrain_cli.views import plots, shown_segments

EXPECTED = {
    "predicted-measured": ("predicted torque T (N m)", "measured − predicted sinkage z (mm)"),
    "residual-torque": ("slip i", "measured − predicted torque T (N m)"),
    "residual-drawbar-pull": ("load W (N)", "measured − predicted drawbar pull DP (N)"),
    "residual-sinkage": ("time t (s)", "measured − predicted sinkage z (mm)"),
    "strength": ("cohesion c (kPa)", "friction angle φ (°)", "normal stress σ (kPa)"),
    "track-torque": ("x (m)", "strength at", "rms error of torque (N m)"),
    "track-drawbar-pull": ("rms error of drawbar pull (N)",),
    "track-sinkage": ("rms error of sinkage (mm)",),
    "rim-stress": ("angle from the vertical θ (°), forward positive", "stress (kPa)"),
    "convergence-1-front-left": ("cohesion c (kPa)", "sample"),
    "convergence-2-front-right": ("friction angle φ (°)", "sample"),
}


@pytest.fixture(scope="module")
def folder(comparison, tmp_path_factory):
    folder = tmp_path_factory.mktemp("plots") / "made" / "anew"
    written = plots.write(comparison, folder)
    assert sorted(written) == sorted(folder.iterdir())
    return folder


def test_every_picture_is_there(folder):
    assert {path.name for path in folder.iterdir()} == {
        f"{name}{ending}" for name in EXPECTED for ending in (".png", ".svg")
    }


@pytest.mark.parametrize("name", EXPECTED)
def test_png_shows_something(folder, name):
    pixels = image.imread(folder / f"{name}.png")
    height, width = pixels.shape[:2]
    assert 300 < height < 4000
    assert 600 < width < 4000
    inked = (pixels[..., :3] < 0.9).any(axis=2).mean()
    assert 0.005 < inked < 0.6


@pytest.mark.parametrize("name", EXPECTED)
def test_svg_has_its_text_as_text(folder, name):
    said = [
        "".join(element.itertext()).strip()
        for element in ET.parse(folder / f"{name}.svg").iter("{http://www.w3.org/2000/svg}text")  # noqa: S314
    ]
    for expected in EXPECTED[name]:
        assert any(text.startswith(expected) for text in said), expected


def test_same_data_same_files(comparison, folder, tmp_path, monkeypatch):
    from terrain_cli.views.figures import model_figures

    def one(shown):
        yield "predicted-measured", lambda: model_figures.predicted_measured(shown)

    monkeypatch.setattr(plots, "_of_comparison", one)
    for path in plots.write(comparison, tmp_path):
        assert path.read_bytes() == (folder / path.name).read_bytes()


def drawn(found):
    """Return the names of the pictures that there are; `test_names_of_wheels_make_no_paths` writes some."""
    return {name for name, draw in plots._drawings(found) if draw() is not None}


def test_estimates(comparison):
    outcomes = [
        Outcome(
            table=segment_table.table(wheel.windows, estimate_lines(wheel.windows)),
            account={},
            trace=[segment_table.trace(wheel.windows)],
        )
        for wheel in comparison.wheels
    ]
    found = drawn(outcomes)
    assert {"strength", "track", "convergence-1-front-left"} <= found
    # Some forty segments cannot be told apart.
    assert "convergence-of-all" not in found
    for outcome in outcomes:
        (trace,) = outcome.trace
        outcome.trace[0] = {name: values[:50] for name, values in trace.items()}
    assert "convergence-of-all" in drawn(outcomes)
    # Without the recursive estimate there is nothing that converges.
    assert drawn([Outcome(table=outcomes[0].table, account={})]) == {"strength", "track"}


def test_names_of_wheels_make_no_paths(comparison, tmp_path):
    wheel = comparison.wheels[0]
    table = segment_table.table(wheel.windows, estimate_lines(wheel.windows))
    trace = segment_table.trace(wheel.windows)
    trace["wheel"] = ["../../etc/<x>"] * len(trace["wheel"])
    written = plots.write([Outcome(table=table, account={}, trace=[trace, trace])], tmp_path / "here")
    assert {path.parent for path in written} == {tmp_path / "here"}
    assert (tmp_path / "here" / "convergence-1-_etc_x_.png").exists()


def test_linear_base_has_no_rim(comparison):
    linear = replace(comparison, wheels=[replace(w, model=Model("linear")) for w in comparison.wheels])
    assert shown_segments.moments(linear) == []


def test_full_disk_leaves_the_old_picture(comparison, tmp_path, monkeypatch):
    old = tmp_path / "predicted-measured.png"
    old.write_text("old")

    def full(figure, path, **_):
        with open(path, "wb") as file:  # noqa: PTH123
            file.write(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Figure, "savefig", full)
    with pytest.raises(CannotWriteError, match="no space left"):
        plots.write(comparison, tmp_path)
    assert old.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == [old.name]


def test_place_that_is_no_folder(comparison, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CannotWriteError):
        plots.write(comparison, tmp_path / "file")


def test_modes_are_those_of_any_new_file(folder):
    mask = os.umask(0)
    os.umask(mask)
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o666 & ~mask for path in folder.iterdir())


def test_missing_extra_says_what_to_install(comparison, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(ConfigurationError, match="matplotlib") as error:
        plots.write(comparison, tmp_path / "none")
    assert error.value.hint == version.command_for("plot")
    assert not (tmp_path / "none").exists()


def test_nothing_is_left_open(folder):
    from matplotlib import pyplot as plt

    assert plt.get_fignums() == []
