"""Report the effective mass of a device of several axes at its tip, and design its gains.

An arm is a file or a name of the catalogue (avc list). Along a normal n its effective mass lies between
1/(n' L^-1 n), the tangent free, and n' L n, the tangent held, L the operational-space inertia; --out writes both ends
as the range of a device file: in a problem file device = "tip.toml", then avc recommend. --map draws the stiffest wall
over the workspace. --gains designs spring and damper for every contact normal, searches the coupled loop for the worst
pose, normal and hand, and writes TOML, JSON, constants in C and an example for CHAI3D.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._arguments import add_verbose, positive_int
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, output_folder, write_figure, write_text

if TYPE_CHECKING:
    import argparse
    from pathlib import Path

    from avc_casadi.arm.arm import Arm

_POSES, _MOST_REGIONS = 1000, 20


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("arm", metavar="ARM", help="arm file or name of the catalogue, phantom-premium-1.5 for example")
    parser.add_argument("--at", metavar="X,Y,Z", help="a place of the tip, m from home; left out: the workspace")
    parser.add_argument("--normal", metavar="X,Y,Z", help="of the wall; left out: every direction")
    parser.add_argument("--out", metavar="FILE", help="write the device along the normal as a device file (.toml)")
    parser.add_argument("--map", metavar="FILE", help="draw the stiffest wall over the workspace: .png, .svg or .pdf")
    parser.add_argument(
        "--poses",
        type=positive_int,
        default=_POSES,
        metavar="N",
        help=f"of the map, at least, on an even grid (default {_POSES})",
    )
    parser.add_argument("--gains", metavar="DIR", help="design gains for every normal and write them into a folder")
    parser.add_argument("--regions", metavar="A,B,C", help="parts of the workspace along each axis (default 1 each)")
    parser.add_argument("--one-coupling", action="store_true", help="the same gains for every normal")
    add_verbose(parser)


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Compute, write and show."""
    out = None if args.out is None else output_file(args.out, "--out", (".toml",))
    drawing = None if args.map is None else output_file(args.map, "--map", (".png", ".svg", ".pdf"))
    at, normal = _numbers(args.at, "--at"), _numbers(args.normal, "--normal")
    regions = _numbers(args.regions, "--regions")
    if args.gains is None and (regions is not None or args.one_coupling):
        key = "--one-coupling" if regions is None else "--regions"
        raise avc.InputError.of("goes with --gains DIR; give both or none", key=key)
    from avc_casadi.arm.effective_mass import mass_range, one_normal
    from avc_casadi.arm.mechanisms import arm
    from avc_casadi.present.pages.arm import arm_lines, arm_page

    made = arm(args.arm)
    normals = None if normal is None else one_normal(made, normal)
    document = _home(made)
    if at is not None:
        document["at"] = _pose(made, at, normals)
        ends = document["at"]["free_kg"], document["at"]["held_kg"]
    else:
        with console.step("workspace"):
            found = mass_range(made, normals)
        document["workspace"] = _plain(vars(found))
        ends = found.lightest_kg, found.heaviest_kg
    document["normal"] = None if normals is None else _plain(normals[0])
    document["out"] = None if out is None else str(out)
    if out is not None:
        from avc_casadi.arm.effective_mass import tip_device_file
        from avc_casadi.identification.device import device_text

        where = ("any direction" if normal is None else f"normal {args.normal}") + ", "
        where += "whole workspace" if at is None else f"{args.at} m from home"
        write_text(out, device_text(tip_device_file(made, *ends, where)), "--out")
    if drawing is not None:
        document["map"] = _map(made, args, drawing, console)
    if args.gains is not None:
        document["gains"] = _gains(made, args, _cells(made, regions), console)
    text = arm_page(document, console.page, args.at, args.normal)
    return Answer(document, text, more="\n".join(arm_lines(document)))


