"""Devices of several axes: the Premium's masses, its stiffest wall over the workspace, and the coupled loop.

nice -n 10 python tests/benchmarks/arms.py

Overwrites results/arms.json, figures/workspace.png and RESULTS_arms.md, each part once; goes on where it stopped. About
2 minutes of processor time. With --before DIR, a checkout of the package without arms, it also times `avc run figure5`.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from studied import about, computed, made_by, table

from avc_casadi._util.json_values import plain
from avc_casadi.arm.arm import Arm
from avc_casadi.arm.coupled import critical_factor, electronics, radii, random_points
from avc_casadi.arm.design import design_arm
from avc_casadi.arm.effective_mass import effective_masses, mass_range, mobility
from avc_casadi.arm.mechanisms import arm
from avc_casadi.arm.walls import WorkspaceMap, workspace_map
from avc_casadi.files.arm_file import load_arm
from avc_casadi.present.figures.layout import save_figure
from avc_casadi.present.figures.zwidth import draw_workspace

SEED = 2026
NAME = "phantom-premium-1.5"
OUT = Path(__file__).parent / "results" / "arms.json"
PAGE = Path(__file__).parent / "RESULTS_arms.md"
FIGURE = Path(__file__).parent / "figures" / "workspace.png"
RANDOM = 100_000
# Of these so many are asked for their own factor.
_FIRST = 200
_MAPS: dict[str, WorkspaceMap] = {}
# Delay as filed is a gap, 0 to 2 samples.
DELAYS: dict[str, float | None] = {"no delay": 0, "one sample late": 1, "0 to 2 samples late": None}


def premium(delay: float | None) -> Arm:
    """The Premium with a delay that is known, or as filed."""
    file = load_arm(NAME)
    if delay is None:
        return arm(file)
    device = file.device
    known = device.range.model_copy(update={"delay_samples": None})
    return arm(file.model_copy(update={"device": device.model_copy(update={"delay_samples": delay, "range": known})}))


def masses() -> dict[str, Any]:
    made = premium(None)
    here = effective_masses(mobility(made, made.home[None]), np.eye(3))[0]
    found = mass_range(made)
    return {"home_kg": plain(here[:, 0]), "lightest_kg": found.lightest_kg, "heaviest_kg": found.heaviest_kg}


def walls(delay: float | None) -> dict[str, Any]:
    """Map it and draw what is there so far."""
    started, used = time.perf_counter(), cpu()
    found = workspace_map(premium(delay), 1000, 2)
    seconds = time.perf_counter() - started, cpu() - used
    _MAPS[next(name for name, one in DELAYS.items() if one == delay)] = found
    save_figure(draw_workspace(_MAPS), FIGURE)
    return plain(
        {
            "poses": len(found.points_m),
            "reached": int(found.there.sum()),
            "searches": found.searches,
            "wall_s": seconds[0],
            "cpu_s": seconds[1],
            "labels": list(found.labels),
            "least_n_per_m": np.nanmin(found.stiffness_n_per_m, axis=0),
            "median_n_per_m": np.nanmedian(found.stiffness_n_per_m, axis=0),
            "most_n_per_m": np.nanmax(found.stiffness_n_per_m, axis=0),
        }
    )


def coupled(delay: float | None) -> dict[str, Any]:
    """Design, and ask the certificate's worst against as many poses and hands that had no part in the search."""
    made = premium(delay)
    design = design_arm(made, seed=SEED)
    worst = design.certificate.worst
    others: dict[str, Any] = {"unstable_at_the_worst": 0, "unstable": 0, "contacts": 0, "least_factor": np.inf}
    corners = [(device, held) for device in electronics(made) for held in (True, False)]
    for number, (device, held) in enumerate(corners):
        each = RANDOM // len(corners)
        points = random_points(made, each, SEED + 1 + number, held=held)
        at = radii(made, design.gains, device, points, held=held)
        plainly, near = at(1.0), at(0.999 * worst.factor)
        others["contacts"] += int(np.isfinite(plainly).sum())
        others["unstable"] += int((plainly >= 1).sum())
        others["unstable_at_the_worst"] += int((near >= 1).sum())
        first = radii(made, design.gains, device, points[np.argsort(-np.nan_to_num(near))[:_FIRST]], held=held)
        others["least_factor"] = min(others["least_factor"], critical_factor(first))
    gains = design.gains
    return plain(
        {
            "per_axis_factor": design.per_axis_factor,
            "factor": worst.factor,
            "looked_at": design.certificate.looked_at,
            "worst": worst.document(),
            "softened_to": float(gains.stiffness_n_per_m[0, 0] / design.per_axis.stiffness_n_per_m[0, 0]),
            "stiffness_n_per_m": [float(gains.stiffness_n_per_m.min()), float(gains.stiffness_n_per_m.max())],
            "tangent_stiffness_n_per_m": float(gains.tangent_stiffness_n_per_m[0]),
            "others": others,
        }
    )


def cpu() -> float:
    used = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


def figure5(before: Path) -> dict[str, Any]:
    """Processor time of `avc run figure5` in both checkouts, in turn."""
    roots = {"before": before, "after": Path(__file__).parents[2]}
    seconds: dict[str, list[float]] = {name: [] for name in roots}
    for _ in range(3):
        for name, root in roots.items():
            with tempfile.TemporaryDirectory() as folder:
                used = resource.getrusage(resource.RUSAGE_CHILDREN)
                subprocess.run(
                    [sys.executable, "-m", "avc_casadi", "run", "figure5"],
                    cwd=folder,
                    env=os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{root / 'hardware'}"},
                    stdout=subprocess.DEVNULL,
                    check=True,
                )
                now = resource.getrusage(resource.RUSAGE_CHILDREN)
                seconds[name].append(now.ru_utime + now.ru_stime - used.ru_utime - used.ru_stime)
    return {name: min(found) for name, found in seconds.items()}


