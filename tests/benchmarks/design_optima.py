"""Look for gains that better a design: drawn ones, or the paths of a lattice.

    python -m tests.benchmarks.design_optima schedule --count 300
    python -m tests.benchmarks.design_optima static --count 150       # 2 conditions each

Random devices, walls, hands, boxes, delays and ranges, half of them damped. Admissible is what the stability code
itself says, for the same hands and devices. Exit code 1 if anything was bettered without a word.
"""

from __future__ import annotations

import argparse
import collections
import sys
import time
import warnings

import numpy as np

from avc_casadi.design.constant.static import static_coupling
from avc_casadi.design.methods import solve
from tests.design_oracles import (
    drawn_device_problem,
    drawn_gains,
    drawn_schedule_problem,
    lattice_schedule_cost,
    least_error_of_constants,
    schedule_cost,
)

SCHEDULE, NO_COST = 0.01, 1e-7
"""A schedule is bettered by more than this share of its cost, unless that is nothing;"""
CONSTANT, NO_ERROR = 1e-3, 5e-4
"""constant gains by more than this share of their error, unless that is less than 0.05 %."""
STRUCTURES = ("series", "damped")
LATTICE = {("series", False): (160, 160), ("series", True): (70, 70), ("damped", False): (32, 32, 10)}
SMALLEST_LATTICE = (18, 18, 7)

Counts = collections.Counter[str]


def schedule(rng: np.random.Generator, number: int, counts: Counts) -> float:
    """`schedule` against the paths of a lattice."""
    structure = STRUCTURES[number // 3 % 2]
    problem = drawn_schedule_problem(rng, structure, number)
    started = time.process_time()
    gains = solve(problem, "schedule")
    spent = time.process_time() - started
    own = schedule_cost(problem, gains)
    lattice = LATTICE.get((structure, problem.stability.scope == "hands"), SMALLEST_LATTICE)
    best = lattice_schedule_cost(problem, lattice)
    counts["problems"] += 1
    counts["without gains at some row"] += not np.isfinite(own)
    if best < own * (1 - SCHEDULE) - NO_COST:
        counts["bettered"] += 1
        print(f"schedule {number}: {own:.6g}, lattice {best:.6g}; {problem.stability.scope}", flush=True)
    return spent


def static(rng: np.random.Generator, number: int, counts: Counts) -> float:
    """`static` and its companion against drawn gains."""
    problem = drawn_device_problem(rng, structure=STRUCTURES[number % 4 > 0], scope="pointwise", rows=30)
    spent = 0.0
    for condition in ("llewellyn", "all"):
        started = time.process_time()
        found = static_coupling(problem, condition)
        spent += time.process_time() - started
        near = np.array([found.damping_ns_per_m, found.stiffness_n_per_m, found.contact_damping_ns_per_m])
        own = found.error if found.found else np.inf
        drawn = drawn_gains(rng, problem, 20_000, near if found.found else None)
        best = least_error_of_constants(problem, condition, drawn, own)
        counts["searches"] += 1
        counts["without gains"] += not found.found
        if best < own * (1 - CONSTANT) and own > NO_ERROR:
            counts["bettered"] += 1
            print(f"static {number}, {condition}: {own:.6g}, drawn {best:.6g}", flush=True)
    return spent


def main() -> int:
    """Run one of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    whats = {"schedule": schedule, "static": static}
    parser.add_argument("what", choices=whats)
    parser.add_argument("--count", type=int, default=100, help="problems (default: 100)")
    parser.add_argument("--first", type=int, default=0, help="number of the first (default: 0)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    warnings.simplefilter("error")
    counts: Counts = collections.Counter(bettered=0)
    spent = 0.0
    for number in range(args.first, args.first + args.count):
        spent += whats[args.what](np.random.default_rng((args.seed, number)), number, counts)
    print(f"{args.what}: {args.count} problems from {args.first}, seed {args.seed}; {spent:.0f} s in the designs")
    for name, count in counts.items():
        print(f"  {name:<40}{count}")
    return 1 if counts["bettered"] else 0


if __name__ == "__main__":
    sys.exit(main())
