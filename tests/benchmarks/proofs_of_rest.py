"""How stiff a wall can be proved to come to rest, which designs are proved, and whether any proof is contradicted.

python tests/benchmarks/proofs_of_rest.py [PEOPLE] [OUT]

Walls: rigid couplings with the best of 16 contact dampers, clipped last, for delays, sample times and sets of hands.
Designs: the couplings of ve2 to ve7, and what `avc recommend` gives for the reference devices. Loops: random devices,
gains and boxes of hands, each proved, refuted or open, and put to a simulator of its own. PEOPLE loops are drawn.
Overwrites OUT (default tests/benchmarks/results/proofs_of_rest.json) and RESULTS_proofs_of_rest.md beside this file
after every cell; what OUT holds already is not computed again.
"""

from __future__ import annotations

import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, rounded, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from clip_last_simulator import Simulator, at_rest
from drawn_loops import contradiction, drawn_loop

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loop import STYLUS_RANGES
from avc_casadi.proof import HAND, ContactLaw, HeldDevice, Rest, prove_rest, rigid_with_damper, wall_gap
from avc_casadi.recommendation import design

HERE = Path(__file__).parent
OUT = HERE / "results" / "proofs_of_rest.json"
PAGE = HERE / "RESULTS_proofs_of_rest.md"
SEED = 14
LOOPS, LOOPS_A_CELL = 2000, 25
DESIGNS = ("none", "static", "static-tuned-series", "schedule-series", "static-tuned", "schedule")
WALLS = ("ve2", "ve3", "ve4", "ve5", "ve6", "ve7")
SECONDS = 3.0
# Where a verification gives up; five numbers of a hand take too many cells to go on.
MOST_CELLS = {"A": 400_000, "B": 20_000}
DAMPERS = {"A": 12, "B": 6}


def hands_of(population: str) -> dict[str, tuple[float, float]]:
    hands = avc.load_problem("figure5").hands
    return {name: getattr(hands, name) for name in HAND} if population == "A" else dict(STYLUS_RANGES)


def wall_cell(time_s: float, delay: int, population: str) -> dict[str, Any]:
    """Stiffest walls: proved, stable in contact, and at rest in the simulator."""
    problem = avc.load_problem("figure5").changed(
        device={"sample_time_s": time_s, "delay_samples": delay}, environment={"damping_ns_per_m": 0.0}
    )
    box = hands_of(population)
    shares = tuple(np.linspace(0.6, 3.0, DAMPERS[population]))
    laws = rigid_with_damper(ContactLaw.of(problem, np.inf, np.inf, 0.0), shares)
    highest = 1.6e5 * (1e-3 / time_s) / (1 + 2 * delay)
    began = time.perf_counter()
    gap = wall_gap(laws, problem.device, box, highest, most_cells=MOST_CELLS[population])
    seconds = time.perf_counter() - began
    low, high = 0.8 * gap.promised_n_per_m, 1.2 * gap.linear_n_per_m
    best = rigid_with_damper(ContactLaw.of(problem, np.inf, np.inf, 0.0), tuple(np.linspace(0.6, 3.0, 6)))
    for _ in range(6):
        middle = (low + high) / 2
        rests = any(_rests(law, problem.device, box) for law in best(middle))
        low, high = (middle, high) if rests else (low, middle)
    simulated = low
    linear = gap.linear_n_per_m if population == "A" else None
    return {
        "proved": gap.proved_n_per_m,
        "promised": gap.promised_n_per_m,
        "linear": linear,
        "simulated": simulated,
        "seconds": seconds,
    }


