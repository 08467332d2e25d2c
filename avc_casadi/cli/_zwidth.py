"""Show which walls the device can render, without coupling and with a static one, and where solved gains lie."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._text import number, passive_limit, sample_rows, table
from avc_casadi.cli._to_simulation import couples_to_simulation
from avc_casadi.cli._zwidth_tool import zwidth_tool
from avc_casadi.design.registry import methods_help

if TYPE_CHECKING:
    import argparse

    from avc_casadi.claims.zwidth import LlewellynTable, ZWidth
    from avc_casadi.design.constant.static import StaticCoupling

_SHORT = {
    "passive-paper": "passive\npaper",
    "passive-sampled-data": "passive\nsampled",
    "passive-delayed": "passive\n1 sample late",
    "stable-released": "stable\nno hand",
    "stable-hands": "stable\nall hands",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument(
        "--method",
        default="direct",
        help=f"whose gains are placed in the region: {methods_help()}; default direct",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw the region: .png, .svg or .pdf")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Compute the region, place the gains, draw and show."""
    if couples_to_simulation(args.problem):
        return zwidth_tool(args, console)
    import numpy as np

    from avc_casadi.claims.zwidth import llewellyn_table, rendered_wall, zwidth

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem = load_problem(args.problem)
    with console.step(f"{args.method}: {len(problem.frequencies_hz())} frequencies"):
        gains = avc.solve(problem, args.method, progress=console)
    with console.step("region"):
        region = zwidth(problem, console)
        wall = rendered_wall(problem, gains)
    damped = problem.device.damping_ns_per_m > 0
    known, refused = _rigid_and_ideal(problem), list(region.refused)
    with console.step("static couplings"):
        llewellyn = llewellyn_table(problem) if damped and known else None
        static = _static(problem) if damped and known else []
    if not known:
        refused.append(
            "constant couplings, for any passive wall and for this one: known for a rigid device with an ideal "
            "amplifier and whole samples of delay; `avc recommend P` knows the device as declared"
        )
    if plot is not None:
        from avc_casadi.present.figures.layout import save_figure
        from avc_casadi.present.figures.zwidth import draw_zwidth

        with console.step("figure"):
            drawn = llewellyn_table(problem, np.linspace(0.0, 8.0, 81)) if llewellyn is not None else None
            save_figure(draw_zwidth(region, drawn, {args.method: wall}), plot)
    document = _document(region, llewellyn, static) | {"refused": refused}
    document["gains"] = {"method": args.method} | _columns(
        frequency_hz=gains.frequency_hz, wall_damping_ns_per_m=wall[0], wall_stiffness_n_per_m=wall[1]
    )
    return Answer(document, _text(document, args.plot))


def _rigid_and_ideal(problem: avc.Problem) -> bool:
    """Whether Llewellyn's table and the constant couplings know the device."""
    from avc_casadi.claims.levels import ideal

    return ideal(problem.device)


def _static(problem: avc.Problem) -> list[StaticCoupling]:
    from avc_casadi.design.constant.static import static_coupling

    return [
        static_coupling(problem, "llewellyn", "paper"),
        static_coupling(problem, "llewellyn", "sampled-data"),
        static_coupling(problem, "all", "paper"),
        static_coupling(problem, "all", "sampled-data"),
    ]


def _columns(**columns: Any) -> dict[str, Any]:
    from avc_casadi._util.json_values import plain

    return {name: plain(column) for name, column in columns.items()}


