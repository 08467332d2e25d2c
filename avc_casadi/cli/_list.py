"""Show the catalogue of problems and devices."""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi._util.text import text_table
from avc_casadi.cli._console import Answer, Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; there are none."""
    parser.description = (
        "Show the catalogue: problems, files to run and to copy from, and devices, to name in a problem file."
    )


def run(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """List every problem and device with its title."""
    from avc_casadi.files.catalogue import device_names
    from avc_casadi.files.device_file import device_catalogue

    problems = [
        {"name": entry.name, "title": entry.title, "source": entry.source, "path": str(entry.path)}
        for entry in avc.catalogue()
    ]
    paths = device_names()
    devices = [
        {"name": file.name, "title": file.title, "gaps": list(file.gaps), "path": str(paths[file.name])}
        for file in device_catalogue()
    ]
    of_problems = [(entry.name, entry.title) for entry in avc.catalogue()]
    of_devices = [(file.name, file.title) for file in device_catalogue()]
    folder = avc.catalogue_path("figure5").parent
    return Answer(
        {"schema": "avc-list/2", "problems": problems, "devices": devices},
        f"{text_table(('problem', 'title'), of_problems, left=(0, 1))}\n\n"
        f"{text_table(('device', 'title'), of_devices, left=(0, 1))}\n"
        'in a problem file: device = "NAME"; what is known of one: avc check devices/NAME\n'
        f"files to copy from: {folder}",
    )
