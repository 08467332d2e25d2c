"""Random loops, each proved, refuted or open (L7, L5, L8), and whatever speaks against what is said of them.

nice -n 10 python tests/benchmarks/proof_contradictions.py [PEOPLE] [OUT]

PEOPLE loops are drawn (default 10000): device, wall, b, k, b_p, delay of 0 to 2 samples, sample time, box of hands.
What is proved is simulated in the project's scene and in a simulator that shares no code with it; witnesses of what is
refuted are replayed. Overwrites OUT (default tests/benchmarks/results/proof_contradictions.json) and
RESULTS_proof_contradictions.md beside this file after every 25; what OUT holds already is not computed again.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections import Counter
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from script_arguments import script_arguments
from studied import about, computed, made_by, table

sys.path.insert(0, str(Path(__file__).parent.parent))
from clip_last_simulator import Simulator
from drawn_loops import DrawnLoop, contradiction, drawn_loop

import avc_casadi as avc
from avc_casadi.claims.prove.changing import prove_changes
from avc_casadi.claims.prove.hands import prove_hands
from avc_casadi.claims.prove.held_device import HAND
from avc_casadi.claims.prove.switching import SwitchingLoop
from avc_casadi.claims.stability.declared_device import whole_stability
from avc_casadi.claims.stability.frozen_loop import frozen_parts
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand

HERE = Path(__file__).parent
OUT = HERE / "results" / "proof_contradictions.json"
PAGE = HERE / "RESULTS_proof_contradictions.md"
SEED = 14
COUNT, A_CELL = 10_000, 25
SCENE_HANDS, MOST_SAMPLES = 12, 60_000
# Cells of hands for L8, which is asked of every so manieth loop.
CELLS_OF_CHANGES, CHANGES_EVERY = 8, 5
JUMPS = 3000


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
    held = SwitchingLoop.of(law, "clip-last", loop.device, Hand(*hands.T), np.zeros(len(hands))).contact_radius()
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


def against_hands(loop: DrawnLoop) -> tuple[str, str]:
    """L5: outcome, and what speaks against it: a lattice of hands, a witness that does not replay, L7."""
    law = loop.law
    problem = problem_of(loop, {"kind": "hold", "end_m": 0.0}, 2000)
    gains = law.damping_ns_per_m, law.stiffness_n_per_m, law.contact_damping_ns_per_m
    (proof,) = prove_hands(problem, *(np.array([gain]) for gain in gains))
    if proof.outcome != "open" and not proof.replays():
        return proof.outcome, f"L5 {proof.outcome} does not replay"
    if proof.outcome == "proved":
        axes = [np.linspace(low, high, 5) for low, high in loop.box.values()]
        hands = Hand(*np.array(list(itertools.product(*axes))).T)
        parts = frozen_parts(problem, *(np.array([gain]) for gain in gains[:2]))
        radius = whole_stability(loop.device, parts, np.array([gains[2]]), hands).radius.max()
        if radius >= 1:
            return proof.outcome, f"L5 proved, but a hand of the lattice has a spectral radius of {radius}"
        if loop.proof.unstable is not None:
            return proof.outcome, "L5 proved, but L7 knows an unstable hand"
    if proof.outcome == "refuted" and loop.proof.outcome == "proved":
        return proof.outcome, "L5 refuted, but L7 proved"
    return proof.outcome, ""


def against_changes(loop: DrawnLoop, random: np.random.Generator) -> tuple[str, str]:
    """L8 of this row and one beside it: outcome, and what speaks against it: random jumps, patterns that die out."""
    law = loop.law
    problem = problem_of(loop, {"kind": "hold", "end_m": 0.0}, 2000)
    row = [law.damping_ns_per_m, law.stiffness_n_per_m, law.contact_damping_ns_per_m]
    # Another spring would have another place of rest; the dampers differ.
    spread = np.exp(random.uniform(-0.3, 0.3, 3)) ** [1, 0, 1]
    rows = np.array([row, [value * share for value, share in zip(row, spread, strict=True)]]).T
    proof = prove_changes(problem, rows, most_cells=CELLS_OF_CHANGES)
    if proof.outcome != "open" and not proof.replays(problem):
        return proof.outcome, f"L8 {proof.outcome} does not replay"
    if proof.outcome == "proved" and not _jumps_decay(loop, rows, random):
        return proof.outcome, "L8 proved, but random jumps do not decay"
    return proof.outcome, ""


def _jumps_decay(loop: DrawnLoop, rows: np.ndarray, random: np.random.Generator) -> bool:
    """Far in the wall, gains that jump at random leave corners of the hands at rest."""
    law, ends = loop.law, np.array(list(loop.box.values()))
    hands = dict(zip(HAND, np.array(list(itertools.product(*ends))).T, strict=True))
    wall, depth = law.wall_stiffness_n_per_m, 0.05
    gains = {"b_e": law.wall_damping_ns_per_m, "k_e": wall}
    stiffness = np.full(8, law.stiffness_at_rest_n_per_m)
    target = depth * (1 + stiffness / hands["stiffness_n_per_m"])
    simulator = Simulator(loop.device.model_dump() | {"max_force_n": None}, gains, hands, target)
    start = np.repeat((stiffness * depth)[:, None], int(loop.device.delay_samples) + 2, axis=1)
    speed = random.normal(0, 1e-3, 8)
    simulator.start(np.full(8, depth), speed, tool=stiffness * depth / wall, under_way=start)
    sizes = []
    for _ in range(JUMPS):
        gains["b"], gains["k"], gains["b_p"] = rows[:, int(random.integers(2))]
        sizes.append(np.abs(simulator.step()[1]))
    last, first = np.max(sizes[-300:], axis=0), np.max(sizes[:300], axis=0)
    return bool((last <= first).all())


def loops_cell(first: int, count: int) -> dict[str, Any]:
    """Random loops by outcome, and contradictions."""
    outcomes: dict[str, Counter[str]] = {level: Counter() for level in ("L7", "L5", "L8")}
    witnesses: Counter[str] = Counter()
    against: list[str] = []
    seconds: Counter[str] = Counter()
    slow = 0
    for seed in range(first, first + count):
        random = np.random.default_rng([SEED, 7, seed])
        began = time.process_time()
        loop = drawn_loop(seed)
        seconds["L7"] += time.process_time() - began
        outcomes["L7"][loop.proof.outcome] += 1
        witnesses["unstable hand"] += loop.proof.unstable is not None
        witnesses["orbit"] += loop.proof.orbit is not None
        faults = [contradiction(loop, seed)]
        if loop.proof.outcome == "refuted" and loop.proof.unstable is None and loop.proof.orbit is None:
            faults.append("refuted without a witness")
        if loop.proof.outcome == "proved":
            began = time.process_time()
            scene = against_scene(loop, random)
            seconds["scene"] += time.process_time() - began
            slow += scene is None
            faults.append(scene or "")
        rigid = loop.device.resonance is None and loop.device.amplifier_bandwidth_hz is None
        if rigid:
            began = time.process_time()
            outcome, fault = against_hands(loop)
            seconds["L5"] += time.process_time() - began
            outcomes["L5"][outcome] += 1
            faults.append(fault)
            if seed % CHANGES_EVERY == 0 and loop.device.delay_samples == int(loop.device.delay_samples):
                began = time.process_time()
                outcome, fault = against_changes(loop, random)
                seconds["L8"] += time.process_time() - began
                outcomes["L8"][outcome] += 1
                faults.append(fault)
        against += [f"loop {seed}: {fault}" for fault in faults if fault]
    return {
        "outcomes": {level: dict(found) for level, found in outcomes.items()},
        "witnesses": dict(witnesses),
        "too_slow": slow,
        "seconds": dict(seconds),
        "contradictions": against,
    }


TEXT = """# What speaks against proofs

