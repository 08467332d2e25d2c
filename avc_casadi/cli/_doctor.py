"""Show versions, solvers that really solve, compiler, ports and permissions."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
from importlib.util import find_spec

from avc_casadi.cli._arguments import add_verbose, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._ports import found_ports, ports_answer
from avc_casadi.cli._versions import package_versions

_PROGRAMS = ("cc", "gcc", "clang", "arm-none-eabi-gcc", "qemu-system-arm")
_NEEDED = "ipopt"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Show versions, solvers that really solve, compiler, ports and permissions. Every solver of the installed "
        "CasADi solves a small problem in a process of its own; its answer is checked, whatever it reports."
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
    """Check everything; 1 if the default solver does not solve."""
    from avc_casadi.cli._solver_trial import try_solvers
    from avc_casadi.present.pages.installation import installation_lines, installation_page, port_rows

    if args.ports:
        return ports_answer(args, console)

    with console.step("solvers"):
        solvers = try_solvers()
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
    well = any(trial["name"] == _NEEDED and trial["outcome"] == "solves" for trial in solvers)
    complaint = (
        "" if well else f"avc: {_NEEDED} does not solve; install casadi again: pip install --force-reinstall casadi"
    )
    text = installation_page(document, port_rows(ports, asked=args.ask), console.page, _NEEDED)
    more = "\n".join(installation_lines(document))
    return Answer(document, text, code=0 if well else 1, complaint=complaint, more=more)
