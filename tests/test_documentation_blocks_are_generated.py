"""Generated blocks of the pages are what their sources give: results files, and the model of a problem file."""

import re
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / "benchmarks"))
from documented_keys import key_tables
from documented_results import BLOCKS, document
from generated_blocks import ROOT, WRITERS, pages, written
from measured_code import start_of
from remake_results import STUDIES

PAGES = pages()


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_blocks_are_up_to_date(page):
    assert page.read_text(encoding="utf-8") == written(page), "python tests/benchmarks/write_documents.py"


def test_every_block_has_its_place():
    placed = [block for blocks in PAGES.values() for block in blocks]
    assert sorted(placed) == sorted(set(placed)) == sorted(WRITERS)


def test_every_key_of_the_commented_problem_is_told():
    text = (ROOT / "problems" / "figure5.toml").read_text(encoding="utf-8")
    keys = set(re.findall(r"^(?:# )?(\w+) = [^\n]", text, re.MULTILINE)) - {"measured", "resonance", "range"}
    tables = key_tables()
    assert len(keys) > 40
    assert not {key for key in keys if not re.search(rf"[`.]{key}[`\s=]", tables)}


def test_every_key_has_a_meaning():
    rows = [line.split(" | ") for line in key_tables().splitlines() if line.startswith("| `")]
    assert len(rows) > 100
    assert not [row[0] for row in rows if row[-1].strip(" |") == "" and "`range." not in row[0]]


@pytest.mark.parametrize("source", sorted({block.source for block in BLOCKS.values()} - {"recorded"}))
def test_results_say_what_made_them(source):
    about = document(source)["about"]
    assert all(about.get(key) not in {None, ""} for key in ("command", "commit", "seed", "machine"))
    assert source in {name for study in STUDIES for name in study.results}


def test_recorded_findings_say_what_made_them():
    for name, finding in document("recorded")["findings"].items():
        about = finding["about"]
        assert all(about.get(key) for key in ("command", "commit", "seed", "machine", "versions")), name
        assert start_of(about["command"]).is_file(), name


def test_every_study_is_a_script_that_explains_itself():
    for study in STUDIES:
        assert (ROOT / "tests" / "benchmarks" / study.script.split()[0]).is_file()
