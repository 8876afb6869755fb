"""The page in a real browser, without a network."""

from __future__ import annotations

import io
from dataclasses import replace

import browsers
import numpy as np
import pytest
from compared import comparison_of, halved
from matplotlib import image

from terrain_cli.improvement.change_trial import Alternative
from terrain_cli.views import report

pytestmark = pytest.mark.real("chromium", "chromedriver")

#: Lets every chart be drawn, and says whether one was not.
DRAWN = "return document.querySelectorAll('.chart').length === document.querySelectorAll('.chart svg').length"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with browsers.started(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


def opened(browser, path):
    """Open a page, wait until its charts are drawn, and return what the log then holds."""
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get("about:blank")
    browser.get_log("performance")
    browser.get_log("browser")
    browser.get(path.as_uri())
    WebDriverWait(browser, 60).until(lambda driver: driver.execute_script(DRAWN))
    return {"console": browser.get_log("browser"), "asked": browsers.asked_for(browser)}


@pytest.fixture(scope="module")
def path(comparison, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "run.html"
    models = [Alternative("wong-reece", comparison, own=True), Alternative("+ grousers", halved(comparison))]
    report.write(comparison, path, models=models)
    return path


@pytest.fixture
def shown(browser, path):
    """Show the page, whatever was shown before."""
    if browser.current_url != path.as_uri():
        opened(browser, path)
    return path


def pixels(element):
    # All of it, also where it began below the window.
    element.parent.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
    return image.imread(io.BytesIO(element.screenshot_as_png))[..., :3]


def elements(browser, selector):
    return browser.find_elements("css selector", selector)


def choose(browser, number):
    from selenium.webdriver.support.ui import Select

    Select(browser.find_element("id", "segment")).select_by_index(number)


def test_nothing_is_asked_for_but_the_page_and_nothing_complains(browser, path):
    log = opened(browser, path)
    assert log["console"] == []
    assert [url for url in log["asked"] if not url.startswith(("data:", "chrome:"))] == [path.as_uri()]


def test_every_picture_shows_something(browser, shown):
    charts = elements(browser, ".chart")
    assert len(charts) > 20
    for chart in charts:
        shown = pixels(chart)
        assert shown.shape[0] > 100
        assert shown.shape[1] > 150
        # More than one frame and its axes: marks in colours or greys.
        assert 0.01 < (shown < 0.85).any(axis=2).mean() < 0.9


def test_keyboard_reaches_all_that_can_be_used(browser, path):
    from selenium.webdriver.common.keys import Keys

    opened(browser, path)
    reached = []
    for _ in range(40):
        browser.switch_to.active_element.send_keys(Keys.TAB)
        focus = browser.switch_to.active_element
        what = focus.get_attribute("id") or focus.get_attribute("class") or focus.get_attribute("href")
        if what in reached or focus.tag_name == "body":
            break
        reached.append(what)
    assert reached[0] == "skip"
    assert "segment" in reached
    links = [link.get_attribute("href") for link in elements(browser, "nav a")]
    assert set(links) <= set(reached)
    assert "scroll" in reached


def test_pictures_keep_their_descriptions(browser, shown):
    for picture in elements(browser, ".picture"):
        assert picture.get_attribute("role") == "img"
        assert len(picture.get_attribute("aria-label")) > 20


def test_focus_can_be_seen(browser, shown):
    browser.execute_script("document.getElementById('segment').focus({focusVisible: true})")
    choice = browser.find_element("id", "segment")
    assert choice.value_of_css_property("outline-style") == "solid"


def test_skip_link_leads_to_the_content(browser, path):
    from selenium.webdriver.common.keys import Keys

    opened(browser, path)
    browser.switch_to.active_element.send_keys(Keys.TAB)
    skip = browser.switch_to.active_element
    assert skip.get_attribute("class") == "skip"
    # Seen once it is reached.
    assert skip.rect["x"] == 0
    skip.send_keys(Keys.ENTER)
    assert browser.switch_to.active_element.get_attribute("id") == "main"


def test_choosing_a_segment_by_keyboard_changes_the_pictures(browser, shown):
    from selenium.webdriver.common.keys import Keys

    choose(browser, 0)
    charts = elements(browser, ".picture")
    course = next(c for c in charts if "along the segment" in c.get_attribute("aria-label"))
    before = pixels(course), pixels(charts[0])
    browser.find_element("id", "segment").send_keys(Keys.ARROW_DOWN)
    assert browser.find_element("id", "segment").get_property("selectedIndex") == 1
    for old, chart in zip(before, (course, charts[0]), strict=True):
        new = pixels(chart)
        assert new.shape != old.shape or np.abs(new - old).max() > 0.2


def test_choosing_a_model_changes_the_pictures_of_that_section_alone(browser, shown):
    from selenium.webdriver.support.ui import Select

    charts = elements(browser, ".picture")
    errors, misfit = (
        next(c for c in charts if c.get_attribute("aria-label").startswith(start))
        for start in (
            "Held-out rms error of torque",
            "Median and 5 to 95 % of measured less predicted torque",
        )
    )
    before = [pixels(one) for one in (errors, misfit, charts[0])]
    Select(browser.find_element("id", "model")).select_by_visible_text("+ grousers")
    after = [pixels(one) for one in (errors, misfit, charts[0])]
    assert [(a != b).any() for a, b in zip(before, after, strict=True)] == [True, True, False]


def test_hover_says_the_values(browser, shown):
    from selenium.webdriver import ActionChains

    chart = next(one for one in elements(browser, "figure") if one.text.startswith("Track by strength"))
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", chart)
    line = chart.find_elements("css selector", ".mark-line path")[-1]
    ActionChains(browser).move_to_element(line).perform()
    tip = browser.find_element("id", "vg-tooltip-element")
    assert "segment" in tip.text
    assert "strength" in tip.text


def test_page_and_charts_are_dark_where_the_reader_wants_it(browser, shown):
    seen = {}
    try:
        for scheme in ("light", "dark"):
            wanted = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
            browser.execute_cdp_cmd("Emulation.setEmulatedMedia", wanted)
            ink = browser.execute_script(
                "return getComputedStyle(document.querySelector('.chart svg .role-axis-label text')).fill"
            )
            seen[scheme] = (ink, float(np.median(pixels(elements(browser, ".chart")[0]))))
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert seen["light"] == ("rgb(28, 28, 28)", pytest.approx(1.0))
    assert seen["dark"][0] == "rgb(228, 228, 228)"
    assert seen["dark"][1] < 0.3


def test_fits_a_telephone(browser, path):
    size = {"width": 390, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    try:
        opened(browser, path)
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
        for chart in elements(browser, ".chart svg")[:8]:
            assert chart.size["width"] <= 390
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        browser.get("about:blank")


def test_print_leaves_out_what_paper_cannot_do(browser, shown):
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        assert not browser.find_element("css selector", "nav").is_displayed()
        assert browser.find_element("css selector", ".choose").is_displayed()
        assert elements(browser, ".scroll")[1].value_of_css_property("max-height") == "none"
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    paper = browser.execute_cdp_cmd("Page.printToPDF", {})
    assert len(paper["data"]) > 50_000


def test_segment_of_which_nothing_is_known(browser, run, tmp_path):
    partial = comparison_of(run)
    for wheel in partial.wheels:
        series = wheel.series["sinkage"]
        predicted = series.predicted.copy()
        predicted[wheel.windows.bounds[1] : wheel.windows.bounds[3]] = np.nan
        wheel.series["sinkage"] = replace(series, predicted=predicted)
    report.write(partial, tmp_path / "partial.html")
    log = opened(browser, tmp_path / "partial.html")
    for number in (1, 2, 3):
        choose(browser, number)
    assert log["console"] == browser.get_log("browser") == []


def test_hostile_names_do_nothing(browser, run, tmp_path):
    name = "</script><script>document.title = 'run'</script><img src=x onerror=\"document.title = 'run'\">"
    hostile = comparison_of(run, source=name, extra=name, warnings=[name])
    report.write(hostile, tmp_path / "hostile.html")
    log = opened(browser, tmp_path / "hostile.html")
    assert browser.title == f"Wheel and soil: {name}"
    assert log["console"] == []
    assert elements(browser, "img") == []
    choose(browser, 1)
    assert browser.title == f"Wheel and soil: {name}"