{made_by}

{loops} random loops: rigid, resonant and with an amplifier, delays of 0 to 2 samples whole and not, sample times of
0.25 to 2 ms, boxes of hands of random size, gains about the edge of what is stable. **L7** (all of them): what is
proved is run in the project's scene (every corner of the hands and four draws press, or start off their target, until
ten decay times of the slowest have passed, with and without contact; {slow} that would take more than {most} samples
are not run there) and in a simulator that shares no code with it (corners and draws, from random states and memories,
with and without a force limit). Of what is refuted, hands are driven away from rest there, and orbits replayed. **L5**
(rigid ones): against a lattice of 125 hands and against L7; cells and witnesses replay. **L8** (every fifth, whole
delay, with a second row whose dampers lie within a third): random jumps decay in that simulator, patterns grow; at most
{cells} cells.

{counts}

Of the refuted, {witnesses}. **Contradictions: {contradictions}.**
"""


def write_page(document: dict[str, Any]) -> None:
    outcomes: dict[str, Counter[str]] = {level: Counter() for level in ("L7", "L5", "L8")}
    witnesses: Counter[str] = Counter()
    seconds: Counter[str] = Counter()
    against: list[str] = []
    slow = 0
    for name, cell in document["cells"].items():
        if "error" in cell:
            against.append(f"{name}: {cell['error']}")
            continue
        for level, found in cell["outcomes"].items():
            outcomes[level].update(found)
        witnesses.update(cell["witnesses"])
        seconds.update(cell["seconds"])
        slow += cell["too_slow"]
        against += cell["contradictions"]
    words = ("proved", "refuted", "open")
    counts = table(
        ("level", "loops", *words, "s a loop, mean"),
        (
            (
                level,
                found.total(),
                *(found[word] for word in words),
                f"{seconds[level] / max(1, found.total()):.2f}",
            )
            for level, found in outcomes.items()
        ),
    )
    PAGE.write_text(
        TEXT.format(
            made_by=made_by(document["about"]),
            loops=outcomes["L7"].total(),
            cells=CELLS_OF_CHANGES,
            slow=slow,
            most=MOST_SAMPLES,
            counts=counts,
            witnesses=", ".join(f"{count} by {what}" for what, count in witnesses.items()) or "none",
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
