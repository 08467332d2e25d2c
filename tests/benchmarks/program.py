"""What `recommend` answers beside release 0.2.0 and beside its own answers to devices nearby.

OPENBLAS_NUM_THREADS=1 nice python tests/benchmarks/program.py --count 12

Overwrites results/program.json and RESULTS_program.md after every problem and goes on where it stopped; figures of
0.2.0 stay in the results file. Largest error of the impedance at the handle from 1 to 30 Hz, relative to the larger of
wall with device and wall alone; disk margin and peak noise gain over every corner of [hands] and released; and the
exported C in the simulator of the tests.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
from random_devices import drawn
from studied import about, computed, cpu_seconds, made_by, percent, rounded, table

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "oracle"))

from hardware_bench import export_c
from whole_device import WholeDevice, people, rests_as_tried

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.program import program_answers
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.wall import force_over_position, frozen_rendering
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.rank import impedance_error

SEED, HANDS = 90417, 192
NAMED = ("figure5", "reference-r1", "reference-r2", "reference-r3")
ALIKE = 0.005  # difference of the error that counts as none
OUT = Path(__file__).parent / "results" / "program.json"
PAGE = Path(__file__).parent / "RESULTS_program.md"


_PAGE = """\
# The coupling of the convex program

{made}

Largest error of the impedance at the handle from 1 to 30 Hz, relative to the larger of the wall with the device and of
the wall alone; disk margin and peak noise gain over every corner of `[hands]` and released; hands that rest in the
simulator of the tests, with the declared friction and without, as long as a trial watches. Nearby: error of the
program's nearest answer for the device with 1 % less and more mass and 0.1 samples more of delay, over that for the
device itself. Release 0.2.0 answered by a search; its figures were measured in the same way at commit 18972d2d.

{rows}

Of {of} problems with figures of both, the error is {half} of that of 0.2.0. Of {near} devices nearby, {close} have an
error within 3 % and {closer} within 10 % of their own device's, or within 0.005.

Limits: {count} problems, which are few; the linear measures are of the nominal device and the corners of the hands.
Processor time includes trials of 100 hands, certificate and sensitivities.
"""


def law_n_per_m(coupling: Coupling, turn: np.ndarray) -> np.ndarray:
    """Commanded force over measured position at angles of z, without dead zone."""
    problem, gains = coupling.problem, coupling.table.at_rest
    wall = frozen_rendering(problem, gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m)
    return force_over_position(wall, np.exp(1j * turn), coupling.runtime.state_feedback)


def measured(coupling: Coupling) -> dict[str, Any]:
    """Error, disk margin and noise gain of a coupling."""
    loop = OpenLoop.of(coupling)
    turn = loop.turns()
    gain = loop.gain(turn)
    stable = bool((np.abs(loop.poles) < 1).all())
    return {
        "error": impedance_error(coupling),
        "disk_margin": float(2 / np.abs((1 - gain) / (1 + gain)).max()) if stable else 0.0,
        "noise_n_per_m": float(np.abs(law_n_per_m(coupling, turn) / (1 + gain)).max()),
    }


def settled(coupling: Coupling, longest_s: float) -> list[int]:
    """How many of 200 hands rest in the three motions, with friction and without."""
    device = coupling.problem.device
    bench, hands = WholeDevice(device, export_c(coupling)), people(coupling.problem.hands, HANDS, 11)
    trials = (rests_as_tried(bench, device, hands, friction=friction, longest_s=longest_s) for friction in (None, 0.0))
    return [int(rests.sum()) for rests in trials]


def nearby(problem: Problem) -> list[float | None]:
    """Errors of the program's nearest answers for devices nearby, over that for the device itself."""
    device = problem.device
    nearby_kg, later = (0.99 * device.mass_kg, 1.01 * device.mass_kg), device.delay_samples + 0.1
    changes = [{}, *({"mass_kg": mass_kg} for mass_kg in nearby_kg), {"delay_samples": later}]
    errors: list[float | None] = []
    for change in changes:
        answers = program_answers(problem.changed(device=change))
        errors.append(answers[0].judged.error if answers and answers[0].met else None)
    return errors


def cell(problem: Problem) -> dict[str, Any]:
    """Figures of one problem."""
    before = cpu_seconds()
    found = avc.recommend(problem, hands=100)
    cpu_s = round(cpu_seconds() - before, 1)
    if found.coupling is None or found.trial is None:
        return {"cpu_s": cpu_s, "reason": found.reason}
    row = {
        "cpu_s": cpu_s,
        "kind": "plain" if found.coupling.runtime.state_feedback is None else "law",
        **measured(found.coupling),
    }
    row["settled"] = settled(found.coupling, found.trial.longest_s)
    return row | {"nearby": nearby(problem)}


def page(document: dict[str, Any]) -> str:
    """The page of the results."""
    rows, ratios, shares = [], [], []
    for name, one in document["cells"].items():
        before = document["about"]["release_0_2_0"].get(name)
        if "error" not in one:
            rows.append([name, *_figures(before), "none", *[""] * 4, f"{one['cpu_s']:.1f}"])
            continue
        own, *others = (np.nan if error is None else error for error in one["nearby"])
        ratios += [one["error"] / before["error"]] if before else []
        shares += [0.0 if abs(other - own) < ALIKE else abs(other / own - 1) for other in others if np.isfinite(own)]
        apart = " ".join(f"{other / own:.2f}" for other in others)
        rest = f"{one['settled'][0]}, {one['settled'][1]}"
        rows.append([f"{name} ({one['kind']})", *_figures(before), *_figures(one), rest, apart, f"{one['cpu_s']:.1f}"])
    parts = ("error, %", "disk margin", "noise gain, N/m")
    own_parts = (*parts, "settled of 200", "nearby", "processor, s")
    near = np.nan_to_num(shares, nan=np.inf)
    text = "\n\n".join(part.replace("\n", " ") for part in _PAGE.strip().split("\n\n")) + "\n"
    return text.format(
        made=made_by(document["about"]),
        half=f"{np.median(ratios):.2f} in the median and {max(ratios):.2f} at most",
        of=len(ratios),
        near=len(near),
        close=int((near < 0.03).sum()),
        closer=int((near < 0.1).sum()),
        count=len(rows),
        rows=table(("problem", *(f"0.2.0: {part}" for part in parts), *own_parts), rows),
    )


def _figures(one: dict[str, Any] | None) -> list[str]:
    return (
        ["-"] * 3 if not one else [percent(one["error"]), rounded(one["disk_margin"], 2), f"{one['noise_n_per_m']:.2g}"]
    )


def main() -> None:
    """Compute what is missing, and write results and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=12, help="devices drawn, default 12")
    parser.add_argument("--seed", type=int, default=SEED, help=f"of their draw, default {SEED}")
    given = parser.parse_args()
    cells = {name: lambda name=name: cell(avc.load_problem(name)) for name in NAMED}
    cells |= {f"device {index}": lambda index=index: cell(drawn(index, given.seed)) for index in range(given.count)}
    made = about(f"python tests/benchmarks/program.py --count {given.count}", given.seed)
    kept = json.loads(OUT.read_text(encoding="utf-8"))["about"]
    made |= {"commit": kept["commit"], "release_0_2_0": kept["release_0_2_0"]}
    computed(cells, OUT, made, lambda document: PAGE.write_text(page(document), encoding="utf-8") and None)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
