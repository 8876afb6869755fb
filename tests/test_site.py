"""The site is built without a warning, is whole, asks for nothing outside, and shows what it should."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urldefrag, urlsplit

import browsers
import numpy as np
import pages
import pytest

from benchmarks import effect_gallery
from terrain_cli.effects import catalogue

ROOT = Path(__file__).resolve().parent.parent
TRACES = json.loads(effect_gallery.PAGE.read_text("utf-8"))
#: Made anew here.
AGAIN = "side-slip"
#: Of a telephone, a small window, and a wide one.
WIDTHS = (420, 900, 1600)


class Page(HTMLParser):
    """What a page links to, what it loads, and the places that can be linked to."""

    def __init__(self, path):
        super().__init__()
        self.links, self.loaded, self.places = [], [], {""}
        self.feed(path.read_text("utf-8"))

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.places |= {given[name] for name in ("id", "name") if given.get(name)}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload"):
            self.loaded.append(given["href"])
        elif "src" in given:
            self.loaded.append(given["src"])


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "docs", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return folder


@pytest.fixture(scope="module")
def found(site):
    return {path: Page(path) for path in sorted(site.glob("*.html"))}


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with browsers.started(tmp_path_factory.mktemp("profile")) as driver:
        yield driver


def test_every_page_is_there(found):
    written = {path.stem for path in (ROOT / "docs").iterdir() if path.suffix in {".md", ".ipynb"}}
    assert written <= {path.stem for path in found}


def test_every_link_leads_somewhere(found):
    astray = []
    for path, page in found.items():
        for link in (*page.links, *page.loaded):
            if urlsplit(link).scheme:
                continue
            file, place = urldefrag(link)
            target = (path.parent / unquote(file.partition("?")[0])).resolve() if file else path
            if not target.exists() or (target in found and unquote(place) not in found[target].places):
                astray.append((path.name, link))
    assert astray == []


def test_nothing_is_loaded_from_elsewhere(found):
    loaded = [link for page in found.values() for link in page.loaded]
    assert loaded
    assert [link for link in loaded if urlsplit(link).scheme not in {"", "data"}] == []


@pytest.fixture(scope="module")
def opened(browser, found):
    """Open every page once; return what was asked for and complained of, and its width in windows."""
    asked, console, reach = [], [], {}
    for path in found:
        browser.get(path.as_uri())
        console += browser.get_log("browser")
        asked += browsers.asked_for(browser)
        for width in WIDTHS:
            size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            reach[path.name, width] = browser.execute_script("return document.documentElement.scrollWidth")
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    return asked, console, reach


@pytest.mark.real("chromium", "chromedriver")
def test_pages_open_without_a_request_outside_or_a_complaint(opened, site):
    asked, console, _ = opened
    assert console == []
    assert any(url.endswith(".ttf") for url in asked)
    assert [url for url in asked if not url.startswith((site.as_uri(), "data:", "chrome:"))] == []


@pytest.mark.real("chromium", "chromedriver")
def test_no_page_is_wider_than_the_window(opened):
    assert [(name, width) for (name, width), reach in opened[2].items() if reach > width] == []


@pytest.mark.real("chromium", "chromedriver")
def test_equations_are_set_in_their_font(browser, site):
    browser.get((site / "wheel-model.html").as_uri())
    shown = browser.execute_script(
        "const all = [...document.querySelectorAll('.equation math')];"
        "return [all.map(one => one.getBoundingClientRect().height),"
        " document.fonts.check('16px \"STIX Two Math\"'), document.querySelectorAll('merror').length]"
    )
    heights, font, wrong = shown
    assert len(heights) > 15
    # A fraction is higher than a line.
    assert min(heights) > 15
    assert max(heights) > 40
    assert (font, wrong) == (True, 0)


@pytest.mark.real("chromium", "chromedriver")
def test_pages_are_light_or_dark_as_the_reader_wants(browser, site):
    seen = {}
    for scheme in ("light", "dark"):
        wanted = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", wanted)
        browser.get((site / "gallery.html").as_uri())
        seen[scheme] = browser.execute_script(
            "return [getComputedStyle(document.body).backgroundColor,"
            " getComputedStyle(document.querySelector('.trace .title')).fill]"
        )
    for light, dark in zip(seen["light"], seen["dark"], strict=True):
        assert light != dark


@pytest.mark.real("chromium", "chromedriver")
def test_the_search_finds_a_word_without_a_server(browser, site):
    from selenium.webdriver.support.ui import WebDriverWait

    browser.get((site / "search.html").as_uri() + "?q=bulldozing")
    results = WebDriverWait(browser, 20).until(
        lambda driver: driver.find_elements("css selector", "#search-results li a")
    )
    assert "gallery.html" in " ".join(one.get_attribute("href") for one in results)


def test_gallery_has_every_effect_with_its_pictures(site):
    assert list(TRACES) == list(catalogue())
    text = (site / "gallery.html").read_text("utf-8")
    for effect in catalogue():
        section = text.partition(f'<section id="{effect}">')[2].partition("</section>")[0]
        assert section.count('<svg class="trace"') == 3, effect
        assert f"terrain-est simulate -o {effect}.csv" in re.sub("<[^>]+>", "", section)


def test_gallery_is_what_its_command_makes():
    made, kept = effect_gallery.entry(AGAIN), TRACES[AGAIN]
    assert (made["driver"], made["drive"]) == (kept["driver"], kept["drive"])
    for name, one in kept["channels"].items():
        assert made["channels"][name]["noise"] == pytest.approx(one["noise"], rel=0.01)
        bins = (np.array(channels[name]["bins"]) for channels in (made["channels"], kept["channels"]))
        np.testing.assert_allclose(*bins, rtol=0.02, atol=0.02 * one["noise"])
    pages.assert_printed(kept["diagnosis"], made["diagnosis"])
