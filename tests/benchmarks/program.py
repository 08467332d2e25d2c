"""What `recommend` answers beside release 0.2.0, beside its own answers to devices nearby, and what a margin costs.

OPENBLAS_NUM_THREADS=1 nice python tests/benchmarks/program.py --count 4

Figures of release 0.2.0 are those of the results file; this script measured them, as of commit cd74c515. Overwrites
results/program.json and RESULTS_program.md after every problem, and goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from drawn_devices import drawn
from studied import about, computed, cpu_seconds, made_by, percent, rounded, table

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "oracle"))

from hardware_bench import export_c
from whole_device import WholeDevice, people, rests_as_tried

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.design.program import program_answers
from avc_casadi.loops.margins import OpenLoop
from avc_casadi.loops.wall import law_at_rest
from avc_casadi.model.problem import Problem
from avc_casadi.recommendation.candidates import springs_and_dampers
from avc_casadi.recommendation.rank import impedance_error
from avc_casadi.recommendation.sensitivity import trade_off

SEED = 90417
NEIGHBOURS_OF = 30
"""So many of the drawn devices are compared with devices nearby."""
NAMED = ("figure5", "reference-r1", "reference-r2", "reference-r3")
ALIKE = 0.005  # difference of the error that counts as none
CLOSE = 0.05  # relative difference up to which neighbours are close
OUT = Path(__file__).parent / "results" / "program.json"
PAGE = Path(__file__).parent / "RESULTS_program.md"


def measured(coupling: Coupling) -> dict[str, Any]:
    """Error, disk margin and noise gain of a coupling."""
    loop = OpenLoop.of(coupling)
    turn = loop.turns()
    gain = loop.gain(turn)
    stable = bool((np.abs(loop.poles) < 1).all())
    law = coupling.runtime.state_feedback
    n_per_m = law_at_rest(coupling).transfer(np.exp(1j * turn))  # commanded force over measured position, no dead zone
    return {
        "method": coupling.method if law is None else f"law of {law.states}",
        "error": impedance_error(coupling),
        "disk_margin": float(2 / np.abs((1 - gain) / (1 + gain)).max()) if stable else 0.0,
        "noise_n_per_m": float(np.abs(n_per_m / (1 + gain)).max()),
    }


def settled(problem: Problem, files: dict[str, str], longest_s: float) -> list[int]:
    """How many of 100 hands rest in three motions as long as a trial watches, with friction and without."""
    device, bench = problem.device, WholeDevice(problem.device, files)
    runs = {"hands": people(problem.hands, 92, 11), "longest_s": longest_s}
    return [int(rests_as_tried(bench, device, friction=friction, **runs).sum()) for friction in (None, 0.0)]


def neighbours(problem: Problem) -> list[Problem]:
    """Return the problem, and those whose device has 1 % less and more mass, and 0.1 samples more of delay."""
    mass_kg, delay_samples = problem.device.mass_kg, problem.device.delay_samples
    changes = ({}, {"mass_kg": 0.99 * mass_kg}, {"mass_kg": 1.01 * mass_kg}, {"delay_samples": delay_samples + 0.1})
    return [problem.changed(device=change) for change in changes]


def nearest_of_program(problem: Problem) -> float | None:
    """Error of the program's nearest answer that meets its goals; None without any."""
    answer = next(iter(program_answers(problem)), None)
    return answer.performance.error if answer is not None and answer.meets_goals else None


def recommended(problem: Problem) -> float | None:
    """Error of the recommended coupling; None without any."""
    coupling = avc.recommend(problem, hands=30).coupling
    return None if coupling is None else impedance_error(coupling)


def at_margin(problem: Problem, disk_margin: float, noise_n_per_m: float) -> float | None:
    """Error of the nearest law or contact damper with a disk margin and a noise gain; None without any."""
    laws = program_answers(problem, disk_margin, noise_n_per_m)
    plain = map(measured, springs_and_dampers(problem.changed(robustness={"disk_margin": max(disk_margin, 0.01)})))
    met = (one for one in plain if one["disk_margin"] > 0.98 * disk_margin)
    quiet = (one["error"] for one in met if one["noise_n_per_m"] < 1.02 * noise_n_per_m)
    return min([*(one.performance.error for one in laws if one.meets_goals), *quiet], default=None)


