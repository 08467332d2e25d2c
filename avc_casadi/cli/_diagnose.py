"""Diagnose a log of a loop that buzzes: the nearest single cause, the evidence, the remedy.

Reads the logs that `avc identify` reads. Names one of: delay, too much damping, encoder limit cycle, resonance,
stiffness over the limit, hand let go, dropped ticks, halved rate, a force switched by a sign, two rates in one loop; or
says that nothing is wrong, or that it cannot tell, between which two, and the log that would decide.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_log_layout, add_verbose, log_layout, positive
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_figure, write_text
from avc_casadi.cli._subject import load_known, load_problem

if TYPE_CHECKING:
    from avc_casadi.coupling import Coupling
    from avc_casadi.identification.diagnosis.model import Diagnosis
    from avc_casadi.model.device import Device
    from avc_casadi.model.problem import Hands

_PICTURES = (".png", ".svg", ".pdf")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument(
        "log", metavar="LOG", nargs="+", help=".csv, .txt, .json, .npy, .npz or .mat (v5): one record each"
    )
    add_log_layout(parser)
    parser.add_argument("--device", metavar="NAME|FILE", help="device or problem: what it was declared to be")
    parser.add_argument("--problem", metavar="P", help="problem: its device and its hands")
    parser.add_argument("--coupling", metavar="FILE", help="coupling.json that was meant to run")
    parser.add_argument(
        "--stiffness", type=positive, metavar="N/m", help="stiffness that was meant to run (N.m/rad of what turns)"
    )
    parser.add_argument(
        "--damping", type=positive, metavar="N.s/m", help="damping that was meant to run (N.m.s/rad of what turns)"
    )
    parser.add_argument("--plot", metavar="FILE", help="write a picture of each log (.png, .svg, .pdf)")
    parser.add_argument("--report", metavar="FILE", help="write a page with figures (.html)")
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Read, diagnose, write."""
    picture = output_file(args.plot, "--plot", _PICTURES) if args.plot else None
    page = output_file(args.report, "--report", (".html",)) if args.report else None
    if args.coupling and (args.stiffness or args.damping):
        raise avc.InputError.of("stands beside --stiffness or --damping; allowed: one of the two", key="--coupling")
    if args.device and args.problem:
        raise avc.InputError.of("stands beside --problem, which has a device; allowed: one of them", key="--device")
    layout = log_layout(args)
    device, hands = _declared(args)
    coupling = _coupling(args.coupling)
    from avc_casadi._util.units import spoken
    from avc_casadi.identification.diagnosis.diagnose import diagnose
    from avc_casadi.identification.diagnosis.told import diagnosis_document, diagnosis_text
    from avc_casadi.present.pages.logs import diagnosis_page

    found = [
        diagnose(
            log,
            layout=layout,
            device=device,
            hands=hands,
            coupling=coupling,
            stiffness_n_per_m=args.stiffness,
            damping_ns_per_m=args.damping,
            flip_force=args.flip_force,
            progress=console,
        )
        for log in args.log
    ]
    documents = [diagnosis_document(each) for each in found]
    document: dict[str, Any] = documents[0] if len(found) == 1 else {"schema": "avc-diagnose/1", "logs": documents}
    written = [] if picture is None else [str(path) for path in _pictures(found, picture)]
    if page is not None:
        _report(found, page, console)
        written.append(str(page))
    healthy = all(each.verdict == "nothing wrong" for each in found)
    code = 0 if healthy or all(each.cause for each in found) else 1
    text = diagnosis_page(found, spoken(), console.page, f"avc diagnose {' '.join(args.log)} -v", written)
    return Answer(document, text, code, more="\n\n".join(map(diagnosis_text, found)))


def _declared(args: argparse.Namespace) -> tuple[Device | None, Hands | None]:
    if args.problem:
        problem = load_problem(args.problem)
        return problem.device, problem.hands
    return (load_known(args.device).device if args.device else None), None


def _coupling(file: str | None) -> Coupling | None:
    if file is None:
        return None
    from avc_casadi.cli._subject import read_subject

    return read_subject("diagnose", file)


def _pictures(found: list[Diagnosis], picture: Path) -> list[Path]:
    from avc_casadi.present.figures.diagnosis import draw_diagnosis

    written = []
    for index, each in enumerate(found, start=1):
        path = picture if len(found) == 1 else picture.with_stem(f"{picture.stem}-{index}")
        write_figure(path, draw_diagnosis(each))
        written.append(path)
    return written


def _report(found: list[Diagnosis], page: Path, console: Console) -> None:
    with console.step("page"):
        from avc_casadi.cli._versions import package_versions
        from avc_casadi.present.report.logs import diagnosis_html

        write_text(page, diagnosis_html(found, package_versions()), "--report")
