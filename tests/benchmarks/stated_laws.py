"""Drawn laws of every piece on drawn devices: radii, margins and intervals compared with loops written out in time.

`nice python tests/benchmarks/stated_laws.py --count 200 --write` writes RESULTS_stated_laws.md.

The loop is that of `tests/oracle/law_in_time.py`, which shares no code with the package: SciPy's filters sample by
sample around SciPy's matrix exponential. Each drawn law has a spring, a damper and an estimator of the velocity, and
with a probability of a half each an integral, b_p and a virtual mass, and filters. Every second one has a range of
hands: there no radius of its corners and of four more hands may be larger than what is reported. 0.99 of each end of an
interval has to be stable with all of these, and 1.01 of it unstable where there is one hand.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
import time
from collections import Counter
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent / "oracle")]

from law_in_time import NOBODY, Controller, disk_margin, radius, stated, worst  # noqa: E402
from studied import about, made_by, table  # noqa: E402

import avc_casadi as avc  # noqa: E402

PAGE = HERE / "RESULTS_stated_laws.md"
HANDS, SPREAD, INSIDE = 4, 2.0, 0.01
"""Hands drawn of a range, its largest over its least value, and the share by which an end is missed."""
RADIUS, MARGIN = 1e-9, 1e-8
"""Differences of radii, and relative ones of disk margins, that count as none."""


def ranged(tables: dict[str, Any], index: int) -> tuple[dict[str, Any], list[tuple[float, float, float]]]:
    """Return the tables with a range of hands at every second index, and hands of it, corners first."""
    names = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")
    low = np.array([tables["hands"][name][0] for name in names])
    if index % 2:
        return tables, [tuple(low)]
    high = SPREAD * low
    hands = {name: [float(one), float(two)] for name, one, two in zip(names, low, high, strict=True)}
    drawn = np.random.default_rng(index).uniform(low, high, (HANDS, 3)).tolist()
    corners = list(product(*zip(low.tolist(), high.tolist(), strict=True)))
    return tables | {"hands": hands}, [*corners, *map(tuple, drawn)]


def judged(index: int) -> Counter[str]:
    """Return what of a law agrees, and what does not."""
    tables, _, walled = stated(index)
    tables, hands = ranged(tables, index)
    count: Counter[str] = Counter(laws=1)
    begun = time.process_time()
    found = avc.certify_law(tables)
    count["processor ms"] += round(1e3 * (time.process_time() - begun))
    problem, law, period = found.problem, found.problem.law, found.problem.device.sample_time_s
    assert law is not None
    controller = Controller(law, period)
    for case, held in ((found.held, hands), (found.released, [NOBODY])):
        radii = [radius(problem.device, hand, controller) for hand in held]
        count["radii"] += 1
        agree = case.spectral_radius > max(radii) - RADIUS
        agree = agree and (len(held) > 1 or case.spectral_radius < max(radii) + RADIUS)
        count["radii that differ"] += not agree
        if case.stable:
            margins = [disk_margin(problem.device, hand, controller) for hand in held[:8]]
            count["margins"] += 1
            agree = case.margins.disk < min(margins) * (1 + MARGIN)
            agree = agree and (len(held) > 1 or case.margins.disk > min(margins) * (1 - MARGIN))
            count["margins that differ"] += not agree
    one_sided = walled and law.acts_outside
    for number in law.numbers(period, problem.lightest_kg):
        interval = found.intervals[number.key]
        if interval is None or number.whole:
            continue
        for end, inward in zip(interval, (1, -1), strict=True):
            if end in (number.lowest, number.highest) or math.isinf(end):
                continue
            count["ends"] += 1
            inside, beyond = (
                max(
                    worst(problem, law.with_number(number.path, end + share * inward * abs(end)), hand, one_sided)
                    for hand in hands
                )
                for share in (INSIDE, -INSIDE)
            )
            count["ends unstable inside"] += inside >= 1
            # Of a range the worst hand may be none of those that are drawn.
            count["ends stable beyond"] += beyond <= 1 and len(hands) == 1
    return count


def main() -> None:
    """Judge the laws, and write the page on request."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    total: Counter[str] = Counter()
    refused = longest_ms = 0
    for index in itertools.count():
        try:
            law = judged(index)
            total += law
            longest_ms = max(longest_ms, law["processor ms"])
        except avc.InputError as error:  # a negative virtual mass beyond its filter
            refused += 1
            print(index, error, flush=True)
        else:
            print(index, dict(total), flush=True)
        if total["laws"] == options.count:
            break
    if not options.write:
        return
    rows = [
        ("spectral radii", total["radii"], total["radii that differ"]),
        ("disk margins", total["margins"], total["margins that differ"]),
        ("ends of intervals: unstable at 0.99", total["ends"], total["ends unstable inside"]),
        ("ends of intervals: stable at 1.01, of one hand", total["ends"], total["ends stable beyond"]),
    ]
    shown = table(("compared", "number", "that differ"), rows)
    command = f"nice python tests/benchmarks/stated_laws.py --count {options.count} --write"
    each = total["processor ms"] / options.count / 1e3
    slowest = longest_ms / 1e3
    PAGE.write_text(
        f"# Laws of every piece beside loops written out\n\n{made_by(about(command, 0))}\n\n"
        f"{options.count} drawn laws on drawn devices, half of them in a range of hands ([script](stated_laws.py)). "
        f"A radius differs by more than {RADIUS:g}, a disk margin by more than {MARGIN:g} of itself. A certificate "
        f"takes {each:.2f} s of processor time in the mean, {slowest:.1f} s at most. {refused} more laws were drawn "
        f"and refused for a negative virtual mass beyond its filter.\n\n{shown}\n",
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
