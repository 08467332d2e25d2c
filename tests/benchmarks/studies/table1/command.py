"""Rebuild the paper's Table 1 with simulated hands: stable or not, and which coupling feels like the wall.

Six walls, nine couplings, two populations of hands, three motions. Walls VE4 to VE6 are calibrated to the paper's
column without coupling; every other count is predicted. 200 hands take about a minute on two cores.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from avc_casadi.cli._arguments import positive_int
from avc_casadi.cli._chunks import add_chunks, done
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._text import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("--hands", type=positive_int, default=200, metavar="N", help="people of each set (default 200)")
    parser.add_argument(
        "--seed",
        type=positive_int,
        default=2026,
        metavar="S",
        help="seed of the people; the same seed, the same counts",
    )
    add_chunks(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Try everybody and count."""
    from studies.table1.table import table1_study

    found = done(table1_study(args.hands, args.seed), args, console)
    return found if isinstance(found, Answer) else Answer(found, table_text(found))


def table_text(document: dict[str, Any]) -> str:
    """Lay the document out for people."""
    hands = document["hands"]
    method = document["method"]
    blocks = [
        f"Table 1 of the paper with {hands} simulated hands, seed {document['seed']}.",
        f"stable: {method['stable']}; in brackets the {method['interval']}.",
        f"no friction: {method['asymptotic']}.",
        "stiffness: as felt at the end of a press, as a share of the wall's.",
        f"paper: counts of {method['paper_people']}.",
        "nearer: hands that find the coupling nearer to the reference wall than its opponent (the schedule; for it,",
        f"static); Weber fraction {method['weber']:g}. unable: cannot tell.",
        f"calibrated: {method['calibrated']}; predicted: {method['predicted']}.",
        "",
        "Set A: mass 0.05 to 0.3 kg, damping 3 to 20 N.s/m, stiffness 200 to 800 N/m",
        _rows_text(document["rows"], hands),
        "",
        "Set B: five-parameter stylus hands within measured ranges",
        _rows_text(document["rows_set_b"], hands),
    ]
    return "\n".join(blocks)


def _rows_text(rows: Sequence[dict[str, Any]], hands: int) -> str:
    header = (
        "wall",
        "k_e\nN/m",
        "coupling",
        "stable\n%",
        "95 % interval\n%",
        "paper\nstable",
        "no friction\n%",
        "stiffness\n%",
        "nearer\n%",
        "unable\n%",
        "paper\nnearer/unable",
    )
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
                "" if "stable" not in paper else str(paper["stable"]),
                _share(row["asymptotic"], hands),
                "-" if felt is None else f"{100 * felt / row['stiffness_n_per_m']:.1f}",
                _share(row["matched"], hands),
                _share(row["unable"], hands),
                "" if paper.get("matched") is None else f"{paper['matched']}/{paper['unable']}",
            )
        )
    return table(header, body, left=(0, 2))


def _share(count: int | None, of: int) -> str:
    return "-" if count is None else f"{100 * count / of:.4g}"
