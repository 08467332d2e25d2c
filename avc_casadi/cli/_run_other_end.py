"""`avc run` of a problem with [simulation] or [follower]: recommend, certify, draw, report; there is no NLP for it."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._versions import package_versions

if TYPE_CHECKING:
    import argparse

    from avc_casadi.model.lifted_loop import ToolGains
    from avc_casadi.present.report.frame import Picture


def run_to_other_end(
    problem: avc.Problem, args: argparse.Namespace, console: Console, folder: Path, shown: Path
) -> Answer:
    """Do all of it, writing to one folder and reporting another.

    Args:
        problem: with [simulation] or [follower].
        args: of `avc run`.
        console: shows the steps.
        folder: written to.
        shown: folder in messages.

    Raises:
        InputError: an option that asks for a wall.
    """
    from avc_casadi._util.files import write_file
    from avc_casadi.files.other_end_coupling_file import write_other_end
    from avc_casadi.present.pages.bilateral import bilateral_headline
    from avc_casadi.present.pages.virtual_tool import headline
    from avc_casadi.present.report.other_end import other_end_html, other_end_rows
    from avc_casadi.present.terminal import Row
    from avc_casadi.recommendation.bilateral import recommend_bilateral
    from avc_casadi.recommendation.virtual_tool import recommend_tool

    for given, key in ((args.method, "--method"), (args.unsafe, "--unsafe")):
        if given:
            raise avc.InputError.of("is asked of walls, and the other end is none; leave it out", key=key)
    with console.step("coupling to deploy"):
        recommend = recommend_tool if problem.follower is None else recommend_bilateral
        found = recommend(problem, versions=package_versions(), progress=console)
    document, coupling = found.document(), found.coupling
    files = ["report.html"]
    if coupling is not None:
        write_other_end(coupling, folder / "coupling.json")
        files.append("coupling.json")
    with console.step("figures"):
        drawn = _drawn(problem, None if coupling is None else coupling.gains, console)
        for name, (png, picture) in drawn.items():
            write_file(folder / f"{name}.png", png)
            write_file(folder / f"{name}.svg", picture.wide)
            files += [f"{name}.png", f"{name}.svg"]
    pictures = [picture for _, picture in drawn.values()]
    write_file(folder / "report.html", other_end_html(document, problem, pictures, package_versions()))
    title = headline(problem, args.problem) if problem.follower is None else bilateral_headline(problem, args.problem)
    written = Row("Written", f"{shown / 'report.html'} and {len(files) - 1} files beside it")
    following = (
        f"avc recommend {quote(args.problem)} -v"
        if coupling is None
        else f"avc export {quote(str(shown / 'coupling.json'))} --c DIR"
    )
    text = console.page.rendered(title, [*other_end_rows(document, problem), written], [following])
    lines = [f"reason: {document['reason']}", *(f"assumed: {gap}" for gap in document["assumed"])]
    lines += [f"not used: {what}" for what in document["not_used"]]
    complaint = "" if found.deployable else f"avc: {problem.name}: no coupling is deployable"
    answer = {"schema": "avc-run-other-end/1", "folder": str(shown), "files": sorted(files), "deploy": document}
    return Answer(answer, text, code=1 if complaint else 0, complaint=complaint, more="\n".join(lines))


def _drawn(problem: avc.Problem, gains: ToolGains | None, console: Console) -> dict[str, tuple[bytes, Picture]]:
    """Return each figure as PNG, and for the page: the rendering, and for a simulation the stable couplings."""
    from dataclasses import replace

    from avc_casadi._util.text import quantity
    from avc_casadi._util.units import N_PER_M
    from avc_casadi.design.tool_region import tool_region
    from avc_casadi.present.figures.tool_impedance import draw_rendered_impedance
    from avc_casadi.present.figures.tool_region import draw_tool_region
    from avc_casadi.present.report.frame import Picture
    from avc_casadi.recommendation.tool_impedance import rendered_band

    found = {}
    if gains is not None:
        band = rendered_band(problem, gains)
        stiff = ", ".join(
            f"{quantity(one.stiffness_n_per_m, N_PER_M)} at {one.frequency_hz:.3g} Hz" for one in band.felt[::20]
        )
        words = (
            f"On a rigid object {stiff} are rendered, where the coupling has "
            f"{quantity(band.stiffness_n_per_m, N_PER_M)}."
        )
        caption = (
            "What is rendered against what is wanted: device and other end as one body, and the coupling's spring."
        )
        found["rendered"] = Picture.with_png(draw_rendered_impedance, band, caption, words)
    if problem.simulation is not None:
        region = replace(tool_region(problem, console), chosen=gains)
        limits = "; ".join(
            f"{quantity(1 / one.step_s, 'Hz')} {quantity(one.stiffest.stiffness_n_per_m, N_PER_M)}"
            for one in region.curves
            if one.stiffest is not None
        )
        caption = "Springs and dampers that are stable with every hand, released, tool and contact, by engine rate."
        found["region"] = Picture.with_png(
            draw_tool_region, region, caption, f"Stiffest stable K by engine rate: {limits}."
        )
    return found
