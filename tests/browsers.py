"""A real browser without a network, for pages that are made here."""

from __future__ import annotations

import json
import shutil
from contextlib import contextmanager

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--disable-default-apps", "--disable-extensions", "--hide-scrollbars"),
    # Whatever were asked for would fail, and show in the log.
    "--host-resolver-rules=MAP * ~NOTFOUND",
)


@contextmanager
def started(profile):
    """Give a browser that keeps what it knows in the folder `profile`, and logs what it asks for."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in (*FLAGS, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    service = webdriver.ChromeService(executable_path=shutil.which("chromedriver"))
    driver = webdriver.Chrome(options=options, service=service)
    driver.set_window_size(1280, 900)
    try:
        yield driver
    finally:
        driver.quit()


def asked_for(browser):
    """Return the addresses that were asked for since this was last called."""
    log = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    return [one["params"]["request"]["url"] for one in log if one["method"] == "Network.requestWillBeSent"]
