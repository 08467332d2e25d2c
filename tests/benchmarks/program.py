"""What `recommend` answers beside release 0.2.0, beside its own answers to devices nearby, and what a margin costs.

OPENBLAS_NUM_THREADS=1 nice python tests/benchmarks/program.py --count 4 [--hands 2000]

Figures of release 0.2.0 are those of the results file; this script measured them, as of commit cd74c515. Overwrites
results/program.json and RESULTS_program.md after every problem and goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from functools import partial
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
from avc_casadi.recommendation.sensitivity import trade_off

SEED, EACH = 90417, 5
NAMED = ("figure5", "reference-r1", "reference-r2", "reference-r3")
ALIKE = 0.005  # difference of the error that counts as none
OUT = Path(__file__).parent / "results" / "program.json"
PAGE = Path(__file__).parent / "RESULTS_program.md"


def measured(coupling: Coupling) -> dict[str, Any]:
    """Error, disk margin and noise gain of a coupling."""
    loop = OpenLoop.of(coupling)
    turn = loop.turns()
    gain = loop.gain(turn)
    stable = bool((np.abs(loop.poles) < 1).all())
    law, wall = (
        coupling.runtime.state_feedback,
        frozen_rendering(coupling.problem, *vars(coupling.table.at_rest).values()),
    )
    n_per_m = force_over_position(wall, np.exp(1j * turn), law)  # commanded force over measured position, no dead zone
    return {
        "method": coupling.method if law is None else f"law of {law.states}",
        "error": impedance_error(coupling),
        "disk_margin": float(2 / np.abs((1 - gain) / (1 + gain)).max()) if stable else 0.0,
        "noise_n_per_m": float(np.abs(n_per_m / (1 + gain)).max()),
    }


def settled(problem: Problem, files: dict[str, str], longest_s: float, count: int) -> dict[str, Any]:
    """How many hands rest in three motions, with friction and without; as long as a trial watches, and 1 s later."""
    device, bench = problem.device, WholeDevice(problem.device, files)
    hands, found = people(problem.hands, count - 8, 11), {"hands": count, "settled": [], "a second after": []}
    for friction in (None, 0.0):
        rests = rests_as_tried(bench, device, hands, friction=friction, longest_s=longest_s)
        moving = [hand for hand, rest in zip(hands, rests, strict=True) if not rest]
        later = rests_as_tried(bench, device, moving, friction=friction, longest_s=longest_s + 1)
        found["settled"].append(int(rests.sum()))
        found["a second after"].append(int(rests.sum() + later.sum()))
    return found


def nearby(problem: Problem) -> list[float | None]:
    """Errors of the program's nearest answers for devices nearby, after that for the device itself."""
    device = problem.device
    nearby_kg, later = (0.99 * device.mass_kg, 1.01 * device.mass_kg), device.delay_samples + 0.1
    changes = [{}, *({"mass_kg": mass_kg} for mass_kg in nearby_kg), {"delay_samples": later}]
    errors: list[float | None] = []
    for change in changes:
        answers = program_answers(problem.changed(device=change))
        errors.append(answers[0].judged.error if answers and answers[0].met else None)
    return errors


def cell(name: str, given: argparse.Namespace, old: dict[str, Any] | None, margin: float | None) -> dict[str, Any]:
    """Figures of one problem, of the release and of this package; of some also of devices nearby."""
    problem = _problem(name)
    stated = problem if margin is None else problem.changed(robustness={"disk_margin": margin})
    before = cpu_seconds()
    found = avc.recommend(stated, hands=100)
    one: dict[str, Any] = {"cpu_s": round(cpu_seconds() - before, 1)}
    longest_s = 4.25 if found.trial is None else found.trial.longest_s
    if found.coupling is None:
        one["reason"] = found.reason
    else:
        files = export_c(found.coupling)
        one |= measured(found.coupling) | settled(problem, files, longest_s, given.hands)
    if margin is not None:
        return {"now": one}
    cells: dict[str, Any] = {"now": one, "release": old or {}}
    if old and old.get("disk_margin", 0.0) > 0:
        answers = program_answers(problem, old["disk_margin"], old["noise_n_per_m"])
        cells["at its margin"] = [{"error": best.judged.error, "met": best.met} for best in answers[:1]]
    if name in NAMED[:2] or (name not in NAMED and int(name.split()[1]) % EACH == 0):
        cells["nearby"] = nearby(problem)
    return cells


def traded(problem: Problem) -> dict[str, Any]:
    """What a disk margin costs, and where the answer stands."""
    found = avc.recommend(problem, hands=100)
    if found.coupling is None:
        return {"reason": found.reason}
    errors = [[*one.error, one.ripple_n, one.disk_margin, one.met] for one in trade_off(problem)]
    answer = measured(found.coupling)
    ripple_n = answer["noise_n_per_m"] * problem.device.encoder_resolution_m
    return {"answer": answer, "points": errors, "ripple_n": ripple_n}


def _problem(name: str) -> Problem:
    first, *index = name.split()
    return drawn(int(index[0]), SEED) if first == "device" else avc.load_problem(first)


