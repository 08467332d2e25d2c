"""A comparison and a certificate are laid out once: the command and the page show the same tables, cell for cell."""

import re
from html import unescape

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi._util.text import Table, number
from avc_casadi.claims.certificate import levels_table
from avc_casadi.cli import main
from avc_casadi.design.comparison.document import comparison_document, comparison_tables
from avc_casadi.present.report.page import ReportContents, report_html
from avc_casadi.present.report.summary import summarise
from avc_casadi.recommendation.told import conclusion_lines

PROBLEM = avc.load_problem("figure5").changed(title="a < b")


@pytest.fixture(scope="module")
def told():
    comparison = avc.compare(PROBLEM, mine=(2000.0, 7.0))
    certificate = avc.certify(PROBLEM, comparison.methods["direct"]).document()
    summary = summarise(PROBLEM, comparison, comparison.methods["direct"], certificate, {"skipped": "no device"})
    document = comparison_document(comparison)
    found = avc.recommend(PROBLEM, hands=10).document()
    contents = ReportContents(PROBLEM, comparison, summary, certificate, [], {}, conclusion_lines(found), found)
    page = report_html(contents)
    return document, certificate, page


def cells(html):
    rows = re.findall(r"<tr>(.*?)</tr>", html)
    return [[unescape(cell) for cell in re.findall(r"<t[dh][^>]*>(.*?)</t[dh]>", row)] for row in rows]


@pytest.mark.thorough
def test_the_page_holds_every_table_of_the_comparison(told):
    document, certificate, page = told
    for table in (*comparison_tables(document), levels_table(certificate)):
        assert table.html() in page
        for note in table.notes:
            assert note in unescape(page)


@pytest.mark.thorough
def test_the_command_prints_every_table_of_the_comparison(told, capsys):
    document, _, _ = told
    assert main(["compare", "figure5", "--mine", "2000,7", "-v"]) == 0
    text = capsys.readouterr().out
    for table in comparison_tables(document):
        assert table.text() in text


@pytest.mark.thorough
def test_both_renderings_of_a_table_hold_the_same_cells(told):
    document, certificate, _ = told
    for table in (*comparison_tables(document), levels_table(certificate)):
        _, *rows = cells(table.html())
        body = table.text().splitlines()[-len(rows) :]
        for row, line in zip(rows, body, strict=True):
            assert line.split() == " ".join(row).split()


@pytest.mark.thorough
def test_the_numbers_are_those_of_the_document(told):
    document, certificate, _ = told
    tables = comparison_tables(document)
    _, *rows = cells(tables.frequencies.html())
    assert rows[0][0] == number(document["frequency_hz"][0], 3)
    assert rows[-1][-1] == document["verdict"][-1]
    assert rows[-1][5] == number(document["methods"]["direct"]["damping_ns_per_m"][-1], 3)
    _, *levels = cells(levels_table(certificate).html())
    for row, (level, found) in zip(levels, certificate["levels"].items(), strict=True):
        assert row[:3] == [level, found["title"], "pass" if found["pass"] else "fail"]
        assert row[3] == number(found["margin_ns_per_m"], 3)
    _, *safety = cells(tables.safety.html())
    assert [row[0] for row in safety] == ["closed form", "direct", "exact", "mine"]
    assert [row[-1] for row in safety] == ["no", "no", "no", "yes"]


@pytest.mark.thorough
def test_the_damped_structure_shows_its_contact_damper():
    problem = avc.load_problem("damped").changed(stability={"scope": "pointwise"}, frequency={"points": 5})
    tables = comparison_tables(comparison_document(avc.compare(problem)))
    assert "direct\nb_p N.s/m" in tables.frequencies.header
    assert len({len(row) for row in tables.frequencies.rows} | {len(tables.frequencies.header)}) == 1


@pytest.mark.thorough
def test_cells_of_every_kind_are_written_one_way():
    table = Table(("a\nm", "b"), ((1.23456, "x<y"), (None, "z"), (np.nan, "")), left=(1,))
    assert [row[0] for row in cells(table.html())] == ["a, m", "1.235", "-", "-"]
    assert "x&lt;y" in table.html()
    assert '<td class="n">1.235</td><td>x&lt;y</td>' in table.html()
    mixed = Table(("n", "flag"), ((200, True), (3, False)))
    assert cells(mixed.html())[1:] == [["200", "yes"], ["3", "no"]]
    assert mixed.text().splitlines() == ["  n  flag", "---  ----", "200   yes", "  3    no"]
