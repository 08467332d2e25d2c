"""Solve random problems by `direct` and `exact`, which search the gain box by different means, and count faults.

    python -m tests.benchmarks.random_problems --count 10000 --workers 2 --resume kept

Eight decades of each parameter, both hold models, up to 20 samples of delay, both structures. Exit code 1 if anything
went wrong.
"""

from __future__ import annotations

import argparse
import collections
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from avc_casadi._util.checkpoint import Chunked
from avc_casadi.design.methods import solve
from avc_casadi.model.problem import Problem
from avc_casadi.model.schedule import GainSchedule
from tests.drawn_problems import drawn_problem

ERROR = 1e-9
DISTANCE = 1e-7
# Problems that are drawn with one seed.
AT_ONCE = 100


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


def tried(task: tuple[int, int, int, int]) -> dict[str, Any]:
    """Solve some problems; drawn with a seed that is spawned for them."""
    seed, chunk, count, frequencies = task
    warnings.simplefilter("error")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(chunk,)))
    total: collections.Counter[str] = collections.Counter()
    statuses: collections.Counter[str] = collections.Counter()
    told = []
    for number in range(count):
        problem = drawn_problem(rng, frequencies=frequencies)
        direct, exact = solve(problem, "direct"), solve(problem, "exact")
        found = faults(problem, direct, exact)
        if any(found.values()):
            told.append(f"problem {chunk * AT_ONCE + number}: {dict(+found)}")
        total.update(found)
        statuses.update(direct.counts())
    return {"faults": total, "statuses": statuses, "told": told}


def study(count: int, frequencies: int, seed: int) -> Chunked[tuple[int, int, int, int], dict[str, Any]]:
    """Plan to solve so many problems, some at a time."""
    sizes = [min(AT_ONCE, count - first) for first in range(0, count, AT_ONCE)]
    return Chunked(
        about={"study": "random problems", "count": count, "frequencies": frequencies, "seed": seed},
        work=tried,
        tasks=[(seed, chunk, some, frequencies) for chunk, some in enumerate(sizes)],
        finish=joined,
        sizes=sizes,
        things="problems",
    )


def joined(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """Add up what chunks found."""
    added: dict[str, Any] = {"told": [line for part in parts for line in part["told"]]}
    for name in ("faults", "statuses"):
        total: collections.Counter[str] = collections.Counter()
        for part in parts:
            total.update(part[name])
        added[name] = dict(total)
    return added


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--count", type=int, default=10_000, help="problems (default: 10000)")
    parser.add_argument("--frequencies", type=int, default=8, help="frequencies of each (default: 8)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1, help="processes (default: 1)")
    parser.add_argument("--resume", type=Path, help="keep what is done in this folder, and go on where it stopped")
    args = parser.parse_args()
    started = time.perf_counter()
    found = study(args.count, args.frequencies, args.seed).run(workers=args.workers, folder=args.resume)
    rows = sum(found["statuses"].values())
    print("\n".join(found["told"]) or "nothing went wrong")
    print(f"{args.count} problems, {rows} frequencies, seed {args.seed}, {time.perf_counter() - started:.0f} s")
    for status, count in sorted(found["statuses"].items()):
        print(f"  {status:<24}{count}")
    for fault, count in found["faults"].items():
        print(f"  {fault:<24}{count}")
    return 1 if any(found["faults"].values()) else 0


if __name__ == "__main__":
    sys.exit(main())
