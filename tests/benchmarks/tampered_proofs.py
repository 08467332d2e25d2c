"""Stored proofs that were tampered with: what an independent checker rejects, and whether what it believes is true.

python tests/benchmarks/tampered_proofs.py [PEOPLE] [OUT]

PEOPLE objects of each level L5, L7 and L8 (default 1000) are drawn from proofs near what can be proved, with one thing
changed. Overwrites OUT (default tests/benchmarks/results/tampered_proofs.json) and RESULTS_tampered_proofs.md beside
this file after every hundred; what OUT holds already is not computed again.
"""

from __future__ import annotations

import sys
from collections import Counter
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from tampered_proofs import (
    CHANGES,
    CHANGES_OF_MANY_CELLS,
    HANDS,
    REST,
    accepted,
    proved_anew,
    replayed,
    stored_changes,
    stored_hands,
    stored_rest,
    tampered,
)

HERE = Path(__file__).parent
OUT = HERE / "results" / "tampered_proofs.json"
PAGE = HERE / "RESULTS_tampered_proofs.md"
SEED = 14
COUNT, A_CELL = 1000, 100
LEVELS = ("L5", "L7", "L8")
WORDS = {
    "rejected": "rejected",
    "too strict": "rejected, though the project replays it",
    "still a proof": "accepted, the project replays it",
    "still true": "accepted, the project proves the claim anew",
    "contradiction": "accepted, and the claim is not proved",
}


@cache
def proofs_of(level: str) -> list[dict[str, Any]]:
    makers = {"L5": (stored_hands, HANDS), "L7": (stored_rest, REST), "L8": (stored_changes, CHANGES)}
    make, cases = makers[level]
    found = [make(case) for case in cases]
    if level == "L8":
        found += [stored_changes(case) for case in CHANGES_OF_MANY_CELLS]
    assert all(accepted(whole) for whole in found)
    return found


def tampered_cell(level: str, first: int, count: int) -> dict[str, Any]:
    """Deeds by what became of them."""
    became: Counter[str] = Counter()
    for number in range(first, first + count):
        random = np.random.default_rng([SEED, LEVELS.index(level), number])
        objects = proofs_of(level)
        deed, changed = tampered(objects[number % len(objects)], random)
        became[f"{deed} | {_fate(changed)}"] += 1
    return {"became": dict(became)}


def _fate(changed: dict[str, Any]) -> str:
    believed = accepted(changed, points=2)
    again = replayed(changed)
    if not believed:
        return "too strict" if again and _speaks_of_its_problem(changed) else "rejected"
    if again:
        return "still a proof"
    return "still true" if proved_anew(changed) else "contradiction"


def _speaks_of_its_problem(changed: dict[str, Any]) -> bool:
    """A proof over hands replays whatever the problem beside it says; the checker compares the two."""
    if changed["level"] != "L5":
        return True
    gains, pieces, problem = changed["proof"]["gains"], changed["proof"]["pieces"], changed["problem"]
    device, wall, hands = problem["device"], problem["environment"], problem["hands"]
    piece = pieces[0]
    inside = all(
        piece["low"][side] <= own + hands[name][0] and piece["high"][side] >= own + hands[name][1]
        for side, name, own in (
            (1, "mass_kg", device["mass_kg"]),
            (2, "damping_ns_per_m", device["damping_ns_per_m"]),
            (3, "stiffness_n_per_m", 0.0),
        )
    )
    return bool(
        inside
        and gains["wall_stiffness_n_per_m"] == wall["stiffness_n_per_m"]
        and gains["sample_time_s"] == device["sample_time_s"]
        and piece["whole_delay"] + (piece["fraction"] or 0.0) == device["delay_samples"]
    )


TEXT = """# Proofs that were tampered with

{made_by}

Proofs near what can be proved ({sources}), stored as
`avc certify --prove --proof-out` does, with one thing changed: cells, cuts, half planes, multiplier, norms, gains,
wall, delay, sample time, hands. Checkers that share no code with the prover judge them
(tests/hands_proof_checker.py, rest_proof_checker.py, changes_proof_checker.py): L7 at every frequency with the corners
of the hands, in 80 digits; L5 and L8 at corners of each cell and points drawn within. **Rejected** is what they do not
believe. Some changes leave a proof a proof, as half a degree more of a half plane does: these have to be accepted, and
then the project replays them too, or proves from nothing what they claim. The checkers refuse every negative gain, the
project only those that break the loop. **Contradictions: {contradictions}.**

{counts}

## What was done

{deeds}
"""


def write_page(document: dict[str, Any]) -> None:
    by: dict[str, Counter[tuple[str, str]]] = {level: Counter() for level in LEVELS}
    against: list[str] = []
    for name, cell in document["cells"].items():
        level = name.split(" | ")[0]
        if "error" in cell:
            against.append(f"{name}: {cell['error']}")
        for what, count in cell.get("became", {}).items():
            deed, fate = what.split(" | ")
            by[level][deed, fate] += count
            if fate == "contradiction":
                against.append(f"{level}, {deed}")
    counts = table(
        ("level", "tampered", *WORDS.values()),
        (
            (
                level,
                sum(found.values()),
                *(sum(count for (_, fate), count in found.items() if fate == word) for word in WORDS),
            )
            for level, found in by.items()
        ),
    )
    deeds = table(
        ("level", "what was done", *WORDS),
        (
            (level, deed, *(found[deed, word] for word in WORDS))
            for level, found in by.items()
            for deed in sorted({deed for deed, _ in found})
        ),
    )
    sources = "; ".join(
        f"{level}: {', '.join(cases)}"
        for level, cases in (("L5", HANDS), ("L7", REST), ("L8", CHANGES | CHANGES_OF_MANY_CELLS))
    )
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            sources=sources,
            contradictions="0" if not against else f"{len(against)}: {'; '.join(against)}",
            counts=counts,
            deeds=deeds,
        ),
        encoding="utf-8",
    )


def main() -> None:
    args = script_arguments(__doc__, people=COUNT, out=OUT)
    cells = {
        f"{level} | {first}": partial(tampered_cell, level, first, min(A_CELL, args.people - first))
        for first in range(0, args.people, A_CELL)
        for level in LEVELS
    }
    computed(cells, args.out, about("python tests/benchmarks/tampered_proofs.py", SEED), write_page)


if __name__ == "__main__":
    main()