def _rests(law: ContactLaw, device: Any, box: dict[str, tuple[float, float]]) -> bool:
    random = np.random.default_rng(SEED)
    corners = HeldDevice(device, box).corners()
    ends = np.array(list(box.values()))
    drawn = random.uniform(ends[:, 0], ends[:, 1], (40, len(ends)))
    hands = dict(zip(box, np.concatenate([corners, drawn]).T, strict=True))
    count = len(next(iter(hands.values())))
    gains = {
        "b": law.damping_ns_per_m,
        "k": law.stiffness_n_per_m,
        "b_p": law.contact_damping_ns_per_m,
        "b_e": law.wall_damping_ns_per_m,
        "k_e": law.wall_stiffness_n_per_m,
    }
    simulator = Simulator(device.model_dump(), gains, hands, random.uniform(-0.01, 0.02, count))
    simulator.start(random.uniform(-0.01, 0.002, count), random.uniform(-0.3, 0.5, count))
    return bool(at_rest(simulator, SECONDS).all())


def design_cell(wall: str, name: str) -> dict[str, Any]:
    """What is known of a design at a wall, by both contact laws."""
    problem = avc.load_problem(wall)
    found = design(problem, name)
    if found.gains is None:
        return {"reason": found.reason}
    coupling = (
        Coupling.constant(problem, found.gains, name)
        if found.schedule is None
        else Coupling.of(problem, found.schedule)
    )
    return {law: _known(coupling, law) for law in ("clip-last", "gated")}


def reference_cell(name: str) -> dict[str, Any]:
    """What is known of the recommended coupling of a reference device, and of it without its dead zone."""
    coupling = avc.recommend(avc.load_problem(name)).coupling
    if coupling is None:
        return {"reason": "nothing could be recommended"}
    found = {law: _known(coupling, law) for law in ("clip-last", "gated")}
    return found | {"wall": coupling.wall.stiffness_n_per_m, "method": coupling.method}


def _known(coupling: Coupling, contact: Any) -> dict[str, Any]:
    box = {name: getattr(coupling.problem.hands, name) for name in HAND}
    proofs: list[Rest] = []
    for _, b, k, contact_damping in coupling.table.rows.tolist():
        law = ContactLaw.of(coupling.problem, b, k, contact_damping, coupling.runtime.state_feedback)
        proofs.append(prove_rest(law, contact, coupling.problem.device, box))
    return {
        "outcomes": dict(Counter(one.outcome for one in proofs)),
        "sentence": proofs[0].sentence,
        "cells": sum(one.cells for one in proofs),
        "seconds": sum(one.seconds for one in proofs),
    }


def loops_cell(first: int, count: int) -> dict[str, Any]:
    """Random loops, each judged and put to the simulator."""
    outcomes: Counter[str] = Counter()
    against: list[str] = []
    for seed in range(first, first + count):
        loop = drawn_loop(seed)
        outcomes[loop.proof.outcome] += 1
        fault = contradiction(loop, seed)
        if fault:
            against.append(f"loop {seed}: {fault}")
    return {"outcomes": dict(outcomes), "contradictions": against}


TEXT = """# Rest: proved, refuted, open

{made_by}

A proof is of the law that is clipped last, for every hand of the box, every resting target and every initial state,
without friction: one multiplier of Zames and Falb, verified by enclosures. Refuted: a hand with which the loop is
unstable in contact, or an orbit that never ends.

## The stiffest walls

Figure 5's device (0.1 kg, 2 N.s/m), rigid coupling, wall without damper, best of 12 contact dampers (set B: 6) from
0.6 to 3 K T. **Proved**: for the whole box, 0 where verification gave up. **Promised**: a multiplier serves the corners
of the box, which is no proof. **Linear**: stable in contact with the corners and 24 draws; not computed for hands on a
stylus. **Simulated**: the corners and 40 draws, each from a random state to a random target, at rest in a simulator of
its own, with the best of 6 dampers (bisection, to about 1%). s: time of both searches and of the verification. Set A:
0.05 to 0.3 kg, 3 to 20 N.s/m, 200 to 800 N/m. Set B: hands on a stylus, five numbers.

{walls}

## Designs

{designs}

## Random loops

{loops}
"""
NOT_YET = "Not computed yet: the command above goes on where it stopped."
DESIGNED = """Rows of the table that runs, each with its gains held. Time: that of all rows.

{designs}

What is said of the first row:

{said}"""
DRAWN = """{loops} random loops: rigid, resonant and with an amplifier, delays of 0 to 2 samples whole and not,
sample times of
0.25 to 2 ms, boxes of hands of random size, gains about the edge of what is stable: {outcomes}. Each proved one was
simulated from random states by code that shares nothing with the project; each witness of a refuted one was replayed
there (those of hands on their way to instability, and orbits). **Contradictions: {contradictions}.**"""


