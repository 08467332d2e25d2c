"""Write gains as a C header for firmware of your own."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from avc_casadi import InputError
from avc_casadi.cli._arguments import positive
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Write gains as a C header for firmware of your own: a const float table, a look-up and one control step."
    )
    parser.add_argument("gains", metavar="GAINS", help="gain file, .json or .csv")
    parser.add_argument("--c", required=True, metavar="FILE", help="header to write, for example gains.h")
    parser.add_argument(
        "--sample-time-s", type=positive, metavar="T", help="needed with a .csv, which does not know its sample time"
    )


def run(args: argparse.Namespace, console: Console) -> Answer:  # noqa: ARG001
    """Write the header."""
    from avc_casadi.coupling import read_gains
    from avc_hardware import export_c

    path = output_file(args.c, "--c", (".h", ".hpp", ".c"))
    gains = read_gains(Path(args.gains))
    if args.sample_time_s is None and not math.isfinite(gains.sample_time_s):
        raise InputError.of(f"is missing; {args.gains} does not know its sample time", key="--sample-time-s")
    write_text(path, export_c(gains, sample_time_s=args.sample_time_s), "--c")
    rows = int(gains.usable.sum())
    document = {
        "schema": "avc-export/1",
        "path": str(path),
        "rows": rows,
        "left_out": gains.rows - rows,
    }
    left = f" ({gains.rows - rows} without gains left out)" if gains.rows > rows else ""
    return Answer(document, f"{rows} rows{left} written: {path}")
