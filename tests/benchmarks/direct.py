"""`direct` against `exact` on problems drawn at random: how many gains are worse than the optimum without saying so.

python tests/benchmarks/direct.py --count 10000 --write

Each problem has three frequencies, its numbers over eight decades (`tests/oracle/drawn_problems.py`). Worse is an error
larger by more than 1e-6 of the goal, |Z_h_ds|, or of 1e-6 of |Z_h| where that is more. With --write it overwrites
results/direct.json.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
from studied import about, write_rows

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "oracle")]

from drawn_problems import drawn_problem  # noqa: E402 - found beside the tests

from avc_casadi.design.methods import solve  # noqa: E402


def main() -> None:
    """Run the study; the file is written after every hundred problems."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=7203)
    parser.add_argument("--write", action="store_true", help="overwrite results/direct.json")
    args = parser.parse_args()
    command = f"python tests/benchmarks/direct.py --count {args.count} --seed {args.seed} --write"
    made, counts = about(command, args.seed), dict.fromkeys(("problems", "solved", "failed", "worse", "infeasible"), 0)
    largest = 0.0
    for number in range(args.count):
        problem = drawn_problem(np.random.default_rng([args.seed, number]), frequencies=3)
        direct, exact = solve(problem, "direct"), solve(problem, "exact")
        failed = np.array([status == "failed" for status in direct.status])
        use, radius = direct.usable, np.fmax(np.abs(exact.target), 1e-6 * np.abs(exact.impedance))
        excess = ((direct.magnitude_error - exact.magnitude_error) / radius)[use]
        # One says that there are gains where the other says there are none.
        apart = np.count_nonzero((use != exact.usable) & ~failed)
        found = 1, use.sum(), failed.sum(), np.count_nonzero(~(excess <= 1e-6)) + apart, (~exact.usable).sum()
        counts = {key: value + int(more) for (key, value), more in zip(counts.items(), found, strict=True)}
        largest = max(largest, float(excess.max(initial=0.0)))
        if number % 100 == 99:
            row = counts | {"largest_excess": largest}
            print(row, flush=True)
            if args.write:
                write_rows(HERE / "results" / "direct.json", made, [row])


if __name__ == "__main__":
    main()
