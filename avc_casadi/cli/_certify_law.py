"""`avc certify P --k K --b B`: a law of one's own, in no file."""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console

_KEYS = ("k", "b", "b_p", "cutoff_hz")


def add_law(parser: argparse.ArgumentParser) -> None:
    """Declare the options of a law of one's own."""
    group = parser.add_argument_group(
        "your own law in place of GAINS",
        "force = -(k x + (b + b_p) v); what is left out is 0. The wall of P is not used; P may be a device file.",
    )
    group.add_argument("--k", "--kp", type=float, metavar="K", help="spring, N/m; N.m/rad of a device that turns")
    group.add_argument("--b", "--kd", type=float, metavar="B", help="damper in the wall, N.s/m or N.m.s/rad")
    group.add_argument("--b-p", type=float, metavar="B", help="damper that acts outside the wall too")
    group.add_argument(
        "--cutoff-hz", type=float, metavar="F", help="first-order filter of the velocity (default: none)"
    )


def has_law(args: argparse.Namespace) -> bool:
    """Return whether options of a law of one's own were given."""
    return any(getattr(args, key) is not None for key in _KEYS)


def certify_law(args: argparse.Namespace, console: Console) -> Answer:
    """Judge the law of the options; 1 if it may not be deployed."""
    from avc_casadi.own_law.page import own_law_page

    beside = {"GAINS": args.gains, "--requested": args.requested, "--prove": args.prove, "--proof-out": args.proof_out}
    faults = [avc.Fault("", None, key, "goes with a file of gains, not with --k, --b") for key in beside if beside[key]]
    if faults:
        raise avc.InputError(faults)
    given = {key: getattr(args, key) for key in _KEYS if getattr(args, key) is not None}
    with console.step("your own law"):
        found = avc.certify_law(args.problem, **given)
    complaint = "" if found.passed else f"avc: {args.problem}: this law is not deployable"
    page = own_law_page(found, console.page, args.problem)
    return Answer(found.document(), page, code=1 if complaint else 0, complaint=complaint)
