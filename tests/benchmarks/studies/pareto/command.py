"""Show what each step of guarantee costs in realism, and what adaptive gains win over constant ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from avc_casadi._util import units
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file
from avc_casadi.cli._subject import load_problem
from avc_casadi.cli._text import number, passive_limit, table

if TYPE_CHECKING:
    import argparse

_STUDIES = {
    "scope": "scope of the guarantee, slopes and box as in the problem",
    "slope": "slope limit, scope as in the problem",
    "contact": "largest contact damping b_p: structure damped, impedance error, scope hands",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.epilog = "Two dozen designs are solved and certified, which takes a minute or two."
    parser.add_argument("problem", metavar="P", help="problem file or name of the catalogue")
    parser.add_argument("--plot", metavar="FILE", help="draw the study: .png, .svg or .pdf")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Solve and certify every design, draw and show."""
    from avc_casadi.design.comparison.pareto import study_pareto

    plot = None if args.plot is None else output_file(args.plot, "--plot", (".png", ".svg", ".pdf"))
    problem = load_problem(args.problem)
    with console.step("designs solved and certified"):
        study = study_pareto(problem, console)
    if plot is not None:
        from avc_casadi.present.figures.layout import save_figure
        from studies.pareto.figure import draw_pareto

        with console.step("figure"):
            save_figure(draw_pareto(study), plot)
    document = study.document()
    return Answer(document, _text(document, args.plot))


def _text(document: dict[str, Any], plot: str | None) -> str:
    low, high = (number(end, 3) for end in document["band_hz"])
    lines = [
        f"{document['problem']}: {document['title']}",
        (
            f"model {document['model']}; errors are root mean squares over ln(f) from {low} to {high} Hz; DC stiffness"
            f" is that of the row of {number(document['dc_frequency_hz'])} Hz, a resting hand"
        ),
    ]
    for study, what in _STUDIES.items():
        points = [point for point in document["points"] if point["study"] == study]
        lines += ["", what, table([*map(str, _HEAD)], map(_row, points), left=(0, 1, 8))]
    lines += [
        "",
        (
            f"desired stiffness {number(document['desired_stiffness_n_per_m'])} {units.N_PER_M}; "
            f"{passive_limit(document['passive_limit_n_per_m'])}"
        ),
        "levels: L0 own frequency; L1 band of the design; L2, L3 all frequencies, paper's and sampled-data hold;",
        "L4 Llewellyn; L5 linearly stable with the hands of the problem: stability of frozen rows, not passivity",
    ]
    if plot is not None:
        lines.append(f"drawn: {plot}")
    return "\n".join(lines)


_HEAD = (
    "\ndesign",
    "\ngains",
    "|Z| error\n%",
    "impedance error\n%",
    units.Wording.of(lambda: f"DC stiffness\n{units.N_PER_M}"),
    "steepest\nslope",
    units.Wording.of(lambda: f"b_p\n{units.NS_PER_M}"),
    "rows\nwithout",
    "\nlevels met",
)


def _row(point: dict[str, Any]) -> list[str]:
    errors = (point["magnitude_error"], point["complex_error"])
    return [
        point["label"],
        "constant" if point["constant"] else "adaptive",
        *(number(None if error is None else 100 * error, 3) for error in errors),
        number(point["dc_stiffness_n_per_m"]),
        number(point["steepest"], 3),
        number(point["contact_damping_ns_per_m"], 3),
        str(point["rows_without_gains"]),
        " ".join(level for level, passed in point["passed"].items() if passed) or "none",
    ]
