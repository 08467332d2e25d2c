"""Generated blocks of the pages are what the model of a problem file gives."""

import re

import pytest
from write_documents import PAGES, ROOT, key_tables, written


@pytest.mark.parametrize("name", PAGES)
def test_blocks_are_up_to_date(name):
    assert PAGES[name].read_text(encoding="utf-8") == written(name), "python tests/benchmarks/write_documents.py"


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
