"""The report is one well-formed page that loads nothing from elsewhere and shows hostile text as text."""

import base64
import re
import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import pytest
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
    assert len(page.links) == html.count("<figure>") == 4
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
