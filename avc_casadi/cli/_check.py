"""Check a problem file or a device file and show what it means."""

from __future__ import annotations

import argparse

from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._check_device import check_device, is_device
from avc_casadi.cli._check_tool import check_tool
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._to_simulation import couples_to_simulation


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem or device: a file, or a name of the catalogue")
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Load the problem; its faults are raised."""
    if couples_to_simulation(args.problem):
        return check_tool(args, console)
    from avc_casadi._util.json_values import plain
    from avc_casadi._util.units import spoken_key
    from avc_casadi.claims.passivity.sampled_loop import passive_limit_n_per_m
    from avc_casadi.files.plausibility import plausibility
    from avc_casadi.model.declared import declared
    from avc_casadi.present.pages.bilateral import follower_page
    from avc_casadi.present.pages.catalogue import problem_page
    from avc_casadi.recommendation.preconditions import not_used, why_infeasible

    if is_device(args.problem):
        return check_device(args.problem, console)
    problem = load_problem(args.problem)
    frequency = problem.frequencies_hz()
    device = problem.device
    warnings = [{"key": fault.key, "message": fault.message} for fault in plausibility(problem)]
    # The precondition of a wall does not cover another end.
    walled = problem.simulation is None and problem.follower is None
    why_none = why_infeasible(problem) if walled else ""
    if why_none:
        warnings.append({"key": "avc recommend", "message": f"deploys nothing: {why_none}"})
    document = {
        "schema": "avc-check/2",
        "valid": True,
        "problem": problem.name,
        "title": problem.title,
        "source": problem.source,
        "structure": problem.coupling.structure,
        "model": problem.stability.model,
        "scope": problem.stability.scope,
        "frequencies": len(frequency),
        "lowest_hz": float(frequency.min()),
        "highest_hz": float(frequency.max()),
        "nyquist_hz": 0.5 / device.sample_time_s,
        "environment_stiffness_n_per_m": problem.environment.stiffness_n_per_m,
        "passive_limit_n_per_m": plain(passive_limit_n_per_m(device)),
        "declared": [*map(spoken_key, declared(problem))],
        "not_used": list(not_used(problem)),
        "warnings": warnings,
    }
    if problem.follower is not None:
        document["follower"] = problem.follower.model_dump(mode="json")
        return Answer(document, follower_page(document, problem, console.page, args.problem))
    return Answer(document, problem_page(document, problem, console.page, args.problem))
