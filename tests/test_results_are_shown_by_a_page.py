"""Every results file and picture of the benchmarks is shown by a page, and every script there is run by somebody."""

import json
import re

import pytest
from documentation import PAGES, ROOT, links
from documented_results import BLOCKS
from measured_code import imported
from remake_results import STUDIES

BENCHMARKS = ROOT / "tests" / "benchmarks"
RESULTS = sorted((BENCHMARKS / "results").glob("*.json"))
SHOWN = {(page.parent / link.partition("#")[0]).resolve() for page in PAGES for link in links(page)}
TEXTS = {path: path.read_text(encoding="utf-8") for path in PAGES}
CODE = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / "tests").rglob("*.py"))}
SCRIPTS = sorted(BENCHMARKS.glob("*.py"))


def written_from(name):
    """Pages and pictures that the scripts name which have a results file as theirs."""
    scripts = [BENCHMARKS / study.script.split()[0] for study in STUDIES if name in study.results]
    scripts += [path for path in SCRIPTS if path.name != "remake_results.py" and f'"{name}.json"' in CODE[path]]
    parts = {path for script in scripts for path in imported(script) if path in SCRIPTS}
    for script in {*scripts, *parts}:
        for found in re.findall(r"(?<=\")(?:RESULTS_\w+\.md|\w+\.png)(?=\")", CODE[script]):
            yield BENCHMARKS / ("figures" if found.endswith(".png") else "") / found


@pytest.mark.parametrize("results", RESULTS, ids=lambda path: path.stem)
def test_a_results_file_is_shown_or_read(results):
    of_block = results.stem in {block.source for block in BLOCKS.values()}
    of_page = any(path in SHOWN for path in written_from(results.stem))
    of_test = any(f'"{results.name}"' in text for path, text in CODE.items() if path.parent == ROOT / "tests")
    assert of_block or of_page or of_test, "shown by no page and read by no test: delete it, or show it"


def test_every_page_of_results_and_every_picture_is_linked():
    made = {*BENCHMARKS.glob("RESULTS_*.md"), *(BENCHMARKS / "figures").iterdir()}
    assert not made - SHOWN
    assert len(made) > 15


def test_every_script_is_named_by_a_page_or_imported():
    recorded = json.loads((BENCHMARKS / "results" / "recorded.json").read_text(encoding="utf-8"))["findings"].values()
    named = "\n".join([*TEXTS.values(), *(one["about"]["command"] for one in recorded)])
    taken = {name for text in CODE.values() for name in re.findall(r"^ *(?:from|import) (\w+)", text, re.MULTILINE)}
    idle = {path.stem for path in SCRIPTS if not re.search(rf"\b{path.stem}\b", named)} - taken
    assert not idle


def test_a_file_that_a_page_shows_is_found():
    assert any(path in SHOWN for path in written_from("proofs_of_rest_walls"))
