"""The picture of what is known of c and φ together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg

import terrain_cli as terrain
from terrain_cli.estimation import fit_account
from terrain_cli.estimation.estimators import estimate_lines
from terrain_cli.presentation import segment_table
from terrain_cli.run.one_log import Outcome
from terrain_cli.views import chart_style, plots
from terrain_cli.views.figures import soil_figures
from terrain_cli.windows import cut_windows

SAMPLE = Path(__file__).parents[2] / "sample_data"


@pytest.fixture(scope="module")
def wheel():
    """Return the table and the joint posteriors of fourteen segments of a wheel."""
    samples, _ = terrain.read(SAMPLE / "run.csv", SAMPLE / "rover.toml")
    windows = cut_windows.cut(samples, "fixed", window_samples=40)
    estimates = estimate_lines(windows)
    joint = fit_account.of_line(estimates, range(14))
    table = segment_table.table(windows, estimates)
    short = {name: values[:14] for name, values in table.items()}
    return short, segment_table.posterior_table(windows, estimates, joint)


def drawn(figure):
    with style.context(chart_style.STYLE):
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def test_a_panel_for_each_segment_and_no_more_than_can_be_read(wheel):
    table, posterior = wheel
    figure = soil_figures.valleys(posterior, table)
    assert np.ptp(drawn(figure)) > 100
    assert len(figure.axes) == 12
    assert figure.get_suptitle().endswith(f": 12 of {len(set(posterior['segment']))} segments")
    for axes in figure.axes:
        # The estimate is in sight.
        (point,) = (line for line in axes.lines if line.get_marker() == "o")
        (low, high), (down, up) = axes.get_xlim(), axes.get_ylim()
        assert low < point.get_xdata()[0] < high
        assert down < point.get_ydata()[0] < up


def test_a_prior_is_drawn_where_it_matters(wheel):
    table, posterior = wheel
    known = np.asarray(posterior["kind"]) == "parameter"
    prior = {**posterior, "prior": posterior["value"], "prior_sd": np.where(known, posterior["se"], np.nan)}
    for shown, said in ((posterior, False), (prior, True)):
        entries = {text.get_text() for text in soil_figures.valleys(shown, table).legends[0].get_texts()}
        assert ("68 % of the prior" in entries) == said


def test_the_legend_of_one_segment_fits_and_its_stress_is_not_that_of_the_table(wheel):
    table, posterior = wheel
    rows = np.flatnonzero(np.asarray(posterior["segment"]) == 1)
    one = {name: np.asarray(values)[rows] for name, values in posterior.items()}
    with style.context(chart_style.STYLE):
        figure = soil_figures.valleys({**one, "prior": one["value"], "prior_sd": one["se"]}, table)
        FigureCanvasAgg(figure).draw()
        legend = figure.legends[0].get_window_extent()
    assert len(figure.axes) == 1
    assert 0.0 <= legend.x0 < legend.x1 <= figure.bbox.x1
    assert "σ*" not in figure.axes[0].get_title(loc="left") + figure.axes[0].get_title()


def test_no_grid_no_picture(wheel):
    table, posterior = wheel
    rows = [j for j, kind in enumerate(posterior["kind"]) if kind == "parameter"]
    assert (
        soil_figures.valleys({name: [values[j] for j in rows] for name, values in posterior.items()}, table)
        is None
    )


def test_a_picture_for_each_wheel(wheel, tmp_path):
    table, every = wheel
    few = np.flatnonzero(np.asarray(every["segment"]) <= 2)
    posterior = {name: [values[j] for j in few] for name, values in every.items()}
    other = {**posterior, "wheel": ["../x"] * len(posterior["wheel"])}
    beside = {**table, "wheel": ["../x"] * len(table["wheel"])}
    outcomes = [
        Outcome(table=one, account={}, posterior=[part])
        for one, part in ((table, posterior), (beside, other), (beside, {n: [] for n in posterior}))
    ]
    written = {path.name for path in plots.write(outcomes, tmp_path)}
    assert {f"valley-1-{table['wheel'][0]}.png", "valley-2-_x.svg"} <= written
    assert not any(name.startswith("valley-3") for name in written)
