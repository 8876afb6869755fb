"""The page as text: what it says, that it holds everything, and that nothing from a file is HTML in it."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser

import altair as alt
import jsonschema
import numpy as np
import pytest
from compared import comparison_of, drive
from simulator.run import simulate

from formats import CannotWriteError
from terrain_cli import version
from terrain_cli.errors import ConfigurationError
from terrain_cli.presentation import comparison_text
from terrain_cli.views import report, shown_segments
from terrain_cli.views.report import Section, Table, drive_charts, page
from terrain_cli.vocabulary.next_commands import Asked

HOSTILE = "<script>alert('1')</script>\"&{{ 7 * 7 }}</textarea>"
VOID = {"meta", "link", "br"}


class Outline(HTMLParser):
    """Elements of a page, and the text of each kind."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.open, self.texts = [], [], {}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data.strip())

    def all(self, tag):
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def text(comparison):
    return page(comparison)


@pytest.fixture(scope="module")
def outline(text):
    return Outline(text)


def specs(text):
    return json.loads(re.search(r"^const specs = (.*);$", text, re.MULTILINE)[1])


def test_elements_are_closed(outline):
    assert outline.open == []


def test_headings_are_those_of_the_contract(outline):
    assert outline.texts["h1"] == ["Wheel and soil: run.csv"]
    assert outline.texts["h2"] == ["Summary", "Soil", "Measured and predicted", "Where it fails"]


def test_links_of_the_page_lead_somewhere(outline):
    ids = [attributes["id"] for _, attributes in outline.elements if "id" in attributes]
    assert len(set(ids)) == len(ids)
    for attributes in outline.all("a"):
        assert attributes["href"].removeprefix("#") in ids


def test_every_table_has_a_caption_and_headings(outline):
    assert len(outline.all("caption")) == len(outline.all("table")) == 3
    assert {attributes["scope"] for attributes in outline.all("th")} == {"col", "row"}


def test_every_picture_is_described(outline, text):
    pictures = [a for a in outline.all("div") if a.get("class") == "picture"]
    assert len(pictures) == len(specs(text)) == len(outline.all("figcaption")) > 20
    for attributes in pictures:
        assert attributes["role"] == "img"
        assert len(attributes["aria-label"]) > 20


def test_control_has_a_label(outline):
    (choice,) = outline.all("select")
    (label,) = outline.all("label")
    assert label["for"] == choice["id"] == "segment"
    (selected,) = [a["value"] for a in outline.all("option") if "selected" in a]
    assert selected in [a["value"] for a in outline.all("option")]


def test_says_first_what_is_known_and_what_to_run(comparison, text):
    first = text.partition('<h2 id="summary">')[2]
    assert (
        re.search(r'<p class="lead">(.*)</p>', first)[1]
        == comparison_text.concluded(comparison).sentence.partition(" Next: ")[0]
    )
    assert re.search(r"Next: <code>(.*)</code>", first)[1] == "terrain-est diagnose run.csv"


def test_the_next_command_is_as_it_was_typed(comparison):
    asked = Asked(inputs=("a run.csv",), model="rig.toml", options=("--rover", "rig 2.toml"))
    first = page(comparison, asked=asked).partition('<h2 id="summary">')[2]
    typed = "terrain-est diagnose &#39;a run.csv&#39; --model rig.toml --rover &#39;rig 2.toml&#39;"
    assert f"Next: <code>{typed}</code>" in first