def write_page(document: dict[str, Any]) -> None:
    cells = document["cells"]

    def of(kind: str) -> list[tuple[list[str], dict[str, Any]]]:
        return [(name.split(" | ")[1:], cell) for name, cell in cells.items() if name.startswith(f"{kind} | ")]

    def outcome(cell: dict[str, Any], law: str) -> str:
        found = cell.get(law)
        if found is None:
            return "-"
        counts = ", ".join(f"{count} {word}" for word, count in found["outcomes"].items())
        return f"{counts} ({found['seconds']:.1f} s)"

    walls = table(
        ("T, ms", "delay", "hands", "proved, N/m", "promised, N/m", "linear, N/m", "simulated, N/m", "s"),
        (
            (
                *key,
                *(
                    rounded(cell[one]) if cell.get(one) else "-"
                    for one in ("proved", "promised", "linear", "simulated")
                ),
                f"{cell['seconds']:.0f}" if "seconds" in cell else "-",
            )
            for key, cell in of("wall")
        ),
    )
    designed = [*of("design"), *of("reference")]
    designs = table(
        ("wall", "design", "clip-last", "gated"),
        (
            (
                key[0],
                key[1] if len(key) > 1 else cell.get("method", "-"),
                outcome(cell, "clip-last"),
                outcome(cell, "gated"),
            )
            for key, cell in designed
        ),
    )
    said = "\n".join(
        f"- {', '.join(key)}, {law}: {cell[law]['sentence']}"
        for key, cell in designed
        for law in ("clip-last", "gated")
        if law in cell
    )
    counted: Counter[str] = Counter()
    against: list[str] = []
    for _, cell in of("loops"):
        counted.update(cell.get("outcomes", {}))
        against += cell.get("contradictions", [])
    loops = DRAWN.format(
        loops=counted.total(),
        outcomes=", ".join(f"{count} {word}" for word, count in counted.items()),
        contradictions=len(against) if not against else f"{len(against)}: {'; '.join(against)}",
    )
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            walls=walls,
            designs=DESIGNED.format(designs=designs, said=said) if designed else NOT_YET,
            loops=loops if counted else NOT_YET,
        ),
        encoding="utf-8",
    )


def main() -> None:
    args = script_arguments(__doc__, people=LOOPS, out=OUT)
    cells: dict[str, Any] = {}
    loops = {
        f"loops | {first}": partial(loops_cell, first, min(LOOPS_A_CELL, args.people - first))
        for first in range(0, args.people, LOOPS_A_CELL)
    }
    walls = {
        f"wall | {1e3 * time_s:g} | {delay} | {population}": partial(wall_cell, time_s, delay, population)
        for population in ("A", "B")
        for time_s in (1e-3, 2.5e-4)
        for delay in (0, 1, 2)
    }
    cells |= {name: cell for name, cell in walls.items() if name.startswith("wall | 1 ") and name.endswith("A")}
    cells |= dict(list(loops.items())[:2])
    cells |= {name: cell for name, cell in walls.items() if name.endswith("A")}
    cells |= {f"design | {wall} | static-tuned": partial(design_cell, wall, "static-tuned") for wall in WALLS}
    cells |= {f"design | {wall} | {name}": partial(design_cell, wall, name) for wall in WALLS for name in DESIGNS}
    for name in ("reference-r1", "reference-r2", "reference-r3"):
        cells[f"reference | {name}"] = partial(reference_cell, name)
    cells |= walls | loops
    computed(cells, args.out, about("python tests/benchmarks/proofs_of_rest.py", SEED), write_page)


if __name__ == "__main__":
    main()
