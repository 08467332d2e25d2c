"""Long studies: cells of work, each written to a file as soon as it is done, so that a stopped study goes on."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from avc_casadi._util.json_values import json_text
from avc_casadi._util.progress import SILENT, Progress


def run_campaign(
    cells: Mapping[str, Callable[[], dict[str, Any]]],
    path: Path,
    about: dict[str, Any],
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Compute the cells that a file does not hold yet.

    Args:
        cells: name of each cell and what computes it, JSON values.
        path: JSON document; written anew after each cell.
        about: command, seed and whatever else the cells depend on. A file with another one is not continued.
        progress: told of each cell that is finished.

    Returns:
        The document {about, cells}.

    Raises:
        ValueError: the file belongs to another study.
    """
    document: dict[str, Any] = {"about": about, "cells": {}}
    if path.exists():
        found = json.loads(path.read_text(encoding="utf-8"))
        if found["about"] != about:
            raise ValueError(f"{path} holds another study: {found['about']}; move it away or repeat that one")
        document = found
    for name, compute in cells.items():
        if name in document["cells"]:
            continue
        document["cells"][name] = compute()
        text = json_text(document)
        partial = path.with_suffix(".partial")
        partial.write_text(text, encoding="utf-8")
        partial.replace(path)
        progress.advance(len(document["cells"]), len(cells), name)
    return document
