"""Send a whole gain table to a device, swapped at once and read back."""

from __future__ import annotations

import argparse
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi.cli._arguments import add_port, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import number

if TYPE_CHECKING:
    from avc_casadi.coupling import GainSchedule
    from avc_hardware import TableSettings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("gains", metavar="GAINS", help="gain file, .json or .csv")
    add_port(parser)
    parser.add_argument("--baud", type=positive_int, default=115200, help="rate of a serial port; default 115200")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Push; a refusal is raised."""
    from avc_casadi.coupling import read_gains
    from avc_casadi.support import plain
    from avc_hardware import push

    gains = read_gains(Path(args.gains))
    with console.step(f"push to {args.port}"):
        document = plain({"schema": "avc-push/1"} | push(gains, args.port, baud=args.baud).document())
    document["widest_hole_hz"] = widest_hole(gains)
    equal = document["readback_equal"]
    lines = [
        (
            f"{document['rows']} rows on {document['port']} in {document['seconds']:.3g} s "
            f"({document['attempts']} attempt{'s' if document['attempts'] > 1 else ''}); table {document['table_id']}, "
            f"CRC {document['crc32']:08x}"
        ),
        (
            f"read back {'equal' if equal else 'NOT EQUAL'}; rounding to single precision changed a gain by at most "
            f"{document['rounding_max']:.1e} (relative)"
        ),
    ]
    if document["left_out"]:
        lines.append(f"{document['left_out']} rows without gains were left out")
    if document["widest_hole_hz"] is not None:
        low, high = (number(end) for end in document["widest_hole_hz"])
        lines.append(f"the device interpolates across the holes they leave; the widest is from {low} to {high} Hz")
    if document["reduction_error"] is not None and document["reduced_from"] > document["rows"]:
        lines.append(
            f"cut from {document['reduced_from']} rows to the device's capacity; that adds at most "
            f"{document['reduction_error']:.1e} (relative)"
        )
    complaint = "" if equal else f"avc: {args.port}: the table read back is not the one sent; push again"
    return Answer(document, "\n".join(lines), code=0 if equal else 1, complaint=complaint)


def widest_hole(gains: GainSchedule) -> list[float] | None:
    """Return the ends, in Hz, of the widest run of rows without gains between rows with gains; None without one."""
    kept = [row for row in range(gains.rows) if gains.usable[row]]
    holes = [(gains.frequency_hz[a], gains.frequency_hz[b]) for a, b in pairwise(kept) if b > a + 1]
    return [float(end) for end in max(holes, key=lambda ends: ends[1] - ends[0])] if holes else None


def wall_of(problem: avc.Problem) -> TableSettings:
    """Return the settings that make the device render the problem's wall behind the coupling."""
    from avc_hardware import TableSettings, Wall

    wall = problem.environment
    return TableSettings(wall=Wall(wall.damping_ns_per_m, wall.stiffness_n_per_m))
