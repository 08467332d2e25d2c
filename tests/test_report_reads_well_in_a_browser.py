"""The report in Chromium: at a desk, on a tablet, on a phone and on paper nothing sticks out, and all can read it."""

import json

import pytest
from browser import (
    WIDTHS,
    chromium,
    console_errors,
    printed_pages,
    requested,
    resize,
    sticks_out_by,
)

import avc_casadi as avc
from avc_casadi.present.figures.comparison import draw_comparison
from avc_casadi.present.report.frame import Picture
from avc_casadi.present.report.page import ReportContents, picture_words, report_html
from avc_casadi.present.report.summary import summarise
from avc_casadi.recommendation.told import conclusion_lines

PAPER_PX = 718
_TOO_WIDE = """
return [...document.querySelectorAll('table, img, pre')].filter((one) => one.offsetParent !== null
  && one.getBoundingClientRect().right > document.documentElement.clientWidth + 1)
  .map((one) => one.outerHTML.slice(0, 200))
"""


@pytest.fixture(scope="module")
def contents():
    problem = avc.load_problem("spring")
    comparison = avc.compare(problem)
    gains = comparison.methods["direct"]
    certificate = avc.certify(problem, gains).document()
    summary = summarise(problem, comparison, gains, certificate, {"skipped": "no device"})
    found = avc.recommend(problem, hands=10).document()
    words = picture_words(comparison)["comparison"]
    figures = [Picture.of(draw_comparison, comparison, "Errors of the methods.", words)]
    return ReportContents(problem, comparison, summary, certificate, figures, {}, conclusion_lines(found), found)


@pytest.fixture(scope="module")
def page(contents, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "report.html").write_text(report_html(contents), encoding="utf-8")
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
    shown = page.execute_script("return document.querySelector('figure img').currentSrc.length")
    wide = page.execute_script("return document.querySelector('figure img').src.length")
    assert (shown != wide) == (size == "phone")
    figure = page.execute_script("return document.querySelector('figure img').getBoundingClientRect().width")
    assert figure > 0.75 * min(WIDTHS[size], 1200)


@pytest.mark.thorough
def test_paper_cuts_nothing_off(page):
    resize(page, PAPER_PX)
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    assert page.execute_script(_TOO_WIDE) == []
    page.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert printed_pages(page).startswith(b"%PDF")


@pytest.mark.thorough
def test_it_asks_nobody_and_complains_of_nothing(page):
    assert [url for url in requested(page) if not url.startswith(("file:", "data:"))] == []
    assert console_errors(page) == []


@pytest.mark.thorough
def test_the_conclusion_comes_first_and_its_verdict_is_a_word_and_a_mark(page, contents):
    verdict = page.find_element("css selector", "main h2 + p.verdict")
    assert verdict.text == "Deploy this coupling."
    mark = page.execute_script("return getComputedStyle(arguments[0], '::before').content", verdict)
    assert "✓" in mark or "2713" in json.dumps(mark)
    assert contents.deployment["deployable"]


@pytest.mark.thorough
def test_figures_say_in_numbers_what_they_show(page, contents):
    said = page.find_element("css selector", "figure img").get_attribute("alt")
    counts = contents.comparison.counts()
    assert all(f"{count} {verdict}" in said for verdict, count in counts.items() if count)
