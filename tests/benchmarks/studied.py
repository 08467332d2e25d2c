"""What the studies of `recommend` share: cells that are computed once, what they cost, where they ran, their pages."""

from __future__ import annotations

import json
import os
import platform
import resource
import subprocess
import time
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import PRINTED

import avc_casadi as avc
from avc_casadi._util.progress import SILENT, Progress

HERE = Path(__file__).parent
_PACKAGES = ("casadi", "numpy", "scipy")


def about(command: str, seed: int) -> dict[str, Any]:
    """Say what made the results; the commit is the last one that changed the package."""
    found = subprocess.run(
        ["git", "log", "-1", "--format=%h", "--", "avc_casadi"],  # noqa: S607
        cwd=HERE.parents[1],
        capture_output=True,
        text=True,
        check=False,
    )
    return {
        "command": command,
        "seed": seed,
        "avc_casadi": avc.__version__,
        "commit": found.stdout.strip(),
        "machine": f"{platform.machine()}, {os.cpu_count()} cores shared with other work",
        "versions": {"python": platform.python_version()} | {name: version(name) for name in _PACKAGES},
    }


def kept_rows(out: Path, about: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the rows of a results file that the same package made, with the same seed; none of another."""
    if not out.exists():
        return []
    kept = json.loads(out.read_text(encoding="utf-8"))
    same = all(kept["about"][key] == about[key] for key in ("commit", "seed", "command"))
    return list(kept["rows"]) if same else []


def write_rows(out: Path, about: Mapping[str, Any], rows: Iterable[Mapping[str, Any]]) -> None:
    """Overwrite a results file, a line for each row."""
    lines = ",\n".join(json.dumps(row) for row in rows)
    out.write_text(f'{{"about": {json.dumps(about)},\n"rows": [\n{lines}\n]}}\n', encoding="utf-8")


def made_by(about: Mapping[str, Any]) -> str:
    """Return the sentence below the title of a page."""
    versions = ", ".join(f"{name} {value}" for name, value in about["versions"].items())
    return (
        f"Made by `{about['command']}` (seed {about['seed']}) with avc-casadi {about['avc_casadi']}, package as of "
        f"commit {about['commit']}; {about['machine']}; {versions}."
    )


def run_campaign(
    cells: Mapping[str, Callable[[], dict[str, Any]]],
    path: Path,
    about: dict[str, Any],
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Compute the cells that a file does not hold yet."""
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
        partial = path.with_suffix(".partial")
        partial.write_text(campaign_text(document), encoding="utf-8")
        partial.replace(path)
        progress.advance(len(document["cells"]), len(cells), name)
    return document


def campaign_text(document: Mapping[str, Any]) -> str:
    """Return the JSON of a campaign, a line for each cell: a cell that changes is one line that changes."""
    cells = (f"{json.dumps(name)}: {json.dumps(cell, allow_nan=False)}" for name, cell in document["cells"].items())
    lines = ",\n".join(cells)
    return f'{{"about": {json.dumps(document["about"])},\n"cells": {{\n{lines}\n}}}}\n'


def computed(
    cells: Mapping[str, Callable[[], dict[str, Any]]],
    out: Path,
    about: dict[str, Any],
    write_page: Callable[[dict[str, Any]], None] = lambda _: None,
) -> None:
    """Compute the cells that the file does not hold yet, and write the page after each.

    A cell that ends with an exception is kept as that exception: it is a result.
    """
    out.parent.mkdir(exist_ok=True)
    for name, compute in cells.items():
        write_page(run_campaign({name: lambda compute=compute: _kept(compute)}, out, about, PRINTED))


def _kept(compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    wall, cpu = time.perf_counter(), cpu_seconds()
    try:
        found = compute()
    except Exception as error:  # noqa: BLE001
        found = {"error": f"{type(error).__name__}: {error}"}
    return found | {"cell_wall_s": round(time.perf_counter() - wall, 1), "cell_cpu_s": round(cpu_seconds() - cpu, 1)}


def cpu_seconds() -> float:
    """Processor time of this process and of the compilers that it started."""
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


def rendered_n_per_m(trial: Any) -> float | None:
    """Median stiffness of the hands that come to rest in a press and do not lean on the force limit."""
    rest = trial.stiffness_n_per_m[trial.by_motion["press"] & np.isfinite(trial.stiffness_n_per_m)]
    return float(np.median(rest)) if len(rest) else None


def expected_n_per_m(coupling: Any) -> float:
    """Stiffness of coupling and wall in series."""
    k, wall = coupling.table.at_rest.stiffness_n_per_m, coupling.wall.stiffness_n_per_m
    return float(k * wall / (k + wall))


def table(head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a table in Markdown."""
    head = list(head)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(str(value) for value in line) + " |" for line in lines)


def percent(share: float) -> str:
    """A share, with as many digits as it has."""
    return f"{100 * share:.3g}"


def rounded(value: float | None, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent; a dash for none."""
    if value is None or not np.isfinite(value):
        return "-"
    return f"{float(f'{value:.{digits}g}'):,.10g}".replace(",", " ")
