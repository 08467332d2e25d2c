"""What is cited has an entry, what has an entry is cited, and both files of citations say the same of the software."""

import re

import pytest
from documentation import PAGES, ROOT, prose

import avc_casadi

BIB = (ROOT / "joss" / "paper.bib").read_text(encoding="utf-8")
PAPER = (ROOT / "joss" / "paper.md").read_text(encoding="utf-8")
CFF = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
ENTRIES = dict(re.findall(r"^@\w+\{([\w-]+),\n(.*?)^\}", BIB, re.MULTILINE | re.DOTALL))
GUIDE = [page for page in PAGES if not page.name.startswith("RESULTS") and page.name != "CHANGELOG.md"]
# Of the words that may stand before a year: no names of authors.
OTHERS = {"November", "Benchmarks", "IEEE"}


def fields(key):
    found = re.findall(r"^  (\w+) = \{(.*?)\},$", ENTRIES[key], re.MULTILINE | re.DOTALL)
    return {name: " ".join(re.sub(r"\\c|\\.|[{}\"]", "", value).split()) for name, value in found}


def named_with_a_year(text):
    """Authors as pages name them, 'Brown and Colgate 1998' or 'Hansen (2016)': the last names and the year."""
    pattern = r"([A-Z][a-z]+)(?: (?:and|&) ([A-Z][a-z]+))? \(?((?:19|20)\d\d)\b"
    return [(*(name for name in (first, second) if name), year) for first, second, year in re.findall(pattern, text)]


def test_the_paper_cites_every_entry_and_no_other():
    cited = set(re.findall(r"@([\w-]+)", re.sub(r"<!--.*?-->", "", PAPER, flags=re.DOTALL)))
    assert len(ENTRIES) > 30
    assert cited == ENTRIES.keys()


@pytest.mark.parametrize("key", ENTRIES)
def test_an_entry_says_who_what_where_and_when(key):
    found = fields(key)
    assert {"author", "title", "year"} <= found.keys()
    assert found.keys() & {"journal", "booktitle", "publisher", "url"}
    assert key.endswith(found["year"]) or key in {"mathworks", "sai2", "the-paper"}


def test_what_the_guide_cites_with_a_year_has_an_entry():
    known = [(fields(key)["author"], fields(key)["year"]) for key in ENTRIES]
    cited = {one for page in GUIDE for one in named_with_a_year(prose(page)) if one[0] not in OTHERS}
    assert ("Lee", "Spong", "2006") in cited
    for *names, year in cited:
        assert any(when == year and all(name in who for name in names) for who, when in known), (names, year)


def test_the_citation_file_names_the_software_as_it_is_and_works_that_have_an_entry():
    assert re.search(r"^version: (\S+)$", CFF, re.MULTILINE)[1] == avc_casadi.__version__
    assert re.search(r"^license: (\S+)$", CFF, re.MULTILINE)[1] == "MIT"
    titles = {fields(key)["title"].casefold() for key in ENTRIES}
    told = re.findall(r'^    title: "(.*)"$', CFF.partition("references:")[2], re.MULTILINE)
    assert told
    assert all(title.casefold() in titles for title in told)