_PAGE = """\
# The coupling of the convex program

{made}

Largest error of the impedance at the handle from 1 to 30 Hz, relative to the larger of the wall with the device and of
the wall alone; disk margin and peak noise gain over every corner of `[hands]` and released; of 100 hands those that
rest in the simulator of the tests, which runs the exported C, with the declared friction and without, as long as a
trial watches. Release 0.2.0 is commit 18972d2d, measured in the same way. *At its margin*: error of the program asked
for the release's disk margin and noise gain. *Nearby*: error of the program's nearest answer for the device with 1 %
less and more mass and 0.1 samples more of delay, over that for the device itself. Processor time includes trials of
100 hands, certificate and sensitivities. Devices are drawn at random (`random_devices.drawn`).

{rows}

{told}

What a disk margin costs: the best law that the program finds when led from margin to margin. What is recommended (bold,
its largest error) must also bear devices a tenth off and simulated hands.

{traded}
"""


def page(document: dict[str, Any]) -> None:
    """Write the page of the results."""
    rows, ratios, times, shares, traded, hands = [], [], [], [], [], np.zeros((3, 2), dtype=int)
    for name, one in document["cells"].items():
        if "points" in one:
            traded += _traded(name.removeprefix("trade-off "), one)
        if "now" not in one:
            continue
        now, old = one["now"], one.get("release", {})
        equal = one.get("at its margin") or [{"met": False}]
        own, *others = (np.nan if error is None else error for error in one.get("nearby", [np.nan]))
        if "error" in now and "error" in old:
            ratios.append(equal[0]["error"] / old["error"] if equal[0]["met"] else np.nan)
            times += [now["cpu_s"] / old["cpu_s"]] if "cpu_s" in old else []
        shares += [0.0 if abs(other - own) < ALIKE else abs(other / own - 1) for other in others]
        hands += [[now.get("hands", 0)] * 2, now.get("settled", [0, 0]), now.get("a second after", [0, 0])]
        near = percent(equal[0]["error"]) if equal[0]["met"] else "-"
        apart = " ".join(f"{other / own:.2f}" for other in others)
        rows.append([f"{name} ({now.get('method', 'none')})", *_figures(old), *_figures(now), near, apart])
    apart, of = np.nan_to_num(shares, nan=np.inf), np.array(ratios)
    told = f"""\
At the release's margin and noise gain the error is {np.nanmedian(of):.2f} of that of 0.2.0 in the median and
{np.nanmax(of):.2f} at most, of {len(of)} problems, on {np.isnan(of).sum()} of which the program does not meet them.
Of {len(apart)} devices nearby {(apart < 0.03).sum()} are within 3 % and {(apart < 0.1).sum()} within 10 %, or within
{ALIKE}."""
    if times:
        told += f" Processor time {np.median(times):.2f} of that of 0.2.0 in the median and {max(times):.2f} at most."
    told += f""" Of {hands[0, 0]} hands {hands[1, 0]} rest with friction and {hands[1, 1]} without; a second after
{hands[2, 0]} and {hands[2, 1]}."""
    parts = ("error, %", "disk margin", "noise gain, N/m", "settled", "s")
    head = ("problem", *(f"0.2.0: {part}" for part in parts), *parts, "at its margin, %", "nearby")
    costs = table(("problem", "disk margin", "1 Hz, %", "10 Hz, %", "30 Hz, %", "ripple, N"), traded)
    filled = {"rows": table(head, rows), "told": told, "traded": costs}
    text = _PAGE.format(made=made_by(document["about"]), **filled)
    joined = (part if part.startswith("|") else part.replace("\n", " ") for part in text.strip().split("\n\n"))
    PAGE.write_text("\n\n".join(joined) + "\n", encoding="utf-8")


def _traded(name: str, one: dict[str, Any]) -> list[list[str]]:
    answer = one["answer"]
    found = [(margin, [*map(percent, errors), f"{ripple:.2g}"]) for *errors, ripple, margin, _ in one["points"]]
    mark = [f"**{percent(answer['error'])}**", "", "", f"{one['ripple_n']:.2g}"]
    every = sorted([*found, (answer["disk_margin"], mark)], key=lambda row: row[0])
    return [[name, f"**{margin:.2f}**" if row is mark else f"{margin:.2f}", *row] for margin, row in every]


def _figures(one: dict[str, Any]) -> list[str]:
    if "error" not in one:
        return ["-"] * 5
    rests, gain = "{}, {}".format(*one.get("settled", "--")), f"{one['noise_n_per_m']:.2g}"
    return [percent(one["error"]), rounded(one["disk_margin"], 2), gain, rests, str(one.get("cpu_s", "-"))]


def main() -> None:
    """Compute what is missing, and write results and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40, help="devices drawn, default 40")
    parser.add_argument("--hands", type=int, default=100, help="hands of each trial, default 100")
    given = parser.parse_args()
    kept = json.loads(OUT.read_text(encoding="utf-8"))
    first = {"release_0_2_0": kept["about"]["release_0_2_0"]}  # of a run before
    known = first["release_0_2_0"] | {name: one["release"] for name, one in kept["cells"].items() if one.get("release")}
    cells: dict[str, Any] = {}
    for name in (*NAMED, *(f"device {index}" for index in range(given.count))):
        cells[name] = partial(cell, name, given, known.get(name), None)
    cells |= {f"{name} at 0.15": partial(cell, name, given, None, 0.15) for name in NAMED[1:]}
    cells |= {f"trade-off {name}": partial(traded, _problem(name)) for name in NAMED[:2]}
    made = about("python tests/benchmarks/program.py --count N", SEED) | first
    if kept["about"] != made:
        OUT.unlink()
    computed(cells, OUT, made, page)


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
