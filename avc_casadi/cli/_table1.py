"""Rebuild the paper's Table 1 with simulated hands: stable or not, and which coupling feels like the wall.

Six walls, nine couplings, two populations of hands, three motions. Walls VE4 to VE6 are calibrated to the paper's
column without coupling; every other count is predicted. 200 hands take about a minute on two cores.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from avc_casadi._util.text import text_table
from avc_casadi.cli._arguments import add_workers, positive_int
from avc_casadi.cli._console import Answer, Console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--hands", type=positive_int, default=200, metavar="N", help="hands of each set (default 200)")
    parser.add_argument(
        "--seed", type=int, default=2026, metavar="S", help="seed of the hands; the same seed, the same counts"
    )
    add_workers(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Try all hands and count."""
    from avc_casadi._util.parallel import cluster, processors
    from avc_casadi.design.comparison.table1 import table1

    workers = processors() if args.workers is None else args.workers
    with cluster(args.scheduler) as executor, console.step("hands at the walls of the paper"):
        found = table1(args.hands, args.seed, workers=workers, executor=executor, progress=console)
    return Answer(found, table_text(found))


def table_text(document: dict[str, Any]) -> str:
    """Lay the document out."""
    hands = document["hands"]
    blocks = [
        f"Table 1 of the paper with {hands} simulated hands, seed {document['seed']}; [95 % intervals]",
        "stable: residual speed below 5 mm/s in press, tap and hold; no friction: a press without dry friction",
        "nearer: nearer to the continuous wall than the schedule (the schedule: than static), by a Weber fraction of",
        "0.1; unable: no difference noticed; paper: of 10 people",
        "",
        "Set A: mass 0.05 to 0.3 kg, damping 3 to 20 N.s/m, stiffness 200 to 800 N/m",
        _rows_text(document["rows"], hands),
        "",
        "Set B: five-parameter stylus hands within measured ranges",
        _rows_text(document["rows_set_b"], hands),
    ]
    return "\n".join(blocks)


_HEADER = (
    "\nwall",
    "k_e\nN/m",
    "\ncoupling",
    "stable\n%",
    "95 % interval\n%",
    "paper\nstable",
    "no friction\n%",
    "stiffness\n% of wall",
    "nearer\n%",
    "unable\n%",
    "paper\nnearer/unable",
)


def _rows_text(rows: Sequence[dict[str, Any]], hands: int) -> str:
    body, wall = [], ""
    for row in rows:
        paper = row["paper"] or {}
        first = row["ve"] != wall
        wall = row["ve"]
        felt = row["apparent_stiffness_n_per_m"]
        body.append(
            (
                wall if first else "",
                f"{row['stiffness_n_per_m']:.0f}" if first else "",
                row["coupling"],
                _share(row["stable"], hands),
                "-" if row["stable"] is None else f"[{100 * row['stable_low']:.1f}, {100 * row['stable_high']:.1f}]",
                str(paper.get("stable", "")),
                _share(row["asymptotic"], hands),
                "-" if felt is None else f"{100 * felt / row['stiffness_n_per_m']:.1f}",
                _share(row["matched"], hands),
                _share(row["unable"], hands),
                "" if paper.get("matched") is None else f"{paper['matched']}/{paper['unable']}",
            )
        )
    return text_table(_HEADER, body, left=(0, 2))


def _share(count: int | None, of: int) -> str:
    return "-" if count is None else f"{100 * count / of:.4g}"
