"""Say which stability claims a gain table meets, with its worst margins."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._foreign import gains_for
from avc_casadi.cli._text import number, table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.description = (
        "Say which stability claims a gain table meets, with the worst margin of each and where it stands.\n"
        "Exit code 1 if the claim of the problem file (stability.scope and model) is not met."
    )
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("gains", metavar="GAINS", help="gain file, .json or .csv")
    parser.add_argument(
        "--requested", action="store_true", help="judge what unrealisable rows asked for in place of missing gains"
    )


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Certify; 1 if the problem's own claim is not met."""
    problem = avc.load_problem(args.problem)
    gains, notes = gains_for(problem, args.gains)
    with console.step(f"certificate of {gains.rows} rows"):
        certificate = avc.certify(problem, gains, requested=args.requested).document()
    claimed = claimed_level(problem)
    document = {"schema": "avc-certify/1", "claimed": claimed, "gains": args.gains, "notes": notes} | certificate
    claims = "\n".join(f"  {level}: {result['claim']}" for level, result in certificate["levels"].items())
    beside = "".join(f"note: {note}\n" for note in notes)
    text = (
        f"{problem.name}: {gains.rows} rows of {args.gains}, {certificate['judged']}\n{beside}"
        f"{levels_text(certificate)}\n"
        f"{claims}\n{_beside_hands(certificate['levels']['L5'])}"
        f"claimed by the problem file: {claimed} (scope {problem.stability.scope}, model {problem.stability.model})\n"
        f"no passive linear rendering on this device exceeds {number(certificate['passive_limit_n_per_m'])} N/m at DC "
        "(sampled-data)"
    )
    complaint = not_met(problem, certificate)
    return Answer(document, text, code=1 if complaint else 0, complaint=complaint)


def _beside_hands(level: Mapping[str, Any]) -> str:
    """What stands beside L5: the device let go, and switching between neighbouring rows; empty where not judged."""
    from avc_casadi.stability import RADIUS_TOLERANCE

    radius, switching = level.get("released_spectral_radius"), level.get("common_lyapunov")
    lines = []
    if level["margin_ns_per_m"] is not None:
        word = "could lose before it becomes unstable" if level["margin_ns_per_m"] >= 0 else "lacks"
        lines.append(
            f"L5's margin is the device damping that it {word} with the worst hand; L0 to L3 give the lowest Re Z_h, "
            "L4 what (6) leaves"
        )
    if radius is not None:
        if level["released_pass"]:
            word = "comes to rest"
        elif radius <= 1 + RADIUS_TOLERANCE:
            word = "keeps its speed or place where nothing acts on it, as any free mass, and does not run away"
        else:
            word = "not stable"
        lines.append(f"device let go: {word}; spectral radius {number(radius, 6)} at worst")
    if switching is not None:
        lines.append(
            f"switching: a common Lyapunov function found for {switching['proved']} of {switching['pairs']} pairs of "
            f"neighbouring rows, with each of {switching['hands']} hands; the others are open or unstable themselves"
        )
    return "".join(f"{line}\n" for line in lines)


def claimed_level(problem: avc.Problem) -> str:
    """Return the level that the problem file asks the gains to meet."""
    whole = "L2" if problem.stability.model == "paper" else "L3"
    return {"pointwise": "L0", "band": "L1", "all": whole, "hands": "L5"}[problem.stability.scope]


def not_met(problem: avc.Problem, certificate: Mapping[str, Any]) -> str:
    """Say that the problem's own claim is not met; empty if it is."""
    level = claimed_level(problem)
    found = certificate["levels"][level]
    return "" if found["pass"] else f"avc: {level}, {found['title']}: {found['claim']}"


def levels_text(certificate: Mapping[str, Any]) -> str:
    """Return the levels as a table: passivity and stability are different claims and stay apart."""
    rows = [
        (
            level,
            found["title"],
            "pass" if found["pass"] else "fail",
            number(found["margin_ns_per_m"], 3),
            number(found["frequency_hz"]),
            str(found["rows_failed"]),
        )
        for level, found in certificate["levels"].items()
    ]
    header = ("level", "claim", "result", "worst margin\nN.s/m", "at\nHz", "rows that\nfail")
    return table(header, rows, left=(0, 1, 2))
