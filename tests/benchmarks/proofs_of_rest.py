"""How stiff a wall can be proved to come to rest, and what is proved of which design.

python tests/benchmarks/proofs_of_rest.py [--only AREA] [OUT]

Walls: rigid couplings with the best of some contact dampers, clipped last, for delays, sample times and sets of hands.
Designs: the couplings of ve2 to ve7, and what `avc recommend` gives for the reference devices: L7 as
`avc certify --prove` has it. Overwrites a file for each area, OUT with the area in its name (default of OUT:
tests/benchmarks/results/proofs_of_rest.json), and RESULTS_proofs_of_rest.md beside this file after every cell; what the
files hold already is not computed again.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, rounded, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from clip_last_simulator import Simulator, at_rest

import avc_casadi as avc
from avc_casadi.claims.prove.held_device import HAND, SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import promising, prove_rest, sampled_hands, unstable_hand
from avc_casadi.coupling import Coupling
from avc_casadi.design.comparison.table1 import design
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.model.hands import STYLUS_RANGES

HERE = Path(__file__).parent
OUT = HERE / "results" / "proofs_of_rest.json"
PAGE = HERE / "RESULTS_proofs_of_rest.md"
SEED = 14
AREAS = ("walls", "designs", "references")
DESIGNS = ("static-tuned", "static-tuned-series", "none", "static", "schedule-series", "schedule")
WALLS = ("ve2", "ve3", "ve4", "ve5", "ve6", "ve7")
SECONDS = 3.0
DAMPERS = {"A": 12, "B": 6}
STEPS, TRIES, BACK = 12, 5, 0.998
Laws = Callable[[float], Sequence[ContactLaw]]


def hands_of(population: str) -> dict[str, tuple[float, float]]:
    hands = avc.load_problem("figure5").hands
    return {name: getattr(hands, name) for name in HAND} if population == "A" else dict(STYLUS_RANGES)


def rigid_with_damper(law: ContactLaw, shares: Sequence[float]) -> Laws:
    """Return rigid couplings with contact dampers of so many K T."""

    def at(stiffness: float) -> list[ContactLaw]:
        return [
            replace(
                law,
                damping_ns_per_m=np.inf,
                stiffness_n_per_m=np.inf,
                contact_damping_ns_per_m=share * stiffness * law.sample_time_s,
                wall_stiffness_n_per_m=stiffness,
            )
            for share in shares
        ]

    return at


def last_that(holds: Callable[[float], bool], highest: float) -> float:
    """Return the last stiffness that holds, from soft to stiff."""
    low, high = 0.0, highest
    for _ in range(STEPS):
        middle = (low + high) / 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


def stiffest_walls(
    laws: Laws, device: Any, box: dict[str, tuple[float, float]], highest: float
) -> tuple[float, float, float]:
    """Return the stiffest walls: proved (0 where verification gave up), with a multiplier at the corners, stable."""
    held, hands = SampledPlantBox(device, box), sampled_hands(box, 0)
    assert hands is not None
    linear = last_that(lambda wall: any(unstable_hand(law, device, hands) is None for law in laws(wall)), highest)
    wall = promised = last_that(lambda wall: any(promising(law, held) > 0 for law in laws(wall)), linear)
    for _ in range(TRIES):
        best = max(laws(wall), key=lambda law: promising(law, held))
        if prove_rest(best, "clip-last", device, box).outcome == "proved":
            return wall, promised, linear
        wall *= BACK
    return 0.0, promised, linear


def wall_cell(time_s: float, delay: int, population: str) -> dict[str, Any]:
    """Stiffest walls: proved, stable in contact, and at rest in the simulator."""
    problem = avc.load_problem("figure5").changed(
        device={"sample_time_s": time_s, "delay_samples": delay}, environment={"damping_ns_per_m": 0.0}
    )
    box = hands_of(population)
    shares = tuple(np.linspace(0.6, 3.0, DAMPERS[population]))
    laws = rigid_with_damper(ContactLaw.of(problem, np.inf, np.inf, 0.0), shares)
    # What a mass takes grows with the square of the rate; no cell may end at this bound.
    highest = 1.6e5 * (1e-3 / time_s) ** 2 / (1 + 2 * delay)
    began = time.process_time()
    proved, promised, linear = stiffest_walls(laws, problem.device, box, highest)
    seconds = time.process_time() - began
    assert max(promised, linear) < highest
    low, high = 0.8 * promised, 1.2 * linear
    best = rigid_with_damper(ContactLaw.of(problem, np.inf, np.inf, 0.0), tuple(np.linspace(0.6, 3.0, 6)))
    for _ in range(6):
        middle = (low + high) / 2
        rests = any(_rests(law, problem.device, box) for law in best(middle))
        low, high = (middle, high) if rests else (low, middle)
    simulated = low
    return {
        "proved": proved,
        "promised": promised,
        "linear": linear,
        "simulated": simulated,
        "seconds": seconds,
    }


def _rests(law: ContactLaw, device: Any, box: dict[str, tuple[float, float]]) -> bool:
    random = np.random.default_rng(SEED)
    corners = SampledPlantBox(device, box).corners()
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
    """What is known of a design at a wall."""
    problem = avc.load_problem(wall)
    found = design(problem, name)
    if found.gains is None:
        return {"reason": found.reason}
    if isinstance(found.in_force, Gains):
        gains = found.gains
        if gains.rigid:  # a coupling has finite gains: a spring that is nearly rigid
            gains = Gains(0.0, near_rigid_n_per_m(problem.device), gains.contact_damping_ns_per_m)
        return _known(Coupling.constant(problem, gains, name))
    return _known(Coupling.of(problem, found.in_force))


def reference_cell(name: str) -> dict[str, Any]:
    """What is known of the recommended coupling of a reference device."""
    coupling = avc.recommend(avc.load_problem(name)).coupling
    if coupling is None:
        return {"reason": "nothing could be recommended"}
    return _known(coupling) | {"wall": coupling.wall.stiffness_n_per_m, "method": coupling.method}


def _known(coupling: Coupling) -> dict[str, Any]:
    level = avc.certify(coupling.problem, coupling, prove=True).levels["L7"]
    return {
        "rows": len(coupling.table),
        "outcome": level.outcome,
        "claim": level.claim,
        "rows_proved": int(level.row_passed.sum()),
    }


TEXT = """# Rest: proved, refuted, open

