"""--help of a benchmark script tells what it does and which files it overwrites, and runs nothing."""

import ast
import re
import runpy
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parent / "benchmarks"
SCRIPTS = sorted(path for path in BENCHMARKS.glob("*.py") if "__main__" in path.read_text(encoding="utf-8"))


def result_files(source):
    """Names of files that the code, not its docstrings, speaks of."""
    constants = (node.value for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Constant))
    return {text for text in constants if isinstance(text, str) and re.fullmatch(r"\w+\.(md|json|png)", text)}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_help_names_the_files_and_ends(script, capsys, monkeypatch):
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    monkeypatch.setattr(sys, "argv", [str(script), "--help"])
    before = {path: path.stat().st_mtime_ns for path in BENCHMARKS.rglob("*") if "__pycache__" not in path.parts}
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(script), run_name="__main__")
    said = capsys.readouterr().out
    assert end.value.code == 0
    assert said.startswith("usage:")
    source = script.read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(source)).split(".")[0].split(":")[0] in " ".join(said.split())
    named = result_files(source)
    assert all(name in said for name in named)
    assert not named or "verwrites" in said
    after = {path: path.stat().st_mtime_ns for path in before}
    assert after == before
