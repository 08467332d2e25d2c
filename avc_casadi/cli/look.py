"""Verbs that look: list, check, explore, doctor, accuracy, table1."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi._util.interrupt import take_interrupt
from avc_casadi.cli.arguments import add_verbose, add_workers, is_device, positive_int
from avc_casadi.cli.console import PICTURES, Console, output_file, package_versions, write_figure

if TYPE_CHECKING:
    from avc_casadi.present.row import Answer

_PROGRAMS = ("cc", "gcc", "clang", "arm-none-eabi-gcc", "qemu-system-arm")


def add_list(parser: argparse.ArgumentParser) -> None:
    """Show the catalogue of problems and devices.

    Problems are files to run and to copy from, devices are names to give in a problem file.
    """


def run_list(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """List every problem and device with its title."""
    from avc_casadi.files.catalogue import device_names
    from avc_casadi.files.device_file import device_catalogue
    from avc_casadi.present.rows.look import catalogue

    problems = [
        {"name": entry.name, "title": entry.title, "source": entry.source, "path": str(entry.path)}
        for entry in avc.catalogue()
    ]
    paths = device_names()
    devices = [
        {"name": file.name, "title": file.title, "gaps": list(file.gaps), "path": str(paths[file.name])}
        for file in device_catalogue()
    ]
    return catalogue({"problems": problems, "devices": devices}, str(avc.catalogue_path("figure5").parent))


def add_check(parser: argparse.ArgumentParser) -> None:
    """Check a problem file or a device file and show what it means."""
    parser.add_argument("problem", metavar="P", help="problem or device: a file, or a name of the catalogue")
    add_verbose(parser)


def run_check(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """Load the problem or the device; its faults are raised."""
    from avc_casadi._util.json_values import plain
    from avc_casadi.files.plausibility import plausibility
    from avc_casadi.loops.sampled_loop import passive_limit_n_per_m
    from avc_casadi.model.declared import declared
    from avc_casadi.present.rows import look
    from avc_casadi.recommendation.preconditions import not_used, why_infeasible
    from avc_casadi.recommendation.virtual_tool import unusual

    if is_device(args.problem):
        return _device(args.problem)
    stated = avc.load_problem(args.problem)
    frequency, device, tool, follower = stated.frequencies_hz(), stated.device, stated.simulation, stated.follower
    warnings = [{"key": fault.key, "message": fault.message} for fault in plausibility(stated)]
    if tool is not None:
        warnings += [{"key": f"simulation.{key}", "message": text} for key, text in unusual(stated).items()]
    elif follower is None and (why := why_infeasible(stated)):
        warnings.append({"key": "avc recommend", "message": f"deploys nothing: {why}"})
    data = {
        "valid": True,
        "problem": stated.name,
        "title": stated.title,
        "source": stated.source,
        "structure": stated.coupling.structure,
        "model": stated.stability.model,
        "scope": stated.stability.scope,
        "frequencies": len(frequency),
        "lowest_hz": float(frequency.min()),
        "highest_hz": float(frequency.max()),
        "nyquist_hz": 0.5 / device.sample_time_s,
        "environment_stiffness_n_per_m": stated.environment.stiffness_n_per_m,
        "passive_limit_n_per_m": plain(passive_limit_n_per_m(device)),
        "simulation": None if tool is None else tool.model_dump(mode="json"),
        "follower": None if follower is None else follower.model_dump(mode="json"),
        "declared": list(declared(stated)),
        "not_used": list(not_used(stated)),
        "warnings": warnings,
    }
    return look.problem(data, stated, args.problem)


def _device(source: str) -> Answer:
    """Check a device file; its faults are raised."""
    from avc_casadi.files.catalogue import device_names
    from avc_casadi.present.rows.look import device

    file = avc.load_device(source)
    values = file.device.model_dump(mode="json", exclude_unset=True)
    ranges, known = values.pop("range", {}), device_names().get(file.name)
    elsewhere = source.endswith(".toml") and (known is None or Path(source).resolve() != Path(str(known)).resolve())
    data: dict[str, Any] = {
        "valid": True,
        "device": file.name,
        "title": file.title,
        "values": values,
        "range": ranges,
        "sources": {key: source.model_dump() for key, source in file.sources.items()},
        "gaps": list(file.gaps),
        "referred_as": Path(source).name if elsewhere else file.name,
        "sdk_example": None if file.sdk_example is None else file.sdk_example.model_dump(exclude_none=True),
    }
    return device(data, file.device.units)


def add_explore(parser: argparse.ArgumentParser) -> None:
    """Turn knobs on a local page: device, hands, and wall or engine as sliders beside what they make of a coupling.

    The page is served to this machine alone (127.0.0.1, a random token in its address), needs no network and ends with
    Ctrl-C. Its settings stand in its address; it saves problem and coupling as files, and shows the commands for the
    same.
    """
    parser.add_argument(
        "problem", metavar="P", nargs="?", default="figure5", help="problem file or name of the catalogue; figure5"
    )
    parser.add_argument("--port", type=_port, default=0, metavar="N", help="port of 127.0.0.1; default any free one")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")


def run_explore(args: argparse.Namespace, console: Console) -> Answer:
    """Serve until Ctrl-C."""
    import webbrowser

    from avc_casadi.present.explore.explorer import Explorer
    from avc_casadi.present.explore.server import ExploreServer
    from avc_casadi.present.row import Answer as Result

    problem = avc.load_problem(args.problem)
    explorer = Explorer(problem, args.problem, package_versions())
    try:
        server = ExploreServer(explorer, args.port)
    except OSError as error:
        raise avc.InputError.of(f"{args.port} cannot be used: {error.strerror}; leave it out", key="--port") from error
    with server:
        try:
            console.say(": ".join(filter(None, (problem.name, problem.title))))
            console.say(f"open {server.url} in a browser on this machine; Ctrl-C ends it")
            if console.as_json:
                console.complain(server.url)
            if args.open:
                webbrowser.open(server.url)
            server.serve_forever()
        except KeyboardInterrupt:
            take_interrupt()
            explorer.close()
    return Result("explore", {"problem": problem.name, "url": server.url})


def _port(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) < 65536):
        raise argparse.ArgumentTypeError(f"{text!r} is no port; allowed: 0 to 65535")
    return int(text)


def add_doctor(parser: argparse.ArgumentParser) -> None:
    """Show versions, solvers, compiler, ports and permissions.

    Each solver of the method direct solves a small problem; its answer is checked, whatever it reports.
    """
    parser.add_argument("--ports", action="store_true", help="list the serial ports alone, USB devices first")
    parser.add_argument(
        "--ask",
        action="store_true",
        help="open each port and ask which avc device is there; whatever else is there is sent a few bytes, "
        "and boards like the Arduino start anew",
    )
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate for --ask; default 115200")
    add_verbose(parser)


def run_doctor(args: argparse.Namespace, console: Console) -> Answer:
    """Check everything; 1 if a solver does not solve."""
    from avc_casadi.paper.backends import SOLVERS
    from avc_casadi.present.row import Answer as Result
    from avc_casadi.present.rows.look import installation, ports

    found = _ports(args, console)
    rows = ports(found, asked=args.ask)
    if args.ports:
        return Result("ports", {"ports": found}, ("serial ports",), tuple(rows), ("without a device: --port emulator",))
    with console.step("solvers"):
        small = avc.load_problem("soft").changed(frequency={"points": 2})
        solvers = {name: "failed" not in avc.solve(small, solver=name).status for name in SOLVERS}
    renamed = {"port": "device", "description": "description", "permitted": "accessible"}
    data = {
        "executable": sys.executable,
        "platform": platform.platform(),
        "packages": package_versions(),
        "solvers": solvers,
        "programs": {name: shutil.which(name) for name in _PROGRAMS},
        "emulator": find_spec("unicorn") is not None,
        "ports": [
            {name: port[key] for name, key in renamed.items()}
            | {key: port[key] for key in ("serial_number", "avc_device")}
            for port in found
        ],
        "folder_writable": os.access(".", os.W_OK),
    }
    return installation(data, rows)


def _ports(args: argparse.Namespace, console: Console) -> list[dict[str, Any]]:
    """List the ports, with --ask with the device behind each; it is None where none was queried or none answers."""
    from avc_hardware import list_ports

    found: list[dict[str, Any]] = [vars(port) for port in list_ports()]
    for port in found:
        with console.step(port["device"]):
            port["avc_device"] = _hello(port["device"], args.baud) if args.ask and port["accessible"] else None
    return found


def _hello(port: str, baud: int) -> dict[str, Any] | None:
    """Send HELLO; None where no avc device answers."""
    from avc_hardware import Connection, open_link

    try:
        with Connection(open_link(port, baud=baud), baud=baud) as connection:
            device = connection.device
    except avc.LinkError:
        return None
    return {
        "unique_id": device.unique_id or None,
        "build": device.build,
        "coupling_id": device.coupling_id or None,
        "sample_time_s": device.sample_time_s,
        "faults": device.faults,
    }


def add_accuracy(parser: argparse.ArgumentParser) -> None:
    """Measure what accuracy costs in time: methods and solvers over tolerances against the true optimum.

    Every method, and every solver over tolerances from 1e-2 to 1e-12, against the true optimum of each frequency, which
    `exact` finds by geometry. Takes about a minute.
    """
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--plot", metavar="FILE", help="draw time against error: .png, .svg or .pdf")
    add_verbose(parser)


def run_accuracy(args: argparse.Namespace, console: Console) -> Answer:
    """Measure, draw and show."""
    from avc_casadi.design.comparison.accuracy import accuracy_document, solver_costs
    from avc_casadi.present.rows.look import accuracy

    plot = None if args.plot is None else output_file(args.plot, "--plot", PICTURES)
    problem = avc.load_problem(args.problem)
    with console.step("time and error of each solver"):
        costs = solver_costs(problem, console)
    if plot is not None:
        from avc_casadi.present.figures.accuracy import draw_accuracy

        with console.step("figure"):
            write_figure(plot, draw_accuracy(costs))
    return accuracy(accuracy_document(problem, costs))


def add_table1(parser: argparse.ArgumentParser) -> None:
    """Rebuild the paper's Table 1 with simulated hands: stable or not, and which coupling feels like the wall.

    Six walls, nine couplings, two populations of hands, three motions. Walls VE4 to VE6 are calibrated to the paper's
    column without coupling; every other count is predicted. 200 hands take about a minute on two cores.
    """
    parser.add_argument("--hands", type=positive_int, default=200, metavar="N", help="hands of each set (default 200)")
    parser.add_argument(
        "--seed", type=int, default=2026, metavar="S", help="seed of the hands; the same seed, the same counts"
    )
    add_workers(parser)
    add_verbose(parser)


def run_table1(args: argparse.Namespace, console: Console) -> Answer:
    """Try all hands and count."""
    from avc_casadi._util.parallel import cluster, processors
    from avc_casadi.design.comparison.table1 import table1 as study
    from avc_casadi.present.rows.look import table1

    workers = processors() if args.workers is None else args.workers
    with cluster(args.scheduler) as executor, console.step("hands at the walls of the paper"):
        return table1(study(args.hands, args.seed, workers=workers, executor=executor, progress=console))
