"""`avc simulate` of a problem with [simulation], or of its coupling."""

from __future__ import annotations

import argparse

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_figure, writing
from avc_casadi.cli._to_simulation import problem_and_gains, refuse


def simulate_tool(args: argparse.Namespace, console: Console) -> Answer:
    """Simulate the scene with engine and tool; without gains with the recommended one; 1 if it does not settle."""
    from avc_casadi.model.declared import with_gains
    from avc_casadi.present.pages.tool_claims import simulated_page

    refuse(args, ("against", "explain", "screen", "tolerance"))
    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    trace = None if args.trace is None else output_file(args.trace, "--trace", (".npz",))
    if trace is not None:
        output_file(str(trace.with_suffix(".json")), "--trace", (".json",))  # the manifest
    problem, gains = problem_and_gains(args.problem, args.gains, console)
    assert gains is not None  # noqa: S101 - recommended where none were given
    staged = with_gains(problem, gains)
    with console.step(f"{staged.scene.duration_s:g} s of the scene"):
        found = avc.simulate(staged, seed=args.seed)
    if trace is not None:
        with writing(trace, "--trace"):
            trace = found.save(trace)
    if plot is not None:
        from avc_casadi.present.figures.scene import draw_scene

        with console.step("figure"):
            write_figure(plot, draw_scene([found], ["coupling to the simulation"]))
    alone = args.gains is None and args.problem.lower().endswith(".json")
    document = found.document(trace) | {
        "schema": "avc-simulate-tool/1",
        "coupling": "given" if alone or args.gains is not None else "recommended",
        "effects": list(found.effects),
        "contact_damping_ns_per_m": None,
        **vars(gains),
    }
    page = simulated_page(document, problem, console.page, args.problem, args.plot)
    complaint = "" if found.stable else f"avc: {problem.name}: with this hand the device does not settle"
    return Answer(document, page, code=1 if complaint else 0, complaint=complaint)
