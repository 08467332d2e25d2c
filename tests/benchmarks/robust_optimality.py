"""How near the search for a robust law comes to the best there is, on cases small enough to be searched by force.

python tests/benchmarks/robust_optimality.py [SEARCHES] [FORCE]

For a device and a wall the goal of the search is minimised three ways: as the design does it; by covariance matrix
adaptation from SEARCHES seeds with 1200 laws for each number; and by brute force that shares no code with it: FORCE
laws drawn evenly over the whole search space, the best of them polished without derivatives (Nelder and Mead). What
each law is worth to people is told beside its cost. Overwrites RESULTS_robust_optimality.md and
results/robust_optimality.json.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from studied import about, computed, cpu_seconds, made_by, rounded, table

import avc_casadi as avc
from avc_casadi.claims.stability.frozen_loop import frozen_rendering
from avc_casadi.claims.stability.state_feedback import stiffness_at_rest
from avc_casadi.coupling import Coupling
from avc_casadi.design.robust.goal import cost_of
from avc_casadi.design.robust.law import Space
from avc_casadi.design.robust.loops import Loops
from avc_casadi.design.robust.search import search
from avc_casadi.model.gains import Gains, spring_before
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.population.coupling_trial import try_coupling
from avc_casadi.simulation.population.operators import people_of

OUT = Path(__file__).parent / "results" / "robust_optimality.json"
PAGE = Path(__file__).parent / "RESULTS_robust_optimality.md"
FAILED = 1e4
# Laws of a longer search, for each number.
LAWS = 1200
# Of the best of the brute force, and evaluations of each polish.
POLISHED, POLISH = 3, 1500
# A rigid device and two with all that a device has: the knobs are 7 and 10.
CASES = {"rigid, 12 kN/m": (None, 12e3), "reference-r1, 6 kN/m": ("reference-r1", 6e3)}
RIGID = {
    "mass_kg": 0.1,
    "damping_ns_per_m": 1.0,
    "sample_time_s": 1e-3,
    "delay_samples": 1,
    "encoder_resolution_m": 20e-6,
}


def problem_of(catalogue: str | None, wall_n_per_m: float) -> avc.Problem:
    wall = {"damping_ns_per_m": 0.0, "stiffness_n_per_m": wall_n_per_m}
    problem = avc.load_problem(catalogue or "reference-r1").changed(environment=wall)
    if catalogue:
        return problem
    everything = problem.model_dump(exclude={"device"})
    return avc.Problem(**everything, device=RIGID)


def measured(catalogue: str | None, wall_n_per_m: float, searches: int, force: int) -> dict[str, Any]:
    problem = problem_of(catalogue, wall_n_per_m)
    space, loops = Space(problem.device, problem.hands), Loops.of(problem.device, problem.hands)
    gains = Gains(0.0, spring_before(problem, wall_n_per_m))
    rendering = frozen_rendering(problem, 0.0, gains.stiffness_n_per_m)
    stiffness = stiffness_at_rest(rendering)
    people = people_of(problem.hands, 200, 4711)

    def cost(point: np.ndarray) -> float:
        try:
            return cost_of(space.law(point, stiffness), rendering, loops).total
        except np.linalg.LinAlgError:
            return FAILED

    def told(point: np.ndarray, started: float, looked: int | None) -> dict[str, Any]:
        law = space.law(point, stiffness)
        trial = try_coupling(Coupling.constant(problem, gains, "robust", Runtime(state_feedback=law)), people, 4711)
        return {"cost": cost(point), "laws": looked, "cpu_s": cpu_seconds() - started} | trial.counts()

    started = cpu_seconds()
    own = search(space, loops, rendering)
    found = {"the design's search": told(own.logarithms, started, None)}
    started = cpu_seconds()
    longer = LAWS * len(space.knobs)
    others = [evolved(cost, space, seed, longer) for seed in range(1, searches + 1)]
    best = min(others, key=cost)
    found[f"{searches} longer searches, the best"] = told(best, started, longer * searches)
    started = cpu_seconds()
    point, looked = forced(cost, space, force)
    found["brute force, polished"] = told(point, started, looked)
    return {"found": found, "knobs": len(space.knobs), "spread": [cost(one) for one in others]}


def evolved(cost: Any, space: Space, seed: int, laws: int) -> np.ndarray:
    """Search without derivatives, from another place."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cma  # noqa: PLC0415
    low, high = space.bounds
    draw = np.random.default_rng(seed)
    start = np.clip(space.starts[0] + draw.normal(0, 0.7, len(low)), low, high)
    options = {
        "bounds": [low.tolist(), high.tolist()],
        "maxfevals": laws,
        "randn": lambda *shape: draw.standard_normal(shape),
        "seed": np.nan,
        "verbose": -9,
        "verb_log": 0,
    }
    return np.asarray(cma.fmin2(cost, start, 0.7, options)[1].result.xbest)


def forced(cost: Any, space: Space, force: int) -> tuple[np.ndarray, int]:
    low, high = space.bounds
    points = low + (high - low) * np.random.default_rng(99).random((force, len(low)))
    costs = np.array([cost(point) for point in points])
    best, looked = None, force
    for place in np.argsort(costs)[:POLISHED]:
        polished = minimize(
            lambda point: cost(np.clip(point, low, high)),
            points[place],
            method="Nelder-Mead",
            options={"maxfev": POLISH, "adaptive": True},
        )
        looked += polished.nfev
        if best is None or polished.fun < best.fun:
            best = polished
    return np.clip(best.x, low, high), looked


TEXT = """# How near the search for a robust law comes to the best there is

{made_by}

The goal is a sum of what a law lacks (decay, sensitivity, stiffness in motion); less is better, and no lower bound but
0 is known. At rest / without friction / quiet: of 200 hands, corners among them.

{rows}

Costs of the longer searches, each from another place: {spread}.
"""


def write_page(document: dict[str, Any]) -> None:
    rows, spreads = [], []
    for name, one in document["cells"].items():
        if "error" in one:
            rows.append([name, one["error"]] + [""] * 4)
            continue
        for how, found in one["found"].items():
            rest = f"{found['at_rest']} / {found['at_rest_without_friction']} / {found['quiet']}"
            laws = found["laws"] or "-"
            rows.append([name, how, laws, f"{found['cpu_s']:.0f}", rounded(found["cost"]), rest])
        spreads.append(f"{name} {', '.join(f'{cost:.3g}' for cost in sorted(one['spread']))}")
    head = ("case", "how", "laws", "processor time, s", "cost", "hands")
    PAGE.write_text(
        TEXT.format(made_by=made_by(document["about"]), rows=table(head, rows), spread="; ".join(spreads)),
        encoding="utf-8",
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("searches", metavar="SEARCHES", nargs="?", type=int, default=3, help="default 3")
    parser.add_argument("force", metavar="FORCE", nargs="?", type=int, default=10_000, help="default 10000")
    args = parser.parse_args()
    cells = {name: lambda case=case: measured(*case, args.searches, args.force) for name, case in CASES.items()}
    made = about(f"python tests/benchmarks/robust_optimality.py {args.searches} {args.force}", 99)
    computed(cells, OUT, made, write_page)


if __name__ == "__main__":
    main()
