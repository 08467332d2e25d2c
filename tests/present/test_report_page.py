"""The report in Chromium: at a desk, on a tablet, on a phone and on paper nothing sticks out, and all can read it."""

import json

import pytest
from browser import (
    WIDTHS,
    chromium,
    requested,
    resize,
    sticks_out_by,
)
from reported import report_of

import avc_casadi as avc


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "report.html").write_text(
        report_of(avc.load_problem("spring"), {"skipped": "no device"}), encoding="utf-8"
    )
    with chromium(folder) as driver:
        driver.get("about:blank")
        requested(driver)
        driver.get((folder / "report.html").as_uri())
        for details in driver.find_elements("css selector", "details > summary"):
            details.click()
        yield driver


@pytest.mark.thorough
@pytest.mark.parametrize("size", WIDTHS)
def test_nothing_sticks_out(page, size):
    resize(page, WIDTHS[size])
    assert sticks_out_by(page) <= 0
    figure = page.execute_script("return document.querySelector('figure').getBoundingClientRect().width")
    assert figure > 0.75 * min(WIDTHS[size], 1200)


@pytest.mark.thorough
def test_the_verdict_comes_first_and_is_a_word_and_a_mark(page):
    verdict = page.find_element("css selector", "main > p.verdict")
    assert verdict.text.startswith("Deploy this coupling")
    mark = page.execute_script("return getComputedStyle(arguments[0], '::before').content", verdict)
    assert "✓" in mark or "2713" in json.dumps(mark)
