"""Verbs that look: list, check, explore, doctor, accuracy, table1."""

from __future__ import annotations

import argparse
import platform
import shutil
import sys
from contextlib import suppress
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING

import avc_casadi as avc
import avc_hardware
from avc_casadi._util.interrupt import take_interrupt
from avc_casadi._util.json_values import plain
from avc_casadi._util.page import worded
from avc_casadi.cli import arguments as cli
from avc_casadi.cli.console import Console, package_versions, write_figure
from avc_casadi.present import rows
from avc_casadi.present.row import Answer

if TYPE_CHECKING:
    from avc_casadi.present.rows.look import AvcDevice, SerialPort
    from avc_hardware.link.connection import Port


_HANDS = "set the number of simulated hands of each set (default: 200)"


@cli.verb()
def run_list(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """List the built-in problems and devices.

    A command takes the name of a problem in place of a file. A problem file takes the name of a device:
    device = "NAME".
    """
    from avc_casadi.files.catalogue import admittance_catalogue, device_names

    devices = []
    for name, path in device_names().items():
        file = avc.load_device(name)
        devices.append(rows.look.CatalogueDevice(file.name, file.title, file.gaps, str(path)))
    folder = str(avc.catalogue_path("figure5").parent)
    return rows.look.catalogue(avc.catalogue(), admittance_catalogue(), devices, folder)


@cli.verb(cli.argument("problem", metavar="P", text="problem or device: file, or built-in name"), cli.VERBOSE)
def run_check(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """Check a problem or device file for errors and unusual values, and show its meaning."""
    from avc_casadi.cli import admittance
    from avc_casadi.files.admittance_file import is_admittance
    from avc_casadi.files.plausibility import plausibility
    from avc_casadi.files.problem_file import is_device
    from avc_casadi.recommendation.preconditions import not_used
    from avc_casadi.recommendation.refusals import refusal

    if is_admittance(args.problem):
        return admittance.checked(args.problem)
    if is_device(args.problem):
        return rows.look.device(avc.load_device(args.problem), args.problem.removeprefix("devices/"))
    stated = avc.load_problem(args.problem)
    warnings = [rows.look.Doubt(fault.key, fault.message) for fault in plausibility(stated)]
    warnings += rows.look.doubts_of(stated.end, stated)
    refused = refusal(stated.end, stated)
    why = "" if refused is None else worded(refused, stated.units)
    result = rows.look.CheckedProblem(stated, not_used(stated), tuple(warnings), why)
    return rows.look.problem(result, args.problem)


@cli.verb(
    cli.argument("problem", metavar="P", nargs="?", default="figure5", text="problem file or name (default: figure5)"),
    cli.numeric("--port", "set the port of 127.0.0.1 (default: a free port)", default=0, metavar="N"),
    cli.flag("--open", "open the page in the browser"),
)
def run_explore(args: argparse.Namespace, console: Console) -> Answer:
    """Explore a problem in the browser, with sliders for device, wall and hands.

    The page shows how each value changes the coupling, and shows the equivalent commands.
    The page saves problem and coupling. Only this computer can open it. Stop the page with Ctrl-C.
    """
    import threading
    import webbrowser

    from avc_casadi.files.admittance_file import is_admittance
    from avc_casadi.files.problem_file import require_device
    from avc_casadi.present.explore.admittance import with_law
    from avc_casadi.present.explore.explorer import Explorer
    from avc_casadi.present.explore.server import ExploreServer, warm
    from avc_casadi.present.explore.settings import Explored

    if is_admittance(args.problem):
        problem: Explored = with_law(avc.load_admittance(args.problem))
    else:
        problem = require_device(args.problem)
    explorer = Explorer(problem, args.problem, package_versions())
    try:
        server = ExploreServer(explorer, args.port)
    except (OSError, OverflowError) as error:
        raise avc.InputError.of(f"is {args.port}: {error}; leave it out for a free port", key="--port") from error
    with server:
        try:
            console.say(": ".join(filter(None, (problem.name, problem.title))))
            console.say(f"open {server.url} in a browser on this machine; Ctrl-C ends it")
            if console.as_json:
                console.complain(server.url)
            if args.open:
                webbrowser.open(server.url)
            threading.Thread(target=warm, args=(explorer,), daemon=True).start()
            server.serve_forever()
        except KeyboardInterrupt:
            take_interrupt()
            explorer.close()
    return Answer("explore", {"problem": problem.name, "url": server.url})


@cli.verb(
    cli.flag("--ports", "list the serial ports only, USB devices first"),
    cli.flag("--ask", "open each port and identify its avc device; this restarts some boards, such as Arduino"),
    cli.BAUD,
)
def run_doctor(args: argparse.Namespace, console: Console) -> Answer:
    """Check the installation: versions, solvers, compilers, serial ports and permissions.

    Each solver of the method `direct` solves a small problem, and the solution is checked.
    """
    from avc_casadi.paper.nlp_solver import SOLVERS

    ports = tuple(_asked(port, args.baud, console) if args.ask else _port(port) for port in avc_hardware.list_ports())
    if args.ports:
        shown = rows.look.ports(ports, asked=args.ask)
        title = ("serial ports; if you have no device, use --port emulator",)
        return Answer("ports", {"ports": plain(ports)}, title, tuple(shown))
    with console.step("solvers"):
        small = avc.load_problem("soft").changed(frequency={"points": 2})
        solvers = {name: "failed" not in avc.solve(small, solver=name).status for name in SOLVERS}
    compilers = ("cc", "gcc", "clang", "arm-none-eabi-gcc", "qemu-system-arm")
    result = rows.look.Installation(
        executable=sys.executable,
        platform=platform.platform(),
        packages=package_versions(),
        solvers=solvers,
        programs={name: shutil.which(name) for name in compilers},
        emulator=find_spec("unicorn") is not None,
        ports=ports,
    )
    return rows.look.installation(result, asked=args.ask)


def _port(port: Port) -> SerialPort:
    """Return a serial port as an answer has it."""
    return rows.look.SerialPort(port.device, port.description, port.serial_number, port.accessible)


def _asked(port: Port, baud: int, console: Console) -> SerialPort:
    """Return a serial port with the avc device that answers there, if one does."""
    shown = _port(port)
    if port.accessible:
        with console.step(port.device), suppress(avc.LinkError):  # where no avc device answers
            return replace(shown, avc_device=_avc_device(port.device, baud))
    return shown


def _avc_device(port: str, baud: int) -> AvcDevice:
    """Return what the avc device at a port says of itself."""
    with avc_hardware.Connection(avc_hardware.open_link(port, baud=baud), baud=baud) as connection:
        device = connection.device
    return rows.look.AvcDevice(
        build=device.build,
        sample_time_s=device.sample_time_s,
        faults=device.faults,
        unique_id=device.unique_id,
        coupling_id=device.coupling_id,
    )


@cli.verb(cli.PROBLEM, cli.plot("time against error"), cli.VERBOSE)
def run_accuracy(args: argparse.Namespace, console: Console) -> Answer:
    """Measure time and error of the paper's methods and solvers, over tolerances.

    The tolerances of the solvers are 1e-2 to 1e-12. An error is the distance to the true optimum,
    which the method `exact` computes by geometry. The command takes about a minute.
    """
    from avc_casadi.design.comparison.accuracy import Accuracy, solver_costs

    problem = avc.load_problem(args.problem)
    with console.step("time and error of each solver"):
        costs = solver_costs(problem, console)
    write_figure(console, args.plot, lambda: avc.figures.draw_accuracy(costs))
    return rows.look.accuracy(Accuracy(problem.name, tuple(costs)))


@cli.verb(
    cli.numeric("--hands", _HANDS, default=200, metavar="N"),
    cli.numeric("--seed", "set the seed of the hands (default: 2026)", default=2026, metavar="S"),
    *cli.WORKERS,
)
def run_table1(args: argparse.Namespace, console: Console) -> Answer:
    """Reproduce the paper's Table 1 with simulated hands.

    The table shows with which couplings a wall is stable, and which coupling feels most like the wall.
    Walls VE4 to VE6 are fitted to the paper's results without coupling; all other values are predicted.
    The command takes about a minute, even with few hands.
    """
    from avc_casadi._util.parallel import processors
    from avc_casadi.design.comparison.table1 import table1

    workers = args.workers or processors()
    with cli.executor_of(args) as executor, console.step("hands at the walls of the paper"):
        return rows.look.table1(table1(args.hands, args.seed, workers=workers, executor=executor, progress=console))