def cell(name: str, old: dict[str, Any], margin: float | None) -> dict[str, Any]:
    """Figures of one problem, beside those of the release; of some also of devices nearby."""
    problem = _problem(name)
    before = cpu_seconds()
    found = avc.recommend(problem if margin is None else problem.changed(robustness={"disk_margin": margin}), hands=100)
    one: dict[str, Any] = {"cpu_s": round(cpu_seconds() - before, 1)}
    if found.coupling is not None and found.trial is not None:
        one |= measured(found.coupling)
        one["settled"] = settled(problem, export_c(found.coupling), found.trial.longest_s)
    cells: dict[str, Any] = {"now": one}
    if margin is None and "error" in old:
        cells |= {"release": old, "at its margin": at_margin(problem, old["disk_margin"], old["noise_n_per_m"])}
    if margin is None and (name in NAMED[:2] or (name not in NAMED and int(name.split()[1]) < NEIGHBOURS_OF)):
        near = neighbours(problem)
        cells["nearby"] = [nearest_of_program(changed) for changed in near]
        cells["recommended nearby"] = [recommended(changed) for changed in near]
    return cells


def traded(problem: Problem) -> dict[str, Any]:
    """What a disk margin costs, and where the answer stands."""
    found = avc.recommend(problem, hands=100)
    assert found.coupling is not None
    errors = [[*one.error, one.ripple_n, one.disk_margin, one.met] for one in trade_off(problem)]
    answer = measured(found.coupling)
    ripple_n = answer["noise_n_per_m"] * problem.device.encoder_resolution_m
    return {"answer": answer, "points": errors, "ripple_n": ripple_n}


def _problem(name: str) -> Problem:
    first, *index = name.split()
    return drawn(int(index[0]), SEED) if first == "device" else avc.load_problem(first)


_PAGE = """\
# The observer law

{made}

Largest error of the impedance at the handle from 1 to 30 Hz, relative to the larger of the wall with the device and of
the wall alone; disk margin and peak noise gain over every corner of `[hands]` and released; of 100 hands those that
rest in the simulator of the tests, which runs the exported C, with the declared friction and without, as long as a
trial watches. Release 0.2.0 is commit 18972d2d, measured in the same way. *At its margin*: the nearest law of the
program or contact damper with the release's disk margin and noise gain. *Nearby*: error of the program's nearest answer
for the device with 1 % less and more mass and 0.1 samples more of delay, over that for the device itself. Processor
time includes trials of 100 hands, certificate and sensitivities.

{named}

Devices drawn at random (`drawn_devices.drawn`):

{drawn}

{summary}

What a disk margin costs: the best law that the program finds when led from margin to margin. What is recommended (bold,
its largest error) must also bear devices a tenth off and simulated hands.

{traded}
"""


def page(document: dict[str, Any]) -> None:
    """Write the page of the results."""
    cells: dict[str, Any] = document["cells"]
    traded = [row for name, one in cells.items() if "points" in one for row in _traded(name, one)]
    drawn = [one for name, one in cells.items() if name.startswith("device") and "now" in one]
    parts = ("error, %", "disk margin", "noise gain, N/m", "settled", "s")
    head = ("problem", *(f"0.2.0: {part}" for part in parts), *parts, "at its margin, %", "nearby")
    named = [_row(name, one) for name, one in cells.items() if "now" in one and not name.startswith("device")]
    both = [one for one in drawn if "error" in one["now"] and "release" in one]
    if not both:  # the named problems come first
        return
    keys = ("error", "disk_margin", "noise_n_per_m", "cpu_s", "settled")
    errors, margins, noises, times, rests = (
        np.array([[one[which][key] for one in both] for which in ("now", "release")]) for key in keys
    )
    equal = np.array([one["at its margin"] or np.nan for one in both]) / errors[1]
    changes = {
        "error, %": 100 * errors[0],
        "0.2.0: error, %": 100 * errors[1],
        "at its margin: error over that of 0.2.0": equal[np.isfinite(equal)],
        "disk margin": margins[0],
        "0.2.0: disk margin": margins[1],
        "noise gain over that of 0.2.0": noises[0] / noises[1],
        "processor time, s": times[0],
        "0.2.0: processor time, s": times[1],
    }
    shares = (0, 10, 25, 50, 75, 90, 100)
    quantiles = [[what, *(f"{x:.3g}" for x in np.percentile(values, shares))] for what, values in changes.items()]
    head_drawn = (f"of {len(both)} devices", "least", "10 %", "25 %", "median", "75 %", "90 %", "largest")
    close = {key: _close(drawn, key) for key in ("nearby", "recommended nearby")}
    summary = f"""\
Of {len(drawn)} devices {len(both)} have a coupling of both, {(margins[0] < 0.15).sum()} with a disk margin below
0.15, in 0.2.0 {(margins[1] < 0.15).sum()}. At its margin and noise gain the error is above 1.1 times that of 0.2.0 on
{(equal > 1.1).sum()}, and on {np.isnan(equal).sum()} nothing is found with both. Of {100 * len(both)} hands
{" and ".join(map(str, rests[0].sum(axis=0)))} rest with friction and without, in 0.2.0
{" and ".join(map(str, rests[1].sum(axis=0)))}. The errors of all three devices nearby are within 5 %,
or {ALIKE}: by the program's law on {close["nearby"]} devices, by the recommended coupling on
{close["recommended nearby"]}."""
    filled = {"named": table(head, named), "drawn": table(head_drawn, quantiles), "summary": summary}
    costs = table(("problem", "disk margin", "1 Hz, %", "10 Hz, %", "30 Hz, %", "ripple, N"), traded)
    text = _PAGE.format(made=made_by(document["about"]), traded=costs, **filled)
    joined = (part if part.startswith("|") else part.replace("\n", " ") for part in text.strip().split("\n\n"))
    PAGE.write_text("\n\n".join(joined) + "\n", encoding="utf-8")


