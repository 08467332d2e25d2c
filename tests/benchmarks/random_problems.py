"""Solve random problems by `direct`, CasADi's NLP, and by `exact`, the geometry of arcs, and count where they part.

    python -m tests.benchmarks.random_problems --count 10000 --workers 2 --resume kept

Eight decades of each parameter, both hold models, up to 20 samples of delay, both structures. Faults are what nobody is
told of; a row that `direct` calls failed is none, and is counted. Exit code 1 if there is a fault.
"""

from __future__ import annotations

import argparse
import collections
import re
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
from avc_casadi.paper.cross_check import EXCESS_TOLERANCE
from tests.drawn_problems import drawn_problem

MISSED = 1e-9
DISTANCE = 1e-6
# Problems that are drawn with one seed.
AT_ONCE = 100


def faults(problem: Problem, direct: GainSchedule, exact: GainSchedule) -> collections.Counter[str]:
    """Count faults over the rows of one problem; tolerances are relative to |Z_h_ds|."""
    radius = np.abs(exact.target)
    use = direct.usable & exact.usable
    excess = (direct.magnitude_error - exact.magnitude_error)[use] / radius[use]
    # |Z_h| may be thousands of times |Z_h_ds|: then its rounding is more than the tolerance of a miss.
    rounding = 1e-12 * (np.abs(exact.impedance) / radius)[use]
    margin = problem.stability.margin_ns_per_m
    numbers = (direct.damping_ns_per_m, direct.stiffness_n_per_m, direct.contact_damping_ns_per_m, direct.real_part)
    said = np.array([status == "failed" for status in direct.status])
    return collections.Counter(
        {
            "worse than exact without a word": int((excess > EXCESS_TOLERANCE + rounding).sum()),
            "better than exact": int((excess < -MISSED - rounding).sum()),
            "false 'solved'": int((direct.real_part[direct.usable] < margin).sum()),
            "feasibility disputed": int(((direct.usable != exact.usable) & ~said).sum()),
            "not a number": int(sum(np.isnan(values[direct.usable]).sum() for values in numbers)),
        }
    )


def tellings(direct: GainSchedule, exact: GainSchedule) -> collections.Counter[str]:
    """Count what `direct` says itself, and where two points of the same error are not equally near to Z_h_ds."""
    use = direct.usable & exact.usable
    radius = np.abs(exact.target)[use]
    same = np.abs(direct.magnitude_error - exact.magnitude_error)[use] <= MISSED * radius
    distance = (np.abs(direct.impedance - direct.target) - np.abs(exact.impedance - exact.target))[use]
    counted = r"(\d+) frequencies stopped at a local minimum"
    again = sum(int(n) for note in direct.notes for n in re.findall(counted, note))
    return collections.Counter(
        {
            "with gains": int(exact.usable.sum()),
            "failed": sum(status == "failed" for status in direct.status),
            "solved by more starts": again,
            "within 1e-9 of exact": int(same.sum()),
            "same error, farther by 1e-6": int((same & (distance > DISTANCE * radius)).sum()),
        }
    )


def tried(task: tuple[int, int, int, int]) -> dict[str, Any]:
    """Solve some problems; drawn with a seed that is spawned for them."""
    seed, chunk, count, frequencies = task
    warnings.simplefilter("error")
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(chunk,)))
    total: collections.Counter[str] = collections.Counter()
    statuses: collections.Counter[str] = collections.Counter()
    said: collections.Counter[str] = collections.Counter()
    told = []
    for number in range(count):
        problem = drawn_problem(rng, frequencies=frequencies)
        direct, exact = solve(problem, "direct"), solve(problem, "exact")
        found = faults(problem, direct, exact)
        mine = tellings(direct, exact)
        if any(found.values()) or mine["failed"]:
            told.append(f"problem {chunk * AT_ONCE + number}: {dict(+found)}, {mine['failed']} failed")
        total.update(found)
        said.update(mine)
        statuses.update(direct.counts())
    return {"faults": total, "statuses": statuses, "said": said, "told": told}


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
    for name in ("faults", "statuses", "said"):
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
    for name in ("faults", "said"):
        print(f"{name}:")
        for what, count in found[name].items():
            print(f"  {what:<34}{count}")
    return 1 if any(found["faults"].values()) else 0


if __name__ == "__main__":
    sys.exit(main())
