"""Figures: what stands on their axes, and that they draw whatever the data are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from compared import ABOVE, EXCESS, comparison_of, drive
from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from simulator.run import simulate

from terrain_cli.presentation import segment_table
from terrain_cli.views import chart_style, shown_samples, shown_segments
from terrain_cli.views.figures import drive_figures, model_figures, soil_figures

pytestmark = pytest.mark.filterwarnings("ignore:Glyph .* missing from:UserWarning")


@pytest.fixture(autouse=True)
def _style():
    with style.context(chart_style.STYLE):
        yield


def drawn(figure):
    """Draw a figure, and return its pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[..., :3]
    assert np.ptp(pixels) > 100
    return pixels


def labels(figure):
    return {(axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes}


def texts(figure):
    from matplotlib.text import Text

    return " ".join(text.get_text() for text in figure.findobj(Text))


def test_measured_less_predicted_over_the_predicted(comparison):
    figure = model_figures.predicted_measured(comparison)
    drawn(figure)
    assert labels(figure) == {
        ("predicted torque T (N m)", "measured − predicted torque T (N m)"),
        ("predicted drawbar pull DP (N)", "measured − predicted drawbar pull DP (N)"),
        ("predicted sinkage z (mm)", "measured − predicted sinkage z (mm)"),
    }
    assert {"front-left", "front-right", "median", "5 to 95 %", "± 1.96 × noise"} <= {
        text.get_text() for text in figure.legends[0].get_texts()
    }
    # Sinkages are some centimetres: shown in mm.
    assert 5.0 < figure.axes[2].get_xlim()[1] < 100.0


def test_median_lies_over_the_points_in_a_colour_of_its_own(comparison):
    figure = model_figures.predicted_measured(comparison)
    for axes, name in zip(figure.axes, shown_samples.channels(comparison), strict=True):
        *others, median = axes.lines
        assert median.get_label() in ("median", "_median")
        assert median.get_color() not in {line.get_color() for line in others}
        pooled = shown_samples.pairs(comparison, name)
        band = shown_samples.band(pooled.predicted, pooled.residual)
        np.testing.assert_array_equal(median.get_xydata().T, [band.centre, band.median])


@pytest.fixture
def many():
    return comparison_of(simulate(drive(seconds=60.0, rate=30.0)))


def test_many_samples_are_counted(many):
    figure = model_figures.predicted_measured(many)
    drawn(figure)
    assert [axes.get_xlabel() for axes in figure.axes].count("samples") == 3
    assert "\\mathdefault" not in texts(figure)
    counts = figure.axes[0].collections[0].get_array()
    # All but the rarest, which would leave the rest a line.
    assert counts.sum() == pytest.approx(0.998 * sum(len(wheel.windows.rows) for wheel in many.wheels), abs=2)


def test_residual_against_its_drivers(comparison):
    figure = model_figures.residuals(comparison, "torque")
    drawn(figure)
    # That of the finding first; what does not vary drives nothing.
    assert [axes.get_xlabel() for axes in figure.axes] == [
        *("slip i", "load W (N)", "sinkage z (mm)", "pitch (°)", "terrain", "time t (s)", "bus_voltage"),
    ]
    assert "measured − predicted torque T (N m)" in texts(figure)
    assert {"median", "5 to 95 %", "± 1.96 × noise"} <= {
        text.get_text() for text in figure.legends[0].get_texts()
    }
    slip, median = figure.axes[0].lines[-1].get_xydata().T
    assert np.median(median[slip > ABOVE + 0.02]) == pytest.approx(EXCESS, abs=0.1)
    assert np.median(median[slip < ABOVE - 0.02]) == pytest.approx(0.0, abs=0.1)


def test_residual_of_many_samples(many):
    figure = model_figures.residuals(many, "drawbar_pull")
    drawn(figure)
    assert all(axes.collections[0].get_array() is not None for axes in figure.axes)


def test_strength(comparison):
    table = shown_segments.soil_table(comparison)
    figure = soil_figures.strength(table)
    drawn(figure)
    assert labels(figure) == {
        ("cohesion c (kPa)", "friction angle φ (°)"),
        ("normal stress σ (kPa)", "shear strength c + σ tan φ (kPa)"),
    }
    assert {"dry sand", "sandy loam"} <= {text.get_text() for text in figure.legends[0].get_texts()}
    assert figure.axes[0].patches
    n = len(table["wheel"])
    alike = {"terrain": [""] * n, "wheel": ["wheel"] * n, "status": ["ok"] * n}
    assert not soil_figures.strength({**table, **alike}).legends


def test_a_region_wider_than_the_axes_is_told_of(comparison):
    table = shown_segments.soil_table(comparison)
    rows = len(table["status"])
    for name, error in (("c_se_kPa", 0.1), ("phi_se_deg", 1.0), ("corr_c_phi", 0.0)):
        table[name] = np.full(rows, error)
    table["status"] = ["ok"] * rows
    assert "outside the picture" not in soil_figures.strength(table).axes[0].get_title(loc="left")
    # The axes are those of what is sure.
    table["status"][-1], table["c_se_kPa"][-1], table["phi_se_deg"][-1] = "not-separable", 1e4, 1e4
    assert "(1 outside the picture)" in soil_figures.strength(table).axes[0].get_title(loc="left")


def test_track(comparison):
    misfit = shown_samples.misfit(comparison, "torque")
    table = shown_segments.soil_table(comparison)
    figure = soil_figures.track(table, {"rms error of torque (N m)": misfit})
    drawn(figure)
    said = texts(figure)
    strength = f"strength at {table['stress_kPa'][0]:g} kPa (kPa)"
    for text in ("x (m)", "y (m)", strength, "rms error of torque (N m)", "front-left"):
        assert text in said
    maps = [axes for axes in figure.axes if axes.get_aspect() == 1.0]
    assert len(maps) == 4
    drawn_misfit = maps[1].collections[0].get_array()
    np.testing.assert_allclose(drawn_misfit, misfit[: len(drawn_misfit)])


def test_misfit_of_a_segment_is_the_rms_of_its_residual(comparison):
    wheel = comparison.wheels[1]
    n = len(comparison.wheels[0].windows)
    here = slice(*wheel.windows.bounds[2:4])
    series = wheel.series["sinkage"]
    expected = 1e3 * np.sqrt(np.mean((series.measured[here] - series.predicted[here]) ** 2))
    assert shown_samples.misfit(comparison, "sinkage")[n + 2] == pytest.approx(expected)


def test_no_track_without_places(comparison):
    table = {**shown_segments.soil_table(comparison)}
    table["WKT"] = [""] * len(table["WKT"])
    assert soil_figures.track(table, {}) is None


def test_track_of_places_that_do_not_move(comparison):
    table = {**shown_segments.soil_table(comparison)}
    table["WKT"] = [f"POINT ({j} 0.0)" for j in range(len(table["WKT"]))]
    drawn(soil_figures.track(table, {}))


def test_convergence(comparison):
    trace = segment_table.trace(comparison.wheels[0].windows)
    figure = drive_figures.convergence(trace)
    # Its end is not the c of the full model, which stands in the other pictures.
    told = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert told == ["± 1.96 s.e.", "recursive estimate of the line"]
    drawn(figure)
    assert [axes.get_ylabel() for axes in figure.axes] == ["cohesion c (kPa)", "friction angle φ (°)"]
    assert figure.axes[1].get_xlabel() == "sample"
    assert "± 1.96 s.e." in texts(figure)
    x, phi = figure.axes[1].lines[0].get_xydata().T
    assert phi[-1] == pytest.approx(trace["phi_deg"][int(x[-1]) - 1])


def first_segments(wheel, most, **columns):
    """Return the trace of the first segments of a wheel, with other columns put in their place."""
    trace = segment_table.trace(wheel.windows)
    here = np.asarray(trace["segment"]) <= most
    own = {name: np.full(here.sum(), value) for name, value in columns.items()}
    return {name: np.asarray(values)[here] for name, values in trace.items()} | own


def named(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_convergence_of_all(comparison):
    traces = [first_segments(wheel, 2) for wheel in comparison.wheels]
    figure = drive_figures.convergence_of_all(traces)
    drawn(figure)
    assert [axes.get_ylabel() for axes in figure.axes] == ["cohesion c (kPa)", "friction angle φ (°)"]
    assert named(figure) == [
        "front-left segment 1",
        "front-left segment 2",
        "front-right segment 1",
        "front-right segment 2",
    ]
    # The last line begins with the first sample of its segment, and ends in sight.
    (line,) = (line for line in figure.axes[1].get_lines() if line.get_label() == "front-right segment 2")
    x, phi = line.get_xydata().T
    assert x[0] == 1
    assert len(x) == np.count_nonzero(traces[1]["segment"] == 2)
    assert phi[-1] == pytest.approx(traces[1]["phi_deg"][-1])
    low, high = figure.axes[1].get_ylim()
    assert low < phi[-1] < high


def test_convergence_of_logs_is_named_after_them(comparison):
    logs = ["sand.csv", "clay.csv", "loam.csv", "snow.csv"]
    figure = drive_figures.convergence_of_all(
        [first_segments(comparison.wheels[0], 1, source=log) for log in logs],
    )
    drawn(figure)
    assert named(figure) == logs


def test_convergence_of_what_is_not_told(comparison):
    wheel = comparison.wheels[0]
    nothing = dict.fromkeys(("c_kPa", "c_se_kPa", "phi_deg", "phi_se_deg"), np.nan)
    drawn(drive_figures.convergence_of_all([first_segments(wheel, 1), first_segments(wheel, 1, **nothing)]))


def test_one_segment_or_too_many_are_not_drawn_over_one_another(comparison):
    one = first_segments(comparison.wheels[0], 1)
    for traces in ([], [one], [one] * 8):
        assert drive_figures.convergence_of_all(traces) is None


def test_rim_stress(comparison):
    figure = soil_figures.rim_stress(shown_segments.moments(comparison))
    drawn(figure)
    assert labels(figure) == {("angle from the vertical θ (°), forward positive", "stress (kPa)")}
    angle, normal = figure.axes[0].lines[1].get_xydata().T
    assert angle[0] == pytest.approx(0.0, abs=1.0)
    # θm = θ1/2 without effects.
    assert angle[np.argmax(normal)] == pytest.approx(angle[-1] / 2.0, rel=0.05)


def test_rim_stress_names_the_log_of_several(comparison):
    wheel = comparison.wheels[0]
    two = replace(comparison, wheels=[replace(wheel, source=f"{soil}.csv") for soil in ("sand", "clay")])
    figure = soil_figures.rim_stress(shown_segments.moments(two))
    drawn(figure)
    assert [axes.get_title("left").splitlines()[0] for axes in figure.axes] == ["sand.csv", "clay.csv"]
    assert "run.csv" not in texts(soil_figures.rim_stress(shown_segments.moments(comparison)))


@pytest.mark.parametrize("name", ["$x^2$ <script> {} %s \\alpha", "a\nb 速度"])
def test_names_from_files_are_drawn_as_they_are(run, name):
    odd = comparison_of(run, source=f"{name}.csv", extra=name)
    odd.wheels[0] = replace(odd.wheels[0], wheel=name)
    drawn(model_figures.predicted_measured(odd))
    figure = model_figures.residuals(odd, "torque")
    drawn(figure)
    assert name in [axes.get_xlabel() for axes in figure.axes]
    table = {**shown_segments.soil_table(odd)}
    table["terrain"] = [name, *table["terrain"][1:]]
    drawn(soil_figures.strength(table))


def test_estimates_without_errors(comparison):
    table = {**shown_segments.soil_table(comparison)}
    nothing = np.full(len(table["segment"]), np.nan)
    for names in (
        ("c_se_kPa", "phi_se_deg", "corr_c_phi"),
        ("c_kPa", "phi_deg"),
        ("strength_kPa", "sigma_star_kPa"),
    ):
        table = {**table, **dict.fromkeys(names, nothing)}
        drawn(soil_figures.strength(table))


def test_channel_that_is_measured_on_one_wheel_only(run):
    partial = comparison_of(run)
    wheel = partial.wheels[1]
    del wheel.series["drawbar_pull"], wheel.drivers["pitch"]
    series = wheel.series["torque"]
    wheel.series["torque"] = replace(series, measured=np.full(len(series.measured), np.nan))
    drawn(model_figures.predicted_measured(partial))
    drawn(model_figures.residuals(partial, "drawbar_pull"))
    misfit = shown_samples.misfit(partial, "torque")
    assert np.isfinite(misfit[: len(partial.wheels[0].windows)]).all()
    assert np.isnan(misfit[len(partial.wheels[0].windows) :]).all()
