"""`avc check` of a problem with [simulation]."""

from __future__ import annotations

import argparse

from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._to_simulation import problem_and_gains


def check_tool(args: argparse.Namespace, console: Console) -> Answer:
    """Show tool, engine and exchange, and implausible values."""
    from avc_casadi._util.units import spoken_key
    from avc_casadi.files.plausibility import plausibility
    from avc_casadi.model.declared import declared
    from avc_casadi.present.pages.tool_claims import check_page
    from avc_casadi.recommendation.preconditions import not_used
    from avc_casadi.recommendation.virtual_tool import unusual

    problem, _ = problem_and_gains(args.problem, None)
    warnings = [{"key": fault.key, "message": fault.message} for fault in plausibility(problem)]
    warnings += [
        {"key": spoken_key(f"simulation.{key}"), "message": message} for key, message in unusual(problem).items()
    ]
    tool = problem.simulation
    document = {
        "schema": "avc-check-tool/1",
        "valid": True,
        "problem": problem.name,
        "title": problem.title,
        "source": problem.source,
        "nyquist_hz": 0.5 / problem.device.sample_time_s,
        "simulation": None if tool is None else tool.model_dump(mode="json"),
        "declared": [*map(spoken_key, declared(problem))],
        "not_used": list(not_used(problem)),
        "warnings": warnings,
    }
    return Answer(document, check_page(document, problem, console.page, args.problem))
