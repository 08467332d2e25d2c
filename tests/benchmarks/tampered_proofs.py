"""Stored proofs that were tampered with: what an independent checker rejects, and whether what it believes is true.

python tests/benchmarks/tampered_proofs.py [PEOPLE] [OUT]

PEOPLE objects (default 1000) are drawn from proofs near what can be proved, with one thing
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
from tampered_proofs import REST, accepted, proved_anew, replayed, stored_rest, tampered

HERE = Path(__file__).parent
OUT = HERE / "results" / "tampered_proofs.json"
PAGE = HERE / "RESULTS_tampered_proofs.md"
SEED = 14
COUNT, A_CELL = 1000, 100
WORDS = {
    "rejected": "rejected",
    "too strict": "rejected, though the project replays it",
    "still a proof": "accepted, the project replays it",
    "still true": "accepted, the project proves the claim anew",
    "contradiction": "accepted, and the claim is not proved",
}


@cache
def proofs() -> list[dict[str, Any]]:
    found = [stored_rest(case) for case in REST]
    assert all(map(accepted, found))
    return found


def tampered_cell(first: int, count: int) -> dict[str, Any]:
    """Deeds by what became of them."""
    became: Counter[str] = Counter()
    for number in range(first, first + count):
        random = np.random.default_rng([SEED, 1, number])
        objects = proofs()
        deed, changed = tampered(objects[number % len(objects)], random)
        became[f"{deed} | {_fate(changed)}"] += 1
    return {"became": dict(became)}


def _fate(changed: dict[str, Any]) -> str:
    believed = accepted(changed, points=2)
    again = replayed(changed)
    if not believed:
        return "too strict" if again else "rejected"
    if again:
        return "still a proof"
    return "still true" if proved_anew(changed) else "contradiction"


TEXT = """# Proofs that were tampered with

{made_by}

Proofs near what can be proved ({sources}), stored as `avc certify --prove --proof-out` does, with one
thing changed: multiplier, gains, wall, delay, sample time, hands. A checker that shares no code with the prover judges
them (tests/rest_proof_checker.py) at every frequency with the corners of the hands, in 80 digits. **Rejected** is what
it does not believe. Some changes leave a proof a proof, as more damping may: these have to be accepted, and then the
project replays them too, or proves from nothing what they claim. **Contradictions: {contradictions}.**

{counts}

## What was done

{deeds}
"""


def write_page(document: dict[str, Any]) -> None:
    found: Counter[tuple[str, str]] = Counter()
    against: list[str] = []
    for name, cell in document["cells"].items():
        if "error" in cell:
            against.append(f"{name}: {cell['error']}")
        for what, count in cell.get("became", {}).items():
            deed, fate = what.split(" | ")
            found[deed, fate] += count
            if fate == "contradiction":
                against.append(deed)
    fates = [sum(count for (_, fate), count in found.items() if fate == word) for word in WORDS]
    counts = table(("tampered", *WORDS.values()), [(sum(found.values()), *fates)])
    deeds = table(
        ("what was done", *WORDS),
        ((deed, *(found[deed, word] for word in WORDS)) for deed in sorted({deed for deed, _ in found})),
    )
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            sources=", ".join(REST),
            contradictions="0" if not against else f"{len(against)}: {'; '.join(against)}",
            counts=counts,
            deeds=deeds,
        ),
        encoding="utf-8",
    )


def main() -> None:
    args = script_arguments(__doc__, people=COUNT, out=OUT)
    cells = {
        str(first): partial(tampered_cell, first, min(A_CELL, args.people - first))
        for first in range(0, args.people, A_CELL)
    }
    computed(cells, args.out, about("python tests/benchmarks/tampered_proofs.py", SEED), write_page)


if __name__ == "__main__":
    main()
