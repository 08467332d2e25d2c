"""Run the cells of docs/tutorial.ipynb in their order, and store what they show beside them.

OPENBLAS_NUM_THREADS=1 python tests/benchmarks/write_tutorial.py

Overwrites the outputs in docs/tutorial.ipynb. Jupyter is not needed: a notebook is JSON, and its cells are Python.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from PIL import Image
from script_arguments import script_arguments

NOTEBOOK = Path(__file__).parents[2] / "docs" / "tutorial.ipynb"
PICTURE_DPI = 100
"""Resolution of a picture: readable on a screen, and small in the file."""
PICTURE_COLOURS = 255
"""Colours of a picture. Line drawings need no more, and the file is half the size."""


def read_notebook() -> dict[str, Any]:
    """Return the stored notebook."""
    return dict(json.loads(NOTEBOOK.read_text(encoding="utf-8")))


def code_cells(notebook: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the cells that have code."""
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


def run_cells(notebook: dict[str, Any]) -> Iterator[tuple[str, object]]:
    """Run the code in one namespace, in the working directory; yield the text and the value that each cell shows."""
    names: dict[str, Any] = {}
    for number, cell in enumerate(code_cells(notebook), start=1):
        tree = ast.parse("".join(cell["source"]), f"cell {number}")
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        printed, value = io.StringIO(), None
        with contextlib.redirect_stdout(printed):
            exec(compile(tree, f"cell {number}", "exec"), names)  # noqa: S102 - the project's own page
            if isinstance(last, ast.Expr):
                value = eval(compile(ast.Expression(last.value), f"cell {number}", "eval"), names)  # noqa: S307
        yield printed.getvalue(), value


def outputs(number: int, text: str, value: object) -> list[dict[str, Any]]:
    """Return what a cell shows, as a notebook stores it."""
    shown: list[dict[str, Any]] = []
    if text:
        shown.append({"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)})
    if value is not None:
        data = {"image/png": picture(value)} if isinstance(value, Figure) else {"text/plain": [repr(value)]}
        result = {"output_type": "execute_result", "execution_count": number, "metadata": {}, "data": data}
        shown.append(result)
    return shown


def picture(figure: Figure) -> str:
    """Return a figure as a small PNG in base 64."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, format="png", dpi=PICTURE_DPI)
    image = Image.open(drawn).convert("RGB").quantize(PICTURE_COLOURS)
    image.save(small, format="png", optimize=True)
    return base64.b64encode(small.getvalue()).decode("ascii")


def main() -> None:
    script_arguments(__doc__)
    notebook = read_notebook()
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        shown = list(run_cells(notebook))
    for number, (cell, (text, value)) in enumerate(zip(code_cells(notebook), shown, strict=True), start=1):
        cell |= {"execution_count": number, "outputs": outputs(number, text, value)}
    NOTEBOOK.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
