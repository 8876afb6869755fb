"""The ladder of errors: its table, its axis, and where there is nothing to show."""

from __future__ import annotations

import math

import pytest

from terrain_cli.improvement.model_history import rungs
from terrain_cli.presentation import change_text
from terrain_cli.views import chart_style, report
from terrain_cli.views.figures import model_figures

ENTRY = {
    "action": "add",
    "changed": ["slip-sinkage"],
    "because": "it pays",
    "data": {"sources": ["run.csv"], "samples": 800},
    "channels": {
        "sinkage": {
            "unit": "m",
            "heldout_before": 0.006,
            "heldout_before_interval": [0.005, 0.9],
            "heldout_after": 0.002,
            "heldout_after_interval": [0.0015, 0.0025],
            "noise": 0.001,
        }
    },
}


def test_lengths_are_shown_in_mm():
    head, rows = change_text.ladder(rungs([ENTRY]))
    assert len(head) == len(rows[0])
    assert rows == [
        ["1", "+ slip-sinkage", "sinkage z (mm)", "6", "5 … 900", "2", "1.5 … 2.5", "1"],
    ]
    assert change_text.remarks(rungs([ENTRY])) == ["1  + slip-sinkage: 800 samples of run.csv; it pays"]


def test_a_wide_interval_does_not_hide_the_values():
    known = chart_style.measured(rungs([ENTRY]), "sinkage")
    assert chart_style.top(known) == pytest.approx(1.08 * 2.0 * 0.006)
    (axes,) = model_figures.errors(rungs([ENTRY])).axes
    assert axes.get_ylim() == (0.0, pytest.approx(1e3 * chart_style.top(known)))
    assert axes.get_ylabel() == "sinkage (mm)"


def test_picture_has_the_errors_in_their_places():
    (axes,) = model_figures.errors(rungs([ENTRY, ENTRY])).axes
    points = [tuple(line.get_xydata()[k]) for line in axes.lines[:1] for k in (0, 1)]
    # Before, of both steps: left of the middle.
    assert points == [(pytest.approx(-0.18), pytest.approx(6.0)), (pytest.approx(0.82), pytest.approx(6.0))]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["+ slip-sinkage"] * 2


def test_nothing_is_drawn_of_what_was_not_tried():
    untested = {"action": "add", "changed": ["hardpan"], "because": "no data were given", "tested": False}
    assert model_figures.errors(rungs([untested])) is None
    section = report.history([untested])
    assert [type(part) for part in section.parts] == [report.Table]
    assert not report.history([])


def test_the_page_says_what_the_picture_shows():
    section = report.history([ENTRY, {**ENTRY, "channels": {"torque": {"heldout_before": math.nan}}}])
    (chart, *_) = (part for part in section.parts if isinstance(part, report.Chart))
    assert chart.title == "Held-out error of torque"
    told = {part.title: part.alt for part in section.parts if isinstance(part, report.Chart)}
    assert told["Held-out error of sinkage"].endswith("1 change: from 6 mm to 2 mm.")
    steps = {row["step"]: row["label"] for row in chart.spec["datasets"]["data-0"]}
    assert steps == {"2": "+ slip-sinkage"}
    assert "http" not in str([part.spec for part in section.parts if isinstance(part, report.Chart)])
