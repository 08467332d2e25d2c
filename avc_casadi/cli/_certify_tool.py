"""`avc certify` of a coupling to a simulation."""

from __future__ import annotations

import argparse
from shlex import quote

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._to_simulation import problem_and_gains, refuse


def certify_tool(args: argparse.Namespace, console: Console) -> Answer:
    """Judge the coupling of a file, or of GAINS against a problem; 1 if it is not stable."""
    from avc_casadi.design.tool_certificate import tool_certificate
    from avc_casadi.present.pages.tool_claims import certificate_page
    from avc_casadi.recommendation.preconditions import not_used

    refuse(args, ("requested", "prove", "proof_out"))
    problem, gains = problem_and_gains(args.problem, args.gains)
    if gains is None:
        make = f"avc recommend {quote(args.problem)} --out c.json"
        raise avc.InputError.of(f"is missing; give a coupling to the simulation: {make}", key="GAINS")
    file = args.problem if args.gains is None else args.gains
    with console.step("certificate"):
        certificate = tool_certificate(problem, gains)
    document = {
        "schema": "avc-certify-tool/1",
        "problem": problem.name,
        "gains": file,
        **vars(gains),
        "deployable": {"pass": certificate["stable"], "sentence": _sentence(certificate["stable"])},
        **certificate,
        "not_used": list(not_used(problem)),
    }
    complaint = "" if certificate["stable"] else f"avc: {problem.name}: {file} is not deployable"
    page = certificate_page(document, problem, console.page, file)
    return Answer(document, page, code=1 if complaint else 0, complaint=complaint)


def _sentence(stable: bool) -> str:
    if stable:
        return "linearly stable with every hand and released; whether hands settle: avc recommend"
    return "not deployable: unstable with a hand, or released"
