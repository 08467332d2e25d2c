"""Show versions, solvers, compiler, ports and permissions."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
from importlib.util import find_spec

import avc_casadi as avc
from avc_casadi.cli._arguments import add_verbose, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._ports import found_ports, ports_answer
from avc_casadi.cli._versions import package_versions

_PROGRAMS = ("cc", "gcc", "clang", "arm-none-eabi-gcc", "qemu-system-arm")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Show versions, solvers, compiler, ports and permissions. Each solver of the method direct solves a small "
        "problem; its answer is checked, whatever it reports."
    )
    parser.add_argument("--ports", action="store_true", help="list the serial ports alone, USB devices first")
    parser.add_argument(
        "--ask",
        action="store_true",
        help="open each port and ask which avc device is there; whatever else is there is sent a few bytes, "
        "and boards like the Arduino start anew",
    )
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate for --ask; default 115200")
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Check everything; 1 if a solver does not solve."""
    from avc_casadi.present.pages.installation import installation_lines, installation_page, port_rows

    if args.ports:
        return ports_answer(args, console)

    with console.step("solvers"):
        solvers = _solvers()
    ports = found_ports(args, console)
    document = {
        "schema": "avc-doctor/1",
        "executable": sys.executable,
        "platform": platform.platform(),
        "packages": package_versions(),
        "solvers": solvers,
        "programs": {name: shutil.which(name) for name in _PROGRAMS},
        "emulator": find_spec("unicorn") is not None,
        "ports": [
            {
                "port": port["device"],
                "description": port["description"],
                "permitted": port["accessible"],
                "serial_number": port["serial_number"],
                "avc_device": port["avc_device"],
            }
            for port in ports
        ],
        "folder_writable": os.access(".", os.W_OK),
    }
    bad = ", ".join(name for name, solves in solvers.items() if not solves)
    complaint = f"avc: {bad} does not solve; install casadi again: pip install --force-reinstall casadi" if bad else ""
    text = installation_page(document, port_rows(ports, asked=args.ask), console.page)
    more = "\n".join(installation_lines(document))
    return Answer(document, text, code=1 if bad else 0, complaint=complaint, more=more)


def _solvers() -> dict[str, bool]:
    """Return whether each solver solves a small problem, by the recomputed answer."""
    from avc_casadi.paper.backends import SOLVERS

    problem = avc.load_problem("soft").changed(frequency={"points": 2})
    return {name: "failed" not in avc.solve(problem, solver=name).status for name in SOLVERS}
