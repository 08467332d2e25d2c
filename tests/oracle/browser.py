"""A real browser for tests: headless Chromium of the system, at the widths of a desk, a tablet and a phone."""

import json
import shutil
import time
from contextlib import contextmanager

import pytest

SIZES = {"laptop": (1366, 768), "phone": (390, 844)}
"""Width and height, pixels, of the screens on which pages are looked at."""

# Whatever sticks out of the page sideways, but for what scrolls inside a box of its own.
_STICKS_OUT = """
const scrolls = (element) => element && (
  ["auto", "scroll"].includes(getComputedStyle(element).overflowX) || scrolls(element.parentElement));
const limit = document.documentElement.clientWidth + 1;
return [...document.querySelectorAll("body *")]
  .filter((element) => element.getBoundingClientRect().right > limit && !scrolls(element.parentElement))
  .map((element) => element.outerHTML.slice(0, 100));
"""
_IN_SIGHT = """
const box = arguments[0].getBoundingClientRect();
return box.height > 0 && box.top >= 0 && box.bottom <= window.innerHeight && box.left >= 0
  && box.right <= document.documentElement.clientWidth;
"""


@contextmanager
def chromium(folder):
    """Start Chromium; downloads go to the folder. Skips with a word where Chromium or its driver is not installed."""
    browser, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if browser is None or driver is None:
        pytest.skip("no Chromium with its driver (Debian: apt-get install chromium chromium-driver)")
    from selenium import webdriver  # noqa: PLC0415 - only where there is a browser

    options = webdriver.ChromeOptions()
    options.binary_location = browser
    for argument in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--window-size=1400,900",
        f"--user-data-dir={folder}/p",
    ):
        options.add_argument(argument)
    options.add_experimental_option("prefs", {"download.default_directory": str(folder)})
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    started = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    started.set_script_timeout(60)
    try:
        yield started
    finally:
        started.quit()


def sized(driver, size, height=None):
    """Take the size of a screen of SIZES; a height in its place shows a whole page."""
    width, usual = SIZES[size]
    metrics = {"width": width, "height": height or usual, "deviceScaleFactor": 1, "mobile": size == "phone"}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


def sticking_out(driver):
    """Elements that are wider than the screen, but for those in a box that scrolls."""
    return driver.execute_script(_STICKS_OUT)


def in_sight(driver, element):
    """Whether an element lies within the window as it is scrolled now."""
    return driver.execute_script(_IN_SIGHT, element)


def console_errors(driver):
    return [entry["message"] for entry in driver.get_log("browser") if entry["level"] in {"SEVERE", "WARNING"}]


def requested(driver):
    """Every address that the page has asked for since this was last called."""
    events = (json.loads(entry["message"])["message"] for entry in driver.get_log("performance"))
    return [event["params"]["request"]["url"] for event in events if event["method"] == "Network.requestWillBeSent"]


def until(question, seconds=120.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if found := question():
            return found
        time.sleep(0.03)
    raise AssertionError("it did not happen in time")


def by_id(driver, name):
    return driver.find_element("id", name)


def shown(driver, figure):
    # In one go: the picture is drawn anew while it is asked for.
    return driver.execute_script(f"return document.querySelector('#{figure} svg')?.getAttribute('aria-label') ?? ''")
