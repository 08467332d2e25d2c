"""Tell what a device of several axes weighs at its tip: by pose and direction, and over its workspace.

An arm is a file or a name of the catalogue (avc list). Along a normal n its effective mass lies between
1/(n' L^-1 n), the tangent free, and n' L n, the tangent held, L the operational-space inertia; --out writes both ends
as the range of a device file: in a problem file device = "tip.toml", then avc recommend.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import avc_casadi as avc
from avc_casadi.cli._console import Answer, Console
from avc_casadi.cli._files import output_file, write_text
from avc_casadi.cli._text import number, table, titled

if TYPE_CHECKING:
    import argparse

    from avc_casadi.arm import Arm


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.add_argument("arm", metavar="ARM", help="arm file or name of the catalogue, phantom-premium-1.5 for example")
    parser.add_argument("--at", metavar="X,Y,Z", help="a place of the tip, m from home; left out: the workspace")
    parser.add_argument("--normal", metavar="X,Y,Z", help="of the wall; left out: every direction")
    parser.add_argument("--out", metavar="FILE", help="write the device along the normal as a device file (.toml)")


def run(args: argparse.Namespace, console: Console) -> Answer:
    """Weigh, write and show."""
    out = None if args.out is None else output_file(args.out, "--out", (".toml",))
    at, normal = _numbers(args.at, "--at"), _numbers(args.normal, "--normal")
    from avc_casadi.arm import arm, mass_range, one_normal

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
        from avc_casadi.arm import tip_device_file
        from avc_casadi.identification import device_text

        where = ("any direction" if normal is None else f"normal {args.normal}") + ", "
        where += "whole workspace" if at is None else f"{args.at} m from home"
        write_text(out, device_text(tip_device_file(made, *ends, where)), "--out")
    return Answer(document, _text(document, args))


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
    from avc_casadi.support import plain

    return plain(value)


def _home(made: Arm) -> dict[str, Any]:
    import numpy as np

    from avc_casadi.arm import effective_masses, mobility, operational_inertia

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

    from avc_casadi.arm import effective_masses, mobility, operational_inertia, reached

    if len(at) != len(made.axes):
        raise avc.InputError.of(f"has {len(at)} numbers; allowed: {len(made.axes)}, {', '.join(made.axes)}", key="--at")
    joints, there = reached(made, (made.home_tip_m + at)[None])
    if not there[0]:
        message = (
            f"is {', '.join(map(str, at))} m from home, which the mechanism does not reach; allowed: a place that it "
        )
        raise avc.InputError.of(message + "reaches", key="--at")
    here = mobility(made, joints)
    inertia = operational_inertia(here)[0]
    values = np.linalg.eigvalsh(here)[0]
    ends = (1 / values[-1], 1 / values[0]) if normals is None else effective_masses(here, normals)[0, 0]
    pose: dict[str, Any] = _plain(
        {
            "from_home_m": list(at),
            "joints": joints[0],
            "inertia_kg": inertia,
            "free_kg": float(ends[0]),
            "held_kg": float(ends[1]),
        }
    )
    return pose


def _text(document: dict[str, Any], args: argparse.Namespace) -> str:
    axes = document["axes"]
    free, held = document["home_free_kg"], document["home_held_kg"]
    rows = [[axis, number(1e3 * free[i]), number(1e3 * held[i])] for i, axis in enumerate(axes)]
    along = "in any direction" if args.normal is None else f"along the normal {args.normal}"
    lines = [
        titled(document["arm"], document["title"]),
        f"  {document['source']}" if document["source"] else "",
        f"tip at home: {_place(document['home_tip_m'])} m; effective mass there, tangent free and held:",
        table(["along", "free\ng", "held\ng"], rows, left=(0,)),
    ]
    if "at" in document:
        pose = document["at"]
        lines.append(
            f"at {args.at} m from home {along}: {number(1e3 * pose['free_kg'])} g free, "
            f"{number(1e3 * pose['held_kg'])} g held"
        )
    else:
        found = document["workspace"]
        lines.append(
            f"over the workspace {along}: "
            f"{number(1e3 * found['lightest_kg'])} g (at {_place(found['lightest_at_m'])} m) to"
            f" {number(1e3 * found['heaviest_kg'])} g (at {_place(found['heaviest_at_m'])} m)"
        )
        if found["out_of_reach"]:
            lines.append(
                f"  {found['out_of_reach']} of {found['poses']} poses of the grid are out of the mechanism's reach"
            )
    if document["out"]:
        lines.append(f'written: {document["out"]}; in a problem file: device = "{document["out"]}"')
    return "\n".join(line for line in lines if line)


def _place(position_m: list[float]) -> str:
    return ", ".join(number(one, 3) for one in position_m)
