"""Solve random problems by `direct` and `exact`, which search the gain box by different means, and count faults.

    python -m tests.benchmarks.random_problems --count 10000

Eight decades of each parameter, both hold models, up to 20 samples of delay, both structures. Exit code 1 if anything
went wrong.
"""

from __future__ import annotations

import argparse
import collections
import sys
import time
import warnings

import numpy as np

from avc_casadi.coupling import GainSchedule
from avc_casadi.design import solve
from avc_casadi.problem import Problem
from tests.drawn_problems import drawn_problem

ERROR = 1e-9
DISTANCE = 1e-7


def faults(problem: Problem, direct: GainSchedule, exact: GainSchedule) -> collections.Counter[str]:
    """Count faults over the rows of one problem; tolerances are relative to |Z_h_ds| or |Z_h|, the larger."""
    radius = np.fmax(np.abs(exact.target), np.abs(exact.impedance))
    use = direct.usable & exact.usable
    excess = (direct.magnitude_error - exact.magnitude_error)[use] / radius[use]
    distance = np.abs(direct.impedance - direct.target) - np.abs(exact.impedance - exact.target)
    margin = problem.stability.margin_ns_per_m
    numbers = (direct.damping_ns_per_m, direct.stiffness_n_per_m, direct.contact_damping_ns_per_m, direct.real_part)
    return collections.Counter(
        {
            "local minima": int((excess > ERROR).sum()),
            "misses of exact": int((excess < -ERROR).sum()),
            "ties broken differently": int((np.abs(distance[use]) > DISTANCE * radius[use]).sum()),
            "false 'solved'": int((direct.real_part[direct.usable] < margin).sum()),
            "called failed": sum(status == "failed" for status in direct.status),
            "feasibility disputed": int((direct.usable != exact.usable).sum()),
            "not a number": int(sum(np.isnan(values[direct.usable]).sum() for values in numbers)),
        }
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=10_000, help="problems (default: 10000)")
    parser.add_argument("--frequencies", type=int, default=8, help="frequencies of each (default: 8)")
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    warnings.simplefilter("error")
    rng = np.random.default_rng(args.seed)
    total: collections.Counter[str] = collections.Counter()
    statuses: collections.Counter[str] = collections.Counter()
    started = time.perf_counter()
    for number in range(args.count):
        problem = drawn_problem(rng, frequencies=args.frequencies)
        direct, exact = solve(problem, "direct"), solve(problem, "exact")
        found = faults(problem, direct, exact)
        if any(found.values()):
            print(f"problem {number}: {dict(+found)}")
        total.update(found)
        statuses.update(direct.counts())
    rows = sum(statuses.values())
    print(f"{args.count} problems, {rows} frequencies, seed {args.seed}, {time.perf_counter() - started:.0f} s")
    for status, count in sorted(statuses.items()):
        print(f"  {status:<24}{count}")
    for fault, count in total.items():
        print(f"  {fault:<24}{count}")
    return 1 if any(total.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
