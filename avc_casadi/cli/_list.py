"""Show the catalogue of problems, devices and arms."""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments; there are none."""
    parser.description = (
        "Show the catalogue: problems, files to run and to copy from; devices, to name in a problem file; and arms, "
        "devices of several axes, for avc arm."
    )


def run(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """List every problem, device and arm with its title."""
    from avc_casadi.files.arm_file import load_arm
    from avc_casadi.files.catalogue import arm_names, device_names
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
    arms = [
        {"name": name, "title": file.title, "source": file.source, "path": str(path)}
        for name, path in arm_names().items()
        for file in (load_arm(name),)
    ]
    of_problems = [(entry.name, entry.title) for entry in avc.catalogue()]
    of_devices = [(file.name, file.title) for file in device_catalogue()]
    folder = avc.catalogue_path("figure5").parent
    return Answer(
        {"schema": "avc-list/1", "problems": problems, "devices": devices, "arms": arms},
        f"{table(('problem', 'title'), of_problems, left=(0, 1))}\n\n"
        f"{table(('device', 'title'), of_devices, left=(0, 1))}\n"
        'in a problem file: device = "NAME"; what is known of one: avc check devices/NAME\n\n'
        f"{table(('arm', 'title'), [(one['name'], one['title']) for one in arms], left=(0, 1))}\n"
        f"files to copy from: {folder}",
    )
