"""The report is one page that loads nothing from elsewhere, shows hostile text as text, and fits any screen."""

import base64
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest
from browser import SIZES, chromium, in_sight, sized, sticking_out
from reported import report_of

import avc_casadi as avc
from avc_casadi.present.rows.deploy import Refused

VOID = {"meta", "img", "source", "link", "br", "hr"}
HOSTILE = "</title><script>alert('x')</script> & \"quoted\" $title"


class Page(HTMLParser):
    """Collects text, attributes and figures; fails on tags that do not match."""

    def __init__(self, text):
        super().__init__()
        self.open, self.tags, self.links, self.text = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for key, value in attrs if key in {"src", "href", "srcset", "action", "data"}]
        assert not any(key.startswith("on") for key, _ in attrs)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def html():
    problem = avc.load_problem("figure5").changed(title=HOSTILE, source=HOSTILE)
    return report_of(problem, Refused("the <b>device</b> & its limits"))


@pytest.mark.slow
def test_nothing_is_loaded_from_elsewhere(html):
    page = Page(html)
    assert len(page.links) == html.count("<figure>") == 12
    assert all(link.startswith("data:image/svg+xml;base64,") for link in page.links)
    for forbidden in ("http:", "https:", "file:", "url(", "@import", "<script", "<iframe", "<link"):
        assert forbidden not in html
    for link in page.links:
        picture = ET.fromstring(base64.b64decode(link.partition(",")[2]))  # noqa: S314
        assert picture.tag == "{http://www.w3.org/2000/svg}svg"
        for element in picture.iter():
            for key, value in element.attrib.items():
                if key.endswith(("href", "src")):
                    assert value.startswith("#")
                assert not re.search(r"url\((?!#)", value)


@pytest.mark.slow
def test_hostile_text_is_shown_as_text(html):
    page = Page(html)
    assert "script" not in page.tags
    assert "b" not in page.tags
    assert HOSTILE in "".join(page.text)
    assert "the <b>device</b> & its limits" in "".join(page.text)


@pytest.fixture(scope="module")
def driver(html, tmp_path_factory):
    folder = tmp_path_factory.mktemp("browser")
    file = folder / "report.html"
    file.write_text(html, encoding="utf-8")
    with chromium(folder) as started:
        started.get(file.as_uri())
        yield started


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_the_conclusion_comes_first_and_no_panel_is_cut(driver, size):
    sized(driver, size)
    assert in_sight(driver, driver.find_element("css selector", "p.verdict"))
    assert sticking_out(driver) == []
    panels = [panel for panel in driver.find_elements("css selector", "figure img") if panel.is_displayed()]
    assert len(panels) == 6
    window = driver.execute_script("return document.documentElement.clientWidth")
    for panel in panels:
        width = panel.rect["width"]
        assert panel.rect["x"] >= 0
        assert panel.rect["x"] + width <= window
        # Its letters stay legible: 8 points are drawn at 8 to 18 pixels.
        assert 0.75 <= width / 355 <= 1.7
    # Tables need no scrolling sideways.
    wider = (
        "return [...document.querySelectorAll('.wide')].filter((box) => box.scrollWidth > box.clientWidth + 1).length"
    )
    assert driver.execute_script(wider) == 0


@pytest.mark.slow
def test_the_page_is_as_wide_as_a_wide_screen_and_the_paper_is_folded(driver):
    wide = {"width": 1920, "height": 1080, "deviceScaleFactor": 1, "mobile": False}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", wide)
    reach = (
        "return Math.max(...[...document.querySelectorAll('figure')].map((box) => box.getBoundingClientRect().right))"
    )
    assert driver.execute_script(reach) > 0.95 * 1920
    folded = [fold.text for fold in driver.find_elements("css selector", "details:not([open]) > summary")]
    assert "The paper's question" in folded