A proof is of the law that is clipped last, for every hand of the box, every resting target and every initial state,
without friction: one multiplier of Zames and Falb, verified by enclosures. Refuted: a hand with which the loop is
unstable in contact.

## The stiffest walls

{walls_made_by}

Figure 5's device (0.1 kg, 2 N.s/m), rigid coupling, wall without damper, best of 12 contact dampers (set B: 6) from 0.6
to 3 K T. **Proved**: for the whole box, 0 where verification gave up. **Promised**: a multiplier serves the corners of
the box, which is no proof. **Linear**: stable in contact with the corners and 24 draws. **Simulated**: the corners and
40 draws, each from a random state to a random target, at rest in a simulator of its own, with the best of 6 dampers
(bisection, to about 1%). s: processor time of both searches and of all verifications that they asked for, the failed
ones among them. Set A: 0.05 to 0.3 kg, 3 to 20 N.s/m, 200 to 800 N/m. Set B: hands on a stylus, five numbers.

{walls}

## Designs

ve2 to ve7: {designs_made_by}

Reference devices: {references_made_by}

What `avc certify --prove` says of rest (L7). Figures in brackets: rows that are proved, of all of the thinned table
that runs.

{designs}

{said}
"""
NOT_YET = "Not computed yet."


def of_area(out: Path, area: str) -> Path:
    return out.with_name(f"{out.stem}_{area}.json")


def write_page(out: Path) -> None:
    files = {area: of_area(out, area) for area in AREAS}
    found = {area: json.loads(file.read_text(encoding="utf-8")) for area, file in files.items() if file.exists()}
    cells = {name: cell for document in found.values() for name, cell in document["cells"].items()}

    def of(kind: str) -> list[tuple[list[str], dict[str, Any]]]:
        return [(name.split(" | ")[1:], cell) for name, cell in cells.items() if name.startswith(f"{kind} | ")]

    def outcome(cell: dict[str, Any]) -> str:
        rows = f" ({cell['rows_proved']} of {cell['rows']})" if cell.get("rows", 1) > 1 else ""
        return cell.get("outcome", cell.get("reason", cell.get("error", "-"))) + rows

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
        ("problem", "design", "L7"),
        (
            (
                key[0],
                key[1] if len(key) > 1 else cell.get("method", "-"),
                outcome(cell),
            )
            for key, cell in designed
        ),
    )
    said = "\n".join(
        f"- {', '.join(key)}: {cell['claim']}" for key, cell in designed if cell.get("outcome", "proved") != "proved"
    )
    PAGE.write_text(
        TEXT.format(
            **{f"{area}_made_by": made_by(found[area]["about"]) if area in found else NOT_YET for area in AREAS},
            walls=walls,
            designs=designs,
            said=f"What is refuted or open, and why:\n\n{said}" if said else "",
        ),
        encoding="utf-8",
    )


def main() -> None:
    args = script_arguments(__doc__, out=OUT, only=AREAS)
    areas: dict[str, dict[str, Any]] = {
        "walls": {
            f"wall | {1e3 * time_s:g} | {delay} | {population}": partial(wall_cell, time_s, delay, population)
            for population in ("A", "B")
            for time_s in (1e-3, 2.5e-4)
            for delay in (0, 1, 2)
        },
        "references": {
            f"reference | {name}": partial(reference_cell, name)
            for name in ("reference-r1", "reference-r2", "reference-r3")
        },
        "designs": {
            f"design | {wall} | {name}": partial(design_cell, wall, name) for name in DESIGNS for wall in WALLS
        },
    }
    for area, cells in areas.items():
        if args.only in (None, area):
            made = about(f"python tests/benchmarks/proofs_of_rest.py --only {area}", SEED)
            computed(cells, of_area(args.out, area), made, lambda _: write_page(args.out))


if __name__ == "__main__":
    main()
