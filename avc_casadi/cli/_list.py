"""Show the catalogue of problems."""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; there are none."""
    parser.description = "Show the catalogue of problems: files to run, and to copy from."


def run(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """List every problem with its title."""
    problems = [
        {"name": entry.name, "title": entry.title, "source": entry.source, "path": str(entry.path)}
        for entry in avc.catalogue()
    ]
    rows = [(entry["name"], entry["title"]) for entry in problems]
    folder = avc.catalogue_path("figure5").parent
    return Answer(
        {"schema": "avc-list/1", "problems": problems},
        table(("name", "title"), rows, left=(0, 1)) + f"\nfiles to copy from: {folder}",
    )
