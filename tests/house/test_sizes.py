"""Functions and files that a reader can hold: ruff counts branches, statements and parameters, this counts lines."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
MOST_LINES_OF_A_FUNCTION, MOST_LINES_OF_A_FILE = 60, 600
FILES = [path for top in ("avc_casadi", "hardware") for path in sorted((ROOT / top).rglob("*.py"))]


@pytest.mark.slow
def test_no_function_is_longer_than_a_screen():
    long = []
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = node.end_lineno - node.lineno + 1
                if lines > MOST_LINES_OF_A_FUNCTION:
                    long.append(f"{path.relative_to(ROOT)}: {node.name} has {lines} lines")
    assert not long


def test_no_file_is_longer_than_a_room():
    sizes = {path.relative_to(ROOT): len(path.read_text(encoding="utf-8").splitlines()) for path in FILES}
    assert FILES
    assert not {str(path): lines for path, lines in sizes.items() if lines > MOST_LINES_OF_A_FILE}
