"""Every hand of the box: searches and proofs against brute force on random loops, and how near the limit proofs get.

nice -n 10 python tests/benchmarks/hands_over_the_box.py --loops 2000

Overwrites RESULTS_hands_over_the_box.md.
"""

from __future__ import annotations

import argparse
import itertools
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from boxes_of_hands import FIGURE5, INSIDE, brute_force, random_gains, random_problem

import avc_casadi as avc
from avc_casadi.claims.prove.hands import prove_hands
from avc_casadi.claims.stability.declared_device import whole_stability
from avc_casadi.claims.stability.frozen_loop import frozen_parts
from avc_casadi.claims.stability.worst_hand import worst_hands
from avc_casadi.model.hands import hand_corners

RESULTS = Path(__file__).parent / "RESULTS_hands_over_the_box.md"
ROWS = 10
POINTS = 11
SHARES = (0.9, 0.99, 0.999, 0.9998)


def main() -> None:
    """Run the study and write what it found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--loops", type=int, default=2000, help="random loops (default 2000)")
    loops = parser.parse_args().loops
    text = "\n".join([_head(loops), *_random(loops), "", *_limits(), "", *_designs(), ""])
    RESULTS.write_text(text, encoding="utf-8")
    print(text)


def _head(loops: int) -> str:
    return (
        "# Every hand of the box\n\n"
        f"Made by `python tests/benchmarks/hands_over_the_box.py --loops {loops}`. Times are those of one processor.\n"
    )


def _random(loops: int) -> list[str]:
    """Random loops whose stiffness lies within some percent of what a lattice of hands allows, or beyond."""
    generator = np.random.default_rng(2026)
    outcomes: Counter[str] = Counter()
    contradicted = unreplayed = beyond_search = inside = broken_inside = 0
    search = proof = 0.0
    short, cells = 0.0, []
    for _ in range(max(1, loops // ROWS)):
        problem = random_problem(generator)
        b, k, contact = random_gains(generator, ROWS)
        parts = frozen_parts(problem, b, k)
        lattice = brute_force(problem, b, k, contact, POINTS)
        corners = whole_stability(problem.device, parts, contact, hand_corners(problem.hands)).radius.max(axis=1)
        started = time.process_time()
        found = worst_hands(problem.device, parts, contact, problem.hands)
        search += time.process_time() - started
        short = max(short, float(np.max(lattice - found.radius)))
        beyond_search += int(np.count_nonzero((lattice >= 1) & (found.radius < 1)))
        inside += int(np.count_nonzero(found.radius > corners + 1e-6))
        broken_inside += int(np.count_nonzero((found.radius >= 1) & (found.known.radius.max(axis=1) < 1)))
        started = time.process_time()
        proofs = prove_hands(problem, b, k, contact)
        proof += time.process_time() - started
        for one, radius in zip(proofs, lattice, strict=True):
            outcomes[one.outcome] += 1
            contradicted += one.outcome == "proved" and radius >= 1
            unreplayed += one.outcome != "open" and not one.replays()
            cells.append(sum(len(piece.cells) for piece in one.pieces))
    total = sum(outcomes.values())
    proved = [count for count in cells if count]
    return [
        "## Random loops\n",
        f"{total} loops (half of the delays whole; walls 0.5 to 30 kN/m) against lattices of {POINTS}^3 hands.\n",
        "| | |",
        "|---|--:|",
        *(f"| {word} | {outcomes[word]} |" for word in ("proved", "refuted", "open")),
        f"| proved, but unstable with a hand of the lattice | {contradicted} |",
        f"| proofs and refutations that do not replay | {unreplayed} |",
        f"| unstable on the lattice, but not found by the search | {beyond_search} |",
        f"| largest radius of the lattice beyond that of the search | {max(short, 0.0):.1e} |",
        f"| worst hand not at a corner | {inside} |",
        f"| broken by the search alone, passed by corners and draws | {broken_inside} |",
        f"| cells of a proof, median and most | {int(np.median(proved))}, {max(proved)} |",
        f"| search, ms a row | {1e3 * search / total:.1f} |",
        f"| proof, ms a row | {1e3 * proof / total:.0f} |",
    ]


def _limits() -> list[str]:
    """How near to the stiffest spring a proof gets, on the device of figure 5, one row at a time."""
    lines = [
        "## Near the limit\n",
        "Figure 5's wall and hands, stiffness as a share of the largest that the search lets pass.\n",
        "| delay, samples | b, N.s/m | limit, kN/m | " + " | ".join(f"{100 * share:g} %" for share in SHARES) + " |",
        "|--:|--:|--:|" + "--:|" * len(SHARES),
    ]
    for delay, b in ((0, 100.0), (1, 100.0), (1.5, 30.0), (2, 30.0)):
        problem = FIGURE5.changed(device={"delay_samples": delay})
        low, high = 0.0, 1e5
        for _ in range(40):
            middle = 0.5 * (low + high)
            found = worst_hands(problem.device, frozen_parts(problem, b, middle), 0.0, problem.hands)
            low, high = (middle, high) if found.radius[0] < 1 else (low, middle)
        cells = []
        for share in SHARES:
            started = time.process_time()
            (proof,) = prove_hands(problem, b, share * low, 0.0)
            count = sum(len(piece.cells) for piece in proof.pieces)
            cells.append(f"{proof.outcome}, {count} cells, {time.process_time() - started:.2f} s")
        lines.append(f"| {delay} | {b:g} | {low / 1e3:.2f} | {' | '.join(cells)} |")
    return lines


def _designs() -> list[str]:
    """Designs with scope hands: what they take, and whether their rows hold the whole box."""
    lines = [
        "## Designs with scope hands\n",
        "Largest spectral radius over 21^3 hands, and what was proved of the rows.\n",
        "| problem | method | s | largest radius | rows |",
        "|---|---|--:|--:|---|",
    ]
    cases = (("interior worst hand", INSIDE), ("figure5, scope hands", FIGURE5.changed(stability={"scope": "hands"})))
    for (name, problem), method in itertools.product(cases, ("direct", "schedule", "static-tuned")):
        started = time.process_time()
        table = avc.solve(problem, method)
        seconds = time.process_time() - started
        gains = np.array([table.damping_ns_per_m, table.stiffness_n_per_m, table.contact_damping_ns_per_m])
        gains = np.unique(gains[:, table.usable], axis=1)
        largest = max(float(brute_force(problem, *gains[:, [i]], 21)[0]) for i in range(gains.shape[1]))
        counts = Counter(proof.outcome for proof in prove_hands(problem, *gains))
        told = ", ".join(f"{count} {word}" for word, count in counts.items())
        lines.append(f"| {name} | {method} | {seconds:.1f} | {largest:.9f} | {told} |")
    return lines


if __name__ == "__main__":
    main()
