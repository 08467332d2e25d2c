"""The tutorial is one page of ten cells that run in their order and show what is stored beside them."""

import base64
import re

import pytest
from documentation import ROOT, anchors
from matplotlib.figure import Figure
from write_tutorial import NOTEBOOK, code_cells, read_notebook, run_cells

AGAIN = "python tests/benchmarks/write_tutorial.py"
CELLS = 10
MOST_BYTES = 300_000
NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]\d+)?")


def stored(cell):
    """What a cell shows in the file: its text, and whether a picture."""
    printed = [line for output in cell["outputs"] for line in output.get("text", [])]
    shown = [output["data"] for output in cell["outputs"] if "data" in output]
    values = [line for data in shown for line in data.get("text/plain", [])]
    pictures = [base64.b64decode(data["image/png"]) for data in shown if "image/png" in data]
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    return "".join(printed + values), bool(pictures)


def test_it_is_a_page_of_ten_cells_with_pictures():
    cells = code_cells(read_notebook())
    assert len(cells) == CELLS
    assert sum(stored(cell)[1] for cell in cells) >= 3
    assert all(any(stored(cell)) for cell in cells), AGAIN
    assert NOTEBOOK.stat().st_size < MOST_BYTES


def test_its_links_lead_somewhere():
    text = "".join("".join(cell["source"]) for cell in read_notebook()["cells"] if cell["cell_type"] == "markdown")
    targets = re.findall(r"\]\(([^)\s]+)\)", text)
    assert targets
    for link in targets:
        place, _, anchor = link.partition("#")
        page = (NOTEBOOK.parent / place).resolve()
        assert page.is_relative_to(ROOT)
        assert page.exists()
        assert not anchor or anchor in anchors(page)


@pytest.mark.slow
def test_its_cells_show_what_is_stored(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    notebook = read_notebook()
    for cell, (printed, value) in zip(code_cells(notebook), run_cells(notebook), strict=True):
        drawn = isinstance(value, Figure)
        text = printed + ("" if value is None or drawn else repr(value))
        kept, is_picture = stored(cell)
        assert (NUMBER.sub("#", text), drawn) == (NUMBER.sub("#", kept), is_picture), AGAIN
        now, before = ([float(number) for number in NUMBER.findall(shown)] for shown in (text, kept))
        assert now == pytest.approx(before, rel=0.01), AGAIN
    assert {"avc_coupling.c", "avc_coupling.h"} <= {path.name for path in tmp_path.iterdir()}