def test_a_model_that_fits_says_so(run):
    found = comparison_of(run, failures=False)
    silent = {name: replace(one, heldout_rmse=one.noise) for name, one in found.channels.items()}
    wheels = [replace(wheel, blocks=np.arange(len(wheel.blocks)) // 20) for wheel in found.wheels]
    first = page(replace(found, channels=silent, wheels=wheels)).partition('<h2 id="summary">')[2]
    assert (
        '<p class="lead">The model fits to within the noise with 8 soils under 2 wheels: the held-out error '
        "is at most 1.00 × the noise" in first
    )
    assert "Next: <code>terrain-est estimate run.csv</code>" in first


def test_error_is_given_in_terms_of_its_noise(comparison, outline):
    torque = comparison.channels["torque"]
    assert f"{torque.heldout_rmse / torque.noise:.2f} ×" in outline.texts["td"]


def test_no_picture_has_one_quantity_on_both_axes(text):
    for spec in specs(text):
        titles = [
            [layer["encoding"].get(axis, {}).get("title") for axis in ("x", "y")]
            for layer in spec["layer"]
            if "encoding" in layer
        ]
        for across, up in titles:
            assert not across or not up or across.split()[-2:] != up.split()[-2:], (across, up)


def test_soil_is_drawn_along_the_drive(text):
    drawn = [spec for spec in specs(text) if "time since the start (s)" in json.dumps(spec)]
    assert len(drawn) == 3
    first = drawn[0]["datasets"]["data-0"]
    assert len(first) == 8
    assert min(row["x"] for row in first) == 0.0
    assert all(row["x"] < row["x2"] and row["low"] < row["y"] < row["high"] for row in first)


def test_numbers_are_in_the_unit_shown(comparison, outline):
    errors = comparison.channels["sinkage"]
    cells = outline.texts["td"]
    assert f"{1e3 * errors.rmse:.3g}" in cells


def test_fetches_nothing(outline, text):
    for _, attributes in outline.elements:
        for name in ("src", "href", "action", "data", "srcset", "poster"):
            assert attributes.get(name, "#").startswith(("#", "data:"))
    (policy,) = [a["content"] for a in outline.all("meta") if "http-equiv" in a]
    assert "default-src 'none'" in policy
    assert "unsafe-eval" not in policy
    assert "@import" not in text
    assert not re.search(r"url\(\s*['\"]?(?!data:|#)[a-z]*:?//", text)


def test_charts_are_data_of_their_own(text):
    for spec in specs(text):
        assert "$schema" not in spec
        assert '"url"' not in json.dumps({**spec, "datasets": {}})
        # Nothing of a log is in what Vega takes for an expression.
        assert set(re.findall(r'"filter": "([^"]*)"', json.dumps(spec))) <= {
            "datum.s == segment",
            "split(datum.s, ':')[0] == split(segment, ':')[0]",
            "datum.pivot",
            "datum.alone",
        }


def test_charts_are_of_vega_lite(text):
    schema = jsonschema.Draft7Validator(alt.load_schema())
    for spec in specs(text):
        schema.validate({**spec, "datasets": {name: rows[:1] for name, rows in spec["datasets"].items()}})


def test_names_from_files_are_text(run):
    hostile = comparison_of(run, source=HOSTILE, extra=HOSTILE, warnings=[HOSTILE])
    hostile.wheels[0] = replace(hostile.wheels[0], wheel=HOSTILE)
    finding = replace(hostile.failures[0], sentence=HOSTILE, worst_segments=((HOSTILE, HOSTILE, 1),))
    text = page(replace(hostile, failures=[finding], model={"base": "wong-reece", "effects": [HOSTILE]}))
    assert HOSTILE not in text
    assert "<script>alert" not in text
    assert "49" not in re.findall(r"\{\{.*?\}\}|49", text)[:1]
    outline = Outline(text)
    assert outline.open == []
    assert len(outline.all("script")) == 2
    assert any(HOSTILE in said for said in outline.texts["h1"])
    assert any(HOSTILE in said for said in outline.texts["li"])


def test_nothing_found_is_said(run):
    misses = comparison_of(run, failures=False)
    tracked = "No recorded channel tracks the misfit significantly."
    text = page(misses)
    assert tracked in text
    assert "Findings, the strongest first" not in text
    # Where there is no misfit, nothing can track it.
    channels = {name: replace(one, heldout_rmse=one.noise) for name, one in misses.channels.items()}
    assert tracked not in page(replace(misses, channels=channels))


def test_further_sections_are_shown_where_there_is_something(comparison):
    table = Table("Candidates", ("Effect", "Score"), [("slip-sinkage", "12")], frozenset({1}))
    text = page(
        comparison,
        further=[
            Section(id="ranking", title="Which effect is missing", parts=[table]),
            Section(id="ladder", title="Error ladder"),
        ],
    )
    outline = Outline(text)
    assert outline.texts["h2"][-1] == "Which effect is missing"
    assert "#ranking" in [attributes["href"] for attributes in outline.all("a")]
    assert "ladder" not in [attributes.get("id") for _, attributes in outline.elements]
    assert "slip-sinkage" in outline.texts["th"]


def test_without_a_place_there_is_no_map(run):
    lost = comparison_of(run)
    for wheel in lost.wheels:
        for name in ("x", "y"):
            del wheel.samples.channels[name]
    assert "Track by" not in page(lost)


def courses(text):
    """Return the titles of the axis below measured and predicted values, and how the prediction is drawn."""
    found = set()
    for spec in specs(text):
        measured, predicted = [*spec["layer"], {}, {}][:2]
        if [t.get("calculate") for t in predicted.get("transform", [])][-1:] == ["'predicted'"]:
            found.add((measured["encoding"]["x"]["title"], predicted["mark"]["type"]))
    return found


def test_a_drive_is_shown_along_time(text):
    assert courses(text) == {("time t (s)", "line")}


def test_steady_points_are_shown_along_slip_and_not_joined(run):
    """Their order in the table is that of nothing."""
    points = comparison_of(run)
    for wheel in points.wheels:
        wheel.samples.time = None
        del wheel.drivers["time"]
    assert courses(page(points)) == {("slip i", "point")}


def test_units_of_headings_are_not_broken(outline):
    assert "Rms error of T (N\N{NO-BREAK SPACE}m)" in outline.texts["th"]


def test_one_name_for_all_segments_is_no_legend(comparison):
    table = shown_segments.soil_table(comparison)
    table |= {"name": shown_segments.names(table), "key": list(map(str, range(len(table["segment"]))))}
    alike = {**table, "terrain": [""] * len(table["wheel"]), "wheel": ["wheel"] * len(table["wheel"])}
    for draw in (drive_charts.estimates, drive_charts.strength):
        assert '"legend": null' not in json.dumps(draw(table, "0"))
        drawn = json.dumps(draw(alike, "0"))
        assert drawn.count('"scale": {"domain": ["all segments"]') == drawn.count('"legend": null') > 0


def test_label_is_a_driver_by_name(text):
    (chart, *_) = [s for s in specs(text) if "terrain" in json.dumps(s["layer"])]
    assert {row["x"] for row in chart["datasets"]["data-1"]} == {"dry sand", "sandy loam"}


def test_same_comparison_same_page(comparison, text):
    assert page(comparison) == text


def test_many_samples_keep_the_page_small(text):
    many = page(comparison_of(simulate(drive(seconds=50.0, rate=30.0))))
    assert len(many.encode()) < 6e6
    assert len(many) < 3 * len(text)


def test_is_written_whole_or_not_at_all(comparison, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules[report.write.__module__], "page", lambda *_, **__: "whole")
    report.write(comparison, tmp_path / "run.html")
    assert (tmp_path / "run.html").read_text() == "whole"
    with pytest.raises(CannotWriteError, match="no such folder"):
        report.write(comparison, tmp_path / "none" / "run.html")


def test_the_library_of_charts_is_kept_and_made_anew_where_it_is_damaged(tmp_path, monkeypatch):
    library = sys.modules[report.write.__module__]._library.__wrapped__
    made = []

    def bundle():
        made.append(None)
        return "vega();'</script>'"

    monkeypatch.setattr("vl_convert.javascript_bundle", bundle)
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "new" / "folder")
    assert [library(), library()] == ["vega();'<\\/script>'"] * 2
    assert len(made) == 1
    (kept,) = (tmp_path / "new" / "folder").iterdir()
    for damaged in (b"", b"vega();", kept.read_bytes()[:-9]):
        kept.write_bytes(damaged)
        assert library() == "vega();'<\\/script>'"
    assert len(made) == 4
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "file" / "in")
    assert library() == "vega();'<\\/script>'"