def _document(region: ZWidth, llewellyn: LlewellynTable | None, static: list[StaticCoupling]) -> dict[str, Any]:
    return {
        "schema": "avc-zwidth/1",
        "problem": region.problem,
        "wall_damping_ns_per_m": _columns(v=region.damping_ns_per_m)["v"],
        "curves": {
            curve.key: {"claim": curve.claim, "delay_samples": curve.delay_samples, "wanted_wall": curve.wanted}
            | _columns(stiffness_n_per_m=curve.stiffness_n_per_m)
            for curve in region.curves
        },
        "wanted": {
            "damping_ns_per_m": region.wanted_damping_ns_per_m,
            "stiffness_n_per_m": region.wanted_stiffness_n_per_m,
        },
        "hands": region.hands,
        "device_corners": region.corners,
        "used": list(region.used),
        "not_used": list(region.not_used),
        "encoder_limit_n_per_m": region.encoder_limit_n_per_m,
        "passive_limit_n_per_m": _columns(v=region.passive_limit_n_per_m)["v"],
        "llewellyn": None
        if llewellyn is None
        else {"delay_samples": llewellyn.delay_samples}
        | _columns(
            damping_ratio=llewellyn.damping_ratio,
            paper_kc_t_over_b_d=llewellyn.paper,
            sampled_data_kc_t_over_b_d=llewellyn.sampled_data,
        ),
        "static": [_columns(**vars(coupling)) for coupling in static],
    }


def _text(document: dict[str, Any], plot: str | None) -> str:
    curves, damping = document["curves"], document["wall_damping_ns_per_m"]
    rows = [
        [number(damping[row]), *(number(curve["stiffness_n_per_m"][row]) for curve in curves.values())]
        for row in sample_rows(len(damping), 16)
    ]
    lines = [
        f"{document['problem']}: largest stiffness (N/m) of a wall B + K/s without coupling",
        table(["B\nN.s/m", *(_SHORT[key] for key in curves)], rows),
        *(f"  {_SHORT[key].replace(chr(10), ' ')}: {curve['claim']}" for key, curve in curves.items()),
        _wanted(document),
        passive_limit(document["passive_limit_n_per_m"]),
    ]
    if any(None in curve["stiffness_n_per_m"] for curve in curves.values()):
        lines.append("  -: no stiffness meets the claim at this B")
    if document["encoder_limit_n_per_m"] is not None:
        limit = number(document["encoder_limit_n_per_m"])
        lines.append(f"encoder and Coulomb friction keep a passive wall below 2 f_c/Delta = {limit} N/m")
    found = document["llewellyn"]
    if found is not None:
        columns = (found["damping_ratio"], found["paper_kc_t_over_b_d"], found["sampled_data_kc_t_over_b_d"])
        body = [[number(value, 5) for value in row] for row in zip(*columns, strict=True)]
        lines += [
            "",
            "static coupling for any passive wall: largest k_c T/b_d that Llewellyn's condition (6) allows",
            table(("b_c/b_d", "paper's hold\nas printed", "sampled-data\nhold"), body),
            "  -: no stiffness is allowed",
        ]
    if document["static"]:
        head = ("condition", "model", "b\nN.s/m", "k\nN/m", "b_p\nN.s/m", "error\n%")
        keys = ("damping_ns_per_m", "stiffness_n_per_m", "contact_damping_ns_per_m")
        body = [
            [
                row["condition"],
                row["model"],
                *(number(row[key] if row["found"] else None) for key in keys),
                number(100 * row["error"] if row["found"] else None),
            ]
            for row in document["static"]
        ]
        lines += [
            "",
            "best constant coupling: llewellyn for any passive wall, all for this wall at all frequencies"
            + ("; nominal device, not its ranges" if document["device_corners"] > 1 else ""),
            table(head, body, left=(0, 1)),
        ]
    lines += [""] * bool(document["used"] or document["not_used"] or document["refused"])
    if document["used"]:
        lines.append(f"declared and used: {', '.join(document['used'])}")
    if document["not_used"]:
        lines.append(f"declared and not used: {', '.join(document['not_used'])}")
    lines += [f"refused: {why}" for why in document["refused"]]
    if plot is not None:
        lines.append(f"drawn: {plot}")
    return "\n".join(lines)


def _wanted(document: dict[str, Any]) -> str:
    """Say which claims the wall of the problem meets without coupling."""
    wall = document["wanted"]
    met = [curve["claim"] for curve in document["curves"].values() if curve["wanted_wall"]]
    return (
        f"the wall wanted, {number(wall['stiffness_n_per_m'])} N/m and {number(wall['damping_ns_per_m'])} N.s/m, "
        f"without coupling: {'; '.join(met) or 'meets none of these claims'}"
    )
