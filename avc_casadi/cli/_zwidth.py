"""Show which walls the device can render, without coupling and with a constant one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi.cli._arguments import add_verbose
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_figure
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._to_simulation import couples_to_simulation
from avc_casadi.cli._zwidth_tool import zwidth_tool
from avc_casadi.design.registry import methods_help

if TYPE_CHECKING:
    import argparse

    from avc_casadi.design.constant.static import StaticCoupling


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--method", help=f"place the walls that its gains render in the region: {methods_help()}")
    parser.add_argument("--plot", metavar="FILE", help="draw the region: .png, .svg or .pdf")
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Compute the region, place the gains, draw and show."""
    if couples_to_simulation(args.problem):
        return zwidth_tool(args, console)
    import numpy as np

    from avc_casadi._util.json_values import plain
    from avc_casadi.claims.levels import ideal
    from avc_casadi.claims.zwidth import llewellyn_table, rendered_wall, zwidth
    from avc_casadi.present.pages.walls import walls_lines, walls_page

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem = load_problem(args.problem)
    with console.step("region"):
        region = zwidth(problem, console)
    gains, rendered = None, {}
    if args.method is not None:
        with console.step(f"{args.method}: {len(problem.frequencies_hz())} frequencies"):
            gains = avc.solve(problem, args.method, progress=console)
            rendered[args.method] = rendered_wall(problem, gains)
    known, refused = ideal(problem.device), list(region.refused)
    damped, whole = problem.device.damping_ns_per_m > 0, args.verbose or args.json
    with console.step("static couplings"):
        llewellyn = llewellyn_table(problem) if damped and known and whole else None
        static = _static(problem) if damped and known and whole else []
    if whole and not known:
        refused.append(
            "constant couplings, for any passive wall and for this one: known for a rigid device with an ideal "
            "amplifier and whole samples of delay; `avc recommend P` knows the device as declared"
        )
    if plot is not None:
        from avc_casadi.present.figures.zwidth import draw_zwidth

        with console.step("figure"):
            drawn = llewellyn_table(problem, np.linspace(0.0, 8.0, 401)) if llewellyn is not None else None
            write_figure(plot, draw_zwidth(region, drawn, rendered))
    document = region.document() | {
        "llewellyn": None
        if llewellyn is None
        else plain({"delay_samples": llewellyn.delay_samples} | llewellyn.to_dict()),
        "static": [plain(vars(coupling)) for coupling in static],
        "refused": refused,
    }
    if gains is not None:
        (b, k), frequency = rendered[args.method], gains.frequency_hz
        columns = {"frequency_hz": frequency, "wall_damping_ns_per_m": b, "wall_stiffness_n_per_m": k}
        document["gains"] = {"method": args.method} | plain(columns)
    text = walls_page(document, problem, console.page, args.problem, args.plot)
    return Answer(document, text, more="\n".join(walls_lines(document)))


def _static(problem: avc.Problem) -> list[StaticCoupling]:
    from avc_casadi.design.constant.static import static_coupling

    return [
        static_coupling(problem, "llewellyn", "paper"),
        static_coupling(problem, "llewellyn", "sampled-data"),
        static_coupling(problem, "all", "paper"),
        static_coupling(problem, "all", "sampled-data"),
    ]
