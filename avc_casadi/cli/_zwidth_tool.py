"""`avc zwidth` of a problem with [simulation]."""

from __future__ import annotations

import argparse

from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_figure
from avc_casadi.cli._to_simulation import problem_and_gains, refuse


def zwidth_tool(args: argparse.Namespace, console: Console) -> Answer:
    """Compute the region, draw and show."""
    from avc_casadi.design.tool_region import tool_region
    from avc_casadi.present.pages.tool_claims import region_lines, region_page

    refuse(args, ("method",))
    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem, _ = problem_and_gains(args.problem, None)
    with console.step("region"):
        region = tool_region(problem, console)
    if plot is not None:
        from avc_casadi.present.figures.tool_region import draw_tool_region

        with console.step("figure"):
            write_figure(plot, draw_tool_region(region))
    document = region.document()
    text = region_page(document, problem, console.page, args.problem, args.plot)
    return Answer(document, text, more="\n".join(region_lines(document, problem)))