def write_page(document: dict[str, Any]) -> None:
    """Write what is there so far."""
    cells = document["cells"]
    lines = [
        "# Devices of several axes",
        "",
        made_by(document["about"]),
        "",
        (
            "The Phantom Premium 1.5 of [problems/arms](../../problems/arms/phantom-premium-1.5.toml), without "
            "rotors; its damping is not known, 0 to 1 N.s/m. Hands: the default set and let go."
        ),
        "",
    ]
    if "masses" in cells:
        one = cells["masses"]
        home = ", ".join(f"{1e3 * mass:.1f}" for mass in one["home_kg"])
        lines += [
            (
                f"**Effective mass**: {home} g along x, y and z at home (published parameters: 32, 77, 53); "
                f"{1e3 * one['lightest_kg']:.1f} to {1e3 * one['heaviest_kg']:.1f} g in any direction over "
                "127 x 254 x 178 mm (27 to 180)."
            ),
            "",
        ]
    if any(f"walls, {name}" in cells for name in DELAYS):
        lines += _walls_part(cells)
    if any(f"coupled, {name}" in cells for name in DELAYS):
        lines += _coupled_part(cells)
    if "figure5" in cells:
        one = cells["figure5"]
        lines += [
            (
                f"**One axis pays nothing**: `avc run figure5` takes {one['after']:.1f} s of processor time, "
                f"{one['before']:.1f} before there were arms; other changes lie between (least of three, in turn)."
            ),
            "",
        ]
    PAGE.write_text("\n".join(lines).rstrip("\n") + "\n", encoding="utf-8")


def _walls_part(cells: dict[str, Any]) -> list[str]:
    rows = []
    for name in DELAYS:
        one = cells.get(f"walls, {name}")
        if one is None:
            continue
        for column, label in enumerate(one["labels"]):
            ends = [f"{one[key][column]:.0f}" for key in ("least_n_per_m", "median_n_per_m", "most_n_per_m")]
            cost = f"{one['reached']} of {one['poses']}", f"{one['cpu_s']:.0f} / {one['wall_s']:.0f}"
            rows.append([name if column == 0 else "", label, *ends, *(cost if column == 0 else ("", ""))])
    head = ["delay", "normal", "least, N/m", "median, N/m", "most, N/m", "poses reached", "processor / clock, s"]
    return [
        "## The stiffest wall over the workspace",
        "",
        (
            "Spring and damper along one axis, linearly stable with every corner of the hands and let go, at both "
            "ends of damping and of the effective mass, its tangent free and held (masses rounded outwards to 3 "
            "%: what is told is never too stiff). Two processes; the clock is that of a machine shared with other "
            "work."
        ),
        "",
        table(head, rows),
        "",
        "![Map of the stiffest wall](figures/workspace.png)",
        "",
        "*In the plane through home that looks towards the user; grey is out of the mechanism's reach.*",
        "",
    ]


def _coupled_part(cells: dict[str, Any]) -> list[str]:
    rows = []
    for name in DELAYS:
        one = cells.get(f"coupled, {name}")
        if one is None:
            continue
        others = one["others"]
        low, high = one["stiffness_n_per_m"]
        rows.append(
            [
                name,
                f"{one['per_axis_factor']:.3f}",
                f"{one['factor']:.3f}",
                f"{low:.0f} to {high:.0f}",
                f"{one['tangent_stiffness_n_per_m']:.0f}",
                f"{others['contacts']}",
                f"{others['unstable']}",
                f"{others['unstable_at_the_worst']}",
                f"{others['least_factor']:.3f}",
            ]
        )
    head = [
        "delay",
        "factor, designs per axis",
        "factor, as given out",
        "k along the normals, N/m",
        "k along the surface, N/m",
        "random contacts",
        "unstable",
        "unstable at 0.999 of the factor",
        "least factor of them",
    ]
    return [
        "## The coupled loop",
        "",
        (
            "Gains for 13 normals over the whole workspace, each 0.8 of the stiffest wall along its axis: along "
            "one axis they could grow by 1.25. *Factor*: by how much all gains may grow until the loop in space "
            "is unstable with some pose, normal, share of the tangent that is held, damping and hand (a mass, a "
            "damper and a spring, each with axes of its own), as a search finds it. Below 1.1 the gains are "
            "softened. Then poses, normals and hands drawn anew, which had no part in the search: none may be "
            "unstable before the search's worst."
        ),
        "",
        table(head, rows),
        "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, metavar="DIR", help="a checkout without arms, to time against")
    args = parser.parse_args()
    cells = {"masses": masses}
    # With and without the delay that a link has; the coupled loop as filed too.
    for name, delay in list(DELAYS.items())[:2]:
        cells[f"walls, {name}"] = lambda delay=delay: walls(delay)
    for name, delay in list(DELAYS.items())[1:]:
        cells[f"coupled, {name}"] = lambda delay=delay: coupled(delay)
    if args.before is not None:
        cells["figure5"] = lambda: figure5(args.before.resolve())
    computed(cells, OUT, about("python tests/benchmarks/arms.py", SEED), write_page)


if __name__ == "__main__":
    main()