def _row(name: str, one: dict[str, Any]) -> list[str]:
    now, near = one["now"], one.get("at its margin")
    own, *others = one.get("nearby", [None])
    apart = " ".join("none" if other is None else f"{other / own:.2f}" for other in others)
    title = f"{name} ({now.get('method', 'none')})"
    return [title, *_figures(one.get("release", {})), *_figures(now), "-" if near is None else percent(near), apart]


def _close(drawn: list[dict[str, Any]], key: str) -> str:
    """Return on how many of the compared devices all neighbours have nearly the same error."""
    compared = [one[key] for one in drawn if key in one]
    close = sum(max(_changes(errors)) < CLOSE for errors in compared)
    return f"{close} of {len(compared)}"


def _changes(errors: list[float | None]) -> list[float]:
    own, *others = (math.inf if error is None else error for error in errors)
    return [0.0 if other == own or abs(other - own) < ALIKE else abs(other / own - 1) for other in others]


def _traded(name: str, one: dict[str, Any]) -> list[list[str]]:
    answer = one["answer"]
    found = [(margin, [*map(percent, errors), f"{ripple:.2g}"]) for *errors, ripple, margin, _ in one["points"]]
    mark = [f"**{percent(answer['error'])}**", "", "", f"{one['ripple_n']:.2g}"]
    every = sorted([*found, (answer["disk_margin"], mark)], key=lambda row: row[0])
    title = name.removeprefix("trade-off ")
    return [[title, f"**{margin:.2f}**" if row is mark else f"{margin:.2f}", *row] for margin, row in every]


def _figures(one: dict[str, Any]) -> list[str]:
    if "error" not in one:
        return ["-"] * 5
    rests, gain = "{}, {}".format(*one["settled"]), f"{one['noise_n_per_m']:.2g}"
    return [percent(one["error"]), rounded(one["disk_margin"], 2), gain, rests, str(one.get("cpu_s", "-"))]


def main() -> None:
    """Compute what is missing, and write results and page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=40, help="devices drawn, default 40")
    given = parser.parse_args()
    cells: dict[str, Any] = {}
    known = {name: one.get("release", {}) for name, one in json.loads(OUT.read_text("utf-8"))["cells"].items()}
    for name in (*NAMED, *(f"device {index}" for index in range(given.count))):
        cells[name] = partial(cell, name, known.get(name, {}), None)
    cells |= {f"{name} at 0.15": partial(cell, name, {}, 0.15) for name in NAMED[1:]}
    cells |= {f"trade-off {name}": partial(traded, _problem(name)) for name in NAMED[:2]}
    made = about("python tests/benchmarks/program.py --count N", SEED)
    if json.loads(OUT.read_text("utf-8"))["about"] != made:
        OUT.unlink()
    computed(cells, OUT, made, page)


if __name__ == "__main__":
    main()
