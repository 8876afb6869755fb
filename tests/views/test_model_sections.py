"""The section in which a reader chooses a model."""

from __future__ import annotations

import numpy as np
import pytest
from compared import halved

from terrain_cli.improvement.change_trial import Alternative
from terrain_cli.views.report import model_sections, page
from terrain_cli.views.report.page_parts import Chart, Table


@pytest.fixture(scope="module")
def choices(comparison):
    return [Alternative("wong-reece", comparison, own=True), Alternative("+ grousers", halved(comparison))]


def test_there_is_nothing_to_choose_of_one_model(choices):
    assert not model_sections.section(choices[:1])


def test_control_offers_the_models_and_marks_that_of_the_page(comparison, choices):
    text = page(comparison, models=choices[::-1])
    # No history, no section.
    assert "How the model came about" not in text
    form = text.partition('<select id="model"')[2]
    control = form.partition("</select>")[0]
    assert '<option value="0">+ grousers</option>' in control
    assert '<option value="1" selected>wong-reece (this page)</option>' in control


def test_table_has_the_error_of_each_model_over_its_own_noise(comparison, choices):
    table = model_sections.section(choices).parts[0]
    assert isinstance(table, Table)
    own, other = table.rows
    assert (own[0], other[0]) == ("wong-reece (this page)", "+ grousers")
    error = comparison.channels["torque"].heldout_rmse
    assert float(own[1]) == pytest.approx(error, rel=0.01)
    assert float(other[1]) == pytest.approx(0.5 * error, rel=0.01)
    assert own[2] == other[2]


def test_pictures_hold_the_misfit_of_each_model(choices):
    charts = [part for part in model_sections.section(choices).parts if isinstance(part, Chart)]
    chart = next(one for one in charts if one.title.startswith("Residual of torque against slip"))
    (param,) = (one for one in chart.spec["params"] if one["name"] == "model")
    assert (param["value"], param["bind"]["element"]) == ("0", "#model")
    medians = {
        key: np.array([row["median"] for row in chart.spec["datasets"]["data-0"] if row["k"] == key], float)
        for key in ("0", "1")
    }
    np.testing.assert_allclose(medians["1"], 0.5 * medians["0"], atol=1e-4)
    assert np.nanmax(np.abs(medians["0"])) > 0.3


def test_long_names_of_models_are_told_apart_and_their_axis_fits(comparison):
    ends = ("drivetrain-friction", "gear-efficiency")
    begins = "wong-reece with torque-with-angular-velocity-quadratic and"
    models = [Alternative(f"{begins} {end}", comparison, own=end == ends[0]) for end in ends]
    charts = [part for part in model_sections.section(models).parts if isinstance(part, Chart)]
    chart = next(one for one in charts if one.title.startswith("Held-out error of drawbar pull"))
    for row, end in zip(chart.spec["datasets"]["data-0"], ends, strict=True):
        assert max(map(len, row["label"].splitlines())) < 30
        assert row["label"].replace("\n", " ").replace("- ", "-").endswith(f"and {end}")
    point = chart.spec["layer"][-1]["encoding"]
    assert point["x"]["title"] == "held-out (N)"
    assert "split" in point["y"]["axis"]["labelExpr"]
