"""Random loops, each proved, refuted or open (L7), and whatever speaks against what is said of them.

nice -n 10 python tests/benchmarks/proof_contradictions.py [PEOPLE] [OUT]

PEOPLE loops are drawn (default 10000): device, wall, b, k, b_p, delay of 0 to 2 samples, sample time, box of hands.
What is proved is simulated in the project's scene and in a simulator that shares no code with it; witnesses of what is
refuted are replayed. Overwrites OUT (default tests/benchmarks/results/proof_contradictions.json) and
RESULTS_proof_contradictions.md beside this file after every 25; what OUT holds already is not computed again.
"""

from __future__ import annotations

import itertools
import sys
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from drawn_loops import DrawnLoop, contradiction, drawn_loop

import avc_casadi as avc
from avc_casadi.claims.prove.rest import contact_radius
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand

HERE = Path(__file__).parent
OUT = HERE / "results" / "proof_contradictions.json"
PAGE = HERE / "RESULTS_proof_contradictions.md"
SEED = 14
COUNT, A_CELL = 10_000, 25
SCENE_HANDS, MOST_SAMPLES = 12, 60_000


def problem_of(loop: DrawnLoop, motion: dict[str, Any], samples: int) -> avc.Problem:
    """The loop as a problem of the project, with a scene of what the loop has and nothing else."""
    device, law = loop.device, loop.law
    kinds = [
        "hand",
        "wall",
        *(["delay"] if device.delay_samples else []),
        *(["amplifier"] if device.amplifier_bandwidth_hz else []),
        *(["resonance"] if device.resonance else []),
    ]
    return avc.load_problem("figure5").changed(
        device=device.model_dump(),
        environment={"damping_ns_per_m": law.wall_damping_ns_per_m, "stiffness_n_per_m": law.wall_stiffness_n_per_m},
        hands={name: list(ends) for name, ends in loop.box.items()},
        coupling={"contact": "clip-last", "structure": "damped", "contact_damping_ns_per_m": (0.0, 1e9)},
        frequency={"start_hz": 1.0, "stop_hz": 10.0, "points": 2},
        scene={
            "effects": tuple({"kind": kind} for kind in kinds),
            "duration_s": samples * device.sample_time_s,
            "motion": motion,
        },
    )


def against_scene(loop: DrawnLoop, random: np.random.Generator) -> str | None:
    """Corners and draws of the hands press, or are let go off their target, in the project's own scene.

    Returns:
        What speaks against the proof, empty where nothing does; None where ten decay times take too many samples.
    """
    law, t = loop.law, loop.law.sample_time_s
    ends = np.array(list(loop.box.values()))
    hands = random.uniform(ends[:, 0], ends[:, 1], (SCENE_HANDS, 3))
    hands[:8] = list(itertools.product(*ends))
    # Free of the wall, a hand decays by its own damping: ten of its times, and two seconds.
    slowest = 2 * (loop.device.mass_kg + hands[:, 0]) / (loop.device.damping_ns_per_m + hands[:, 1])
    stretched = (loop.device.damping_ns_per_m + hands[:, 1]) / hands[:, 2]
    # Delay takes damping away in contact: there the slowest mode tells.
    held = contact_radius(law, loop.device, Hand(*hands.T))
    decay = max(slowest.max() / t, stretched.max() / t, float(-1 / np.log(held.max())))
    if 2.0 / t + 10 * decay > MOST_SAMPLES:
        return None
    samples = round(2.0 / t + 10 * decay)
    kind = str(random.choice(["press", "hold"]))
    motion = {"kind": kind, "start_m": -0.01, "end_m": float(random.choice([3e-4, 3e-3, 0.03]))}
    motion |= {} if kind == "hold" else {"speed_m_per_s": float(random.choice([0.05, 0.2, 0.8]))}
    gains = Gains(law.damping_ns_per_m, law.stiffness_n_per_m, law.contact_damping_ns_per_m)
    problem = problem_of(loop, motion, samples)
    found = avc.simulate_batch(problem, Hand(*hands.T), gains)
    if found.stable.all():
        return ""
    return f"in the scene hand {hands[int(np.argmin(found.stable))].tolist()} does not settle ({kind})"


def loops_cell(first: int, count: int) -> dict[str, Any]:
    """Random loops by outcome, and contradictions."""
    outcomes: Counter[str] = Counter()
    against: list[str] = []
    slow = 0
    for seed in range(first, first + count):
        random = np.random.default_rng([SEED, 7, seed])
        loop = drawn_loop(seed)
        outcomes[loop.proof.outcome] += 1
        faults = [contradiction(loop, seed)]
        if loop.proof.outcome == "refuted" and loop.proof.unstable is None:
            faults.append("refuted without a witness")
        if loop.proof.outcome == "proved":
            scene = against_scene(loop, random)
            slow += scene is None
            faults.append(scene or "")
        against += [f"loop {seed}: {fault}" for fault in faults if fault]
    return {"outcomes": dict(outcomes), "too_slow": slow, "contradictions": against}


TEXT = """# What speaks against proofs

{made_by}

{loops} random loops: rigid, resonant and with an amplifier, delays of 0 to 2 samples whole and not, sample times of
0.25 to 2 ms, boxes of hands of random size, gains about the edge of what is stable. What is proved is run in the
project's scene (every corner of the hands and four draws press, or start off their target, until ten decay times of the
slowest have passed, with and without contact; {slow} that would take more than {most} samples are not run there) and in
a simulator that shares no code with it (corners and draws, from random states and memories, with and without a force
limit). The unstable hands of what is refuted are driven away from rest there.

{counts}

**Contradictions: {contradictions}.**
"""


def write_page(document: dict[str, Any]) -> None:
    outcomes: Counter[str] = Counter()
    against: list[str] = []
    slow = 0
    for name, cell in document["cells"].items():
        if "error" in cell:
            against.append(f"{name}: {cell['error']}")
            continue
        outcomes.update(cell["outcomes"])
        slow += cell["too_slow"]
        against += cell["contradictions"]
    loops = outcomes.total()
    words = ("proved", "refuted", "open")
    counts = table(
        ("loops", *words),
        [(loops, *(outcomes[word] for word in words))],
    )
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            loops=loops,
            slow=slow,
            most=MOST_SAMPLES,
            counts=counts,
            contradictions="0" if not against else f"{len(against)}: {'; '.join(against)}",
        ),
        encoding="utf-8",
    )


def main() -> None:
    args = script_arguments(__doc__, people=COUNT, out=OUT)
    cells = {
        f"loops | {first}": partial(loops_cell, first, min(A_CELL, args.people - first))
        for first in range(0, args.people, A_CELL)
    }
    computed(cells, args.out, about("python tests/benchmarks/proof_contradictions.py", SEED), write_page)


if __name__ == "__main__":
    main()