@pytest.mark.parametrize("library", ["jinja2", "vl_convert"])
def test_missing_extra_says_what_to_install(comparison, tmp_path, monkeypatch, library):
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ConfigurationError, match=library) as error:
        report.write(comparison, tmp_path / "run.html")
    assert error.value.hint == version.command_for("report")


def test_segments_without_errors_are_drawn_along_the_drive_too():
    table = {
        **{name: [""] * 2 for name in ("terrain", "wheel", "source")},
        "t_start_s": [0.0, 5.0],
        "t_end_s": [5.0, 9.0],
        "stress_kPa": [10.0, 10.0],
        **{f"{name}_{unit}": [2.0, np.nan] for name, unit in (("c", "kPa"), ("phi", "deg"))},
        "strength_at_stress_kPa": [4.0, 5.0],
        **{name: [np.nan] * 2 for name in ("c_se_kPa", "phi_se_deg", "strength_at_stress_se_kPa")},
        "key": ["0:0", "0:1"],
        "segment": [1, 2],
        "name": ["1", "2"],
        "status": ["ok", "ok"],
    }
    drawn = dict(drive_charts.of_soil(table, "0:0"))
    assert list(drawn) == ["Strength at 10 kPa (kPa)", "Cohesion c (kPa)", "Friction angle φ (°)"]
    steady = {**table, "t_start_s": [np.nan] * 2, "t_end_s": [np.nan] * 2}
    assert drive_charts.of_soil(steady, "0:0") == []