def _map(made: Arm, args: argparse.Namespace, drawing: Path, console: Console) -> dict[str, Any]:
    from avc_casadi._util.parallel import processors
    from avc_casadi.arm.walls import workspace_map
    from avc_casadi.present.figures.zwidth import draw_workspace

    with console.step("map"):
        found = workspace_map(made, args.poses, min(2, processors()), console)
        write_figure(drawing, draw_workspace({"": found}), "--map")
    told: dict[str, Any] = _plain({**vars(found), "file": str(drawing)})
    return told


def _cells(made: Arm, regions: tuple[float, ...] | None) -> tuple[int, ...] | None:
    if regions is None:
        return None
    whole = tuple(int(one) for one in regions)
    if len(whole) != len(made.axes) or whole != regions or not all(1 <= one <= _MOST_REGIONS for one in whole):
        message = f"is {', '.join(f'{one:g}' for one in regions)}; allowed: {len(made.axes)} whole numbers, 1 to "
        raise avc.InputError.of(f"{message}{_MOST_REGIONS}", key="--regions")
    return whole


def _gains(made: Arm, args: argparse.Namespace, regions: tuple[int, ...] | None, console: Console) -> dict[str, Any]:
    from avc_casadi._util.files import write_file
    from avc_casadi._util.json_values import json_text
    from avc_casadi.arm.design import design_arm, gains_document, gains_toml
    from avc_hardware import arm_gains_c

    with output_folder(args.gains, "--gains") as folder:
        with console.step("gains"):
            design = design_arm(made, regions, one=args.one_coupling, progress=console)
        document = gains_document(made, design)
        files = {"gains.json": json_text(document), "gains.toml": gains_toml(document), **arm_gains_c(document)}
        for name, text in files.items():
            write_file(folder / name, text)
    return {**document, "folder": args.gains, "files": sorted(files)}


def _numbers(text: str | None, key: str) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = (math.nan,)
    if not all(map(math.isfinite, found)):
        raise avc.InputError.of(f"is {text!r}; allowed: finite numbers with commas, one of each axis", key=key)
    return found


def _plain(value: Any) -> Any:
    from avc_casadi._util.json_values import plain

    return plain(value)


def _home(made: Arm) -> dict[str, Any]:
    import numpy as np

    from avc_casadi.arm.effective_mass import effective_masses, mobility, operational_inertia

    here = mobility(made, made.home[None])
    masses = effective_masses(here, np.eye(len(made.axes)))[0]
    low, high = made.box_m
    return {
        "schema": "avc-arm/1",
        "arm": made.file.name,
        "title": made.file.title,
        "source": made.file.source,
        "axes": list(made.axes),
        "home_joints": _plain(made.home),
        "home_tip_m": _plain(made.home_tip_m),
        "workspace_m": [_plain(low), _plain(high)],
        "home_inertia_kg": _plain(operational_inertia(here)[0]),
        "home_free_kg": _plain(masses[:, 0]),
        "home_held_kg": _plain(masses[:, 1]),
    }


def _pose(made: Arm, at: tuple[float, ...], normals: Any) -> dict[str, Any]:
    import numpy as np

    from avc_casadi.arm.effective_mass import effective_masses, mobility, operational_inertia, reached

    if len(at) != len(made.axes):
        raise avc.InputError.of(
            f"is of length {len(at)}; allowed: {len(made.axes)}, {', '.join(made.axes)}", key="--at"
        )
    joints, there = reached(made, (made.home_tip_m + at)[None])
    if not there[0]:
        message = (
            f"is {', '.join(map(str, at))} m from home, which the mechanism does not reach; allowed: a place that it "
        )
        raise avc.InputError.of(message + "reaches", key="--at")
    tip, (low, high) = made.home_tip_m + at, made.box_m
    here = mobility(made, joints)
    inertia = operational_inertia(here)[0]
    values = np.linalg.eigvalsh(here)[0]
    ends = (1 / values[-1], 1 / values[0]) if normals is None else effective_masses(here, normals)[0, 0]
    pose: dict[str, Any] = _plain(
        {
            "from_home_m": list(at),
            "in_workspace": bool((low <= tip).all() and (tip <= high).all()),
            "joints": joints[0],
            "inertia_kg": inertia,
            "free_kg": float(ends[0]),
            "held_kg": float(ends[1]),
        }
    )
    return pose
