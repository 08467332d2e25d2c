"""Stored proofs of L5, L7 and L8, near what can be proved; deeds that tamper with them; who checks them.

A stored proof is {level, problem, proof}: what `avc certify --prove --proof-out` writes of one row.
"""

from __future__ import annotations

import copy
import json
import math

import changes_proof_checker
import hands_proof_checker
import numpy as np
import rest_proof_checker

import avc_casadi as avc
from avc_casadi.claims.prove.changing import Changing, prove_changes
from avc_casadi.claims.prove.frozen_loop import FrozenGains
from avc_casadi.claims.prove.hands import HandsProof, prove_hands
from avc_casadi.claims.prove.held_device import HAND, SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, prove_rest
from avc_casadi.model.device import Device

RIGID = (math.inf, math.inf)
# Sample time, delay, b, k, b_p, b_e, k_e.
REST = {
    "figure5": (1e-3, 0, 287.4, 2.913e6, 84.82, 10.0, 1e5),
    "stiffest": (1e-3, 0, *RIGID, 145.0, 0.0, 1.05e5),
    "late": (1e-3, 1, *RIGID, 61.0, 0.0, 2.38e4),
    "later": (1e-3, 2, *RIGID, 35.0, 0.0, 9e3),
    "fast": (2.5e-4, 1, *RIGID, 230.0, 0.0, 3.5e5),
    "series": (1e-3, 0, 158.07, 75576.8, 0.0, 10.0, 1e5),
}
HANDS = {
    "figure5": (1e-3, 0, 100.0, 8.9e4, 0.0, 10.0, 1e5),
    "late": (1e-3, 1, 100.0, 1.29e4, 0.0, 10.0, 1e5),
    "part of a sample": (1e-3, 0.4, 60.0, 2e3, 2.0, 10.0, 1e5),
    "rigid": (1e-3, 0, *RIGID, 60.0, 0.0, 6e4),
}
# Rows of gains are b, k and b_p.
CHANGES = {
    "soft": (0, [[math.inf] * 3, [math.inf] * 3, [5.0, 9.0, 7.0]], 0.0, 2e3),
    "series": (1, [[1.0, 2.0], [2e3, 2e3], [1.0, 2.0]], 0.5, 500.0),
}
CHANGES_OF_MANY_CELLS = {"stiff": (0, [[math.inf] * 2, [math.inf] * 2, [95.0, 105.0]], 0.0, 1e5)}
FEW_HANDS = {"mass_kg": [0.1, 0.102], "damping_ns_per_m": [10.0, 10.4], "stiffness_n_per_m": [300.0, 330.0]}


def spoken_of(problem):
    """What a file of proofs says of a problem."""
    return {name: getattr(problem, name).model_dump(mode="json") for name in ("device", "environment", "hands")}


def stored(level, problem, proof):
    whole = {"level": level, "problem": spoken_of(problem), "proof": proof.document()}
    assert proof.outcome == "proved", proof
    return json.loads(json.dumps(whole, allow_nan=False))


def stored_rest(case):
    t, delay, b, k, contact, b_e, k_e = REST[case]
    problem = _problem(t, delay, b_e, k_e)
    law, box = ContactLaw.of(problem, b, k, contact), {name: getattr(problem.hands, name) for name in HAND}
    return stored("L7", problem, prove_rest(law, "clip-last", problem.device, box, orbits=False))


def stored_hands(case):
    t, delay, b, k, contact, b_e, k_e = HANDS[case]
    problem = _problem(t, delay, b_e, k_e)
    return stored("L5", problem, prove_hands(problem, b, k, contact)[0])


def stored_changes(case):
    delay, rows, b_e, k_e = (CHANGES | CHANGES_OF_MANY_CELLS)[case]
    problem = _problem(1e-3, delay, b_e, k_e)
    problem = problem if case in CHANGES_OF_MANY_CELLS else problem.changed(hands=FEW_HANDS)
    return stored("L8", problem, prove_changes(problem, np.array(rows)))


def _problem(t, delay, b_e, k_e):
    return avc.load_problem("figure5").changed(
        device={"sample_time_s": t, "delay_samples": delay},
        environment={"damping_ns_per_m": b_e, "stiffness_n_per_m": k_e},
    )


def accepted(whole, points=4):
    """Whether the checker of its level, which shares no code with the prover, believes a stored proof."""
    proof = whole["proof"]
    if whole["level"] == "L7":
        return rest_proof_checker.accepts(proof, hands=points)
    checker = hands_proof_checker if whole["level"] == "L5" else changes_proof_checker
    return checker.accepts(proof, whole["problem"], draws=points)


def _read_again(whole):
    """Frequencies of the problem say nothing in a proof, but a slow clock does not take all of them."""
    return avc.load_problem("figure5").changed(
        **whole["problem"], frequency={"start_hz": 1.0, "stop_hz": 10.0, "points": 2}
    )


def replayed(whole):
    """Whether the project believes it once more; a file that cannot be read is not believed."""
    try:
        if whole["level"] == "L7":
            found = Rest.from_document(whole["proof"])
            return (found.outcome, found.contact) == ("proved", "clip-last") and found.verified()
        problem = _read_again(whole)
        if whole["level"] == "L5":
            return HandsProof.from_document(whole["proof"]).replays()
        return Changing.from_document(whole["proof"]).replays(problem)
    except (avc.AvcError, ValueError, IndexError):
        return False


def proved_anew(whole):
    """Whether what a stored proof claims can be proved from nothing."""
    proof = whole["proof"]
    if whole["level"] == "L7":
        law, device = ContactLaw.from_document(proof["law"]), Device.model_validate(proof["device"])
        box = {name: tuple(ends) for name, ends in proof["hand"].items()}
        SampledPlantBox(device, box)
        return prove_rest(law, "clip-last", device, box, orbits=False).outcome == "proved"
    problem = _read_again(whole)
    if whole["level"] == "L5":
        gains = FrozenGains.from_document(proof["gains"])
        row = gains.damping_ns_per_m, gains.stiffness_n_per_m, gains.contact_damping_ns_per_m
        return prove_hands(problem, *row)[0].outcome == "proved"
    rows = np.array([[np.inf if gain is None else gain for gain in row] for row in proof["gains"]])
    return prove_changes(problem, rows, proof["order"]).outcome == "proved"


def tampered(whole, random):
    """Return what was done, and the stored proof with that one thing changed."""
    changed = copy.deepcopy(whole)
    deeds = {"L5": _deeds_of_hands, "L7": _deeds_of_rest, "L8": _deeds_of_changes}[whole["level"]](changed, random)
    deed = str(random.choice(list(deeds)))
    deeds[deed]()
    return deed, changed


def _grow(table, key, random, low, high):
    table[key] = table[key] * random.uniform(low, high)


def _deeds_of_rest(changed, random):
    proof = changed["proof"]
    taps, law, device, hand = (proof[key] for key in ("multiplier", "law", "device", "hand"))
    lag = str(random.choice(list(taps)))

    def faster():
        law["sample_time_s"] = device["sample_time_s"] = law["sample_time_s"] * random.uniform(1.05, 3)

    def stiffer():
        _grow(law, "wall_stiffness_n_per_m", random, 1.02, 10)
        if law["stiffness_n_per_m"] is not None:
            _grow(law, "stiffness_n_per_m", random, 3, 10)

    return {
        "negative tap": lambda: taps.update({lag: -random.uniform(1e-6, 1)}),
        "one tap changed": lambda: _grow(taps, lag, random, 0.5, 1.02),
        "tap added": lambda: taps.update({str(random.choice([-7, 3, 9])): random.uniform(0.001, 1)}),
        "tap at lag 0": lambda: taps.update({"0": random.uniform(1e-6, 1)}),
        "all taps weakened": lambda: [_grow(taps, one, random, 0.0, 1.0) for one in taps],
        "mirrored": lambda: proof.update(multiplier={str(-int(one)): tap for one, tap in taps.items()}),
        "stiffer wall": stiffer,
        "later": lambda: device.update(delay_samples=device["delay_samples"] + int(random.integers(1, 4))),
        "slower": faster,
        "lighter hands": lambda: (hand.update(mass_kg=[0.0, 0.3]), _grow(device, "mass_kg", random, 0.1, 1)),
        "hands that push away": lambda: hand.update(stiffness_n_per_m=[-random.uniform(1, 500), 800.0]),
        "box turned round": lambda: hand.update(damping_ns_per_m=hand["damping_ns_per_m"][::-1]),
        "negative damper": lambda: law.update(contact_damping_ns_per_m=-random.uniform(0.1, 100)),
        "more damping in contact": lambda: law.update(
            contact_damping_ns_per_m=law["contact_damping_ns_per_m"] + random.uniform(1, 200)
        ),
        "two clocks": lambda: _grow(law, "sample_time_s", random, 1.01, 2),
        "gated": lambda: proof.update(contact="gated"),
        "not said to be proved": lambda: proof.update(outcome="open"),
    }


def _deeds_of_hands(changed, random):
    proof, problem = changed["proof"], changed["problem"]
    gains, piece = proof["gains"], proof["pieces"][0]
    cells = piece["cells"]
    one = int(random.integers(len(cells["half_plane_rad"])))
    place = int(random.integers(len(cells["cuts"])))

    def turn(by):
        cells["half_plane_rad"][one] += random.choice([-1, 1]) * by

    def stiffer():
        share = random.uniform(1.01, 3)
        for table in (gains, problem["environment"]):
            table["wall_stiffness_n_per_m" if table is gains else "stiffness_n_per_m"] *= share
        if gains["stiffness_n_per_m"][0] is not None:
            gains["stiffness_n_per_m"][0] *= share

    def slower():
        share = random.uniform(1.02, 3)
        for table in (gains, problem["device"]):
            table["sample_time_s"] *= share

    def later():
        more = int(random.integers(1, 4))
        piece["whole_delay"] += more
        problem["device"]["delay_samples"] += more

    def wider():
        side = int(random.integers(1, 4))
        name = ("mass_kg", "damping_ns_per_m", "stiffness_n_per_m")[side - 1]
        ends = problem["hands"][name]
        more = random.uniform(0.01, 2) * (ends[1] - ends[0])
        piece["high"][side] += more
        ends[1] += more

    return {
        "cell left out": lambda: cells["half_plane_rad"].pop(one),
        "cut left out": lambda: cells.update(cuts=cells["cuts"][:place] + cells["cuts"][place + 1 :]),
        "other cut": lambda: cells.update(
            cuts=cells["cuts"][:place] + str(random.choice(list("0123."))) + cells["cuts"][place + 1 :]
        ),
        "half plane turned": lambda: turn(random.uniform(0.3, math.pi)),
        "half plane turned a little": lambda: turn(random.uniform(0.001, 0.3)),
        "stiffer wall": stiffer,
        "stiffer wall in the problem alone": lambda: _grow(
            problem["environment"], "stiffness_n_per_m", random, 1.01, 3
        ),
        "other damping of the coupling": lambda: (
            _grow(gains["contact_damping_ns_per_m"], 0, random, 1.2, 4)
            if gains["contact_damping_ns_per_m"][0]
            else _grow(gains["damping_ns_per_m"], 0, random, 0.2, 4)
        ),
        "negative damper": lambda: gains["contact_damping_ns_per_m"].__setitem__(0, -random.uniform(0.1, 50)),
        "later": later,
        "later in the problem alone": lambda: problem["device"].update(delay_samples=3),
        "slower": slower,
        "more hands": wider,
        "more hands in the problem alone": lambda: problem["hands"].update(mass_kg=[random.uniform(0, 0.04), 0.3]),
        "other member": lambda: piece["point"].__setitem__(0, random.uniform(0.0, 0.1)),
        "shorter circle": lambda: piece["high"].__setitem__(0, random.uniform(0.5, 3.1)),
        "not said to be proved": lambda: proof.update(outcome="open"),
    }


def _deeds_of_changes(changed, random):
    proof, problem = changed["proof"], changed["problem"]
    gains, cells = proof["gains"], proof["cells"]
    cell = cells[int(random.integers(len(cells)))]
    row = int(random.integers(len(gains[0])))
    side = int(random.integers(3))

    def stretched(share):
        cell["roots"][row] = (np.array(cell["roots"][row]) * share).tolist()

    def entry():
        roots = np.array(cell["roots"][row])
        i, j = random.integers(len(roots), size=2)
        roots[i, j] += random.choice([-1, 1]) * random.uniform(1e-3, 1) * np.abs(roots).max()
        cell["roots"][row] = roots.tolist()

    def smaller():
        cell["high"][side] -= random.uniform(0.05, 0.9) * (cell["high"][side] - cell["low"][side])

    return {
        "cell left out": lambda: cells.remove(cell),
        "cell made smaller": smaller,
        "cell turned round": lambda: cell.update(low=cell["high"], high=cell["low"]),
        "norm stretched": lambda: stretched(random.uniform(1.5, 100) ** random.choice([-1, 1])),
        "norm stretched a little": lambda: stretched(random.uniform(1.0001, 1.1) ** random.choice([-1, 1])),
        "norm with another entry": entry,
        "norm of zeros": lambda: stretched(0.0),
        "more damping in a row": lambda: gains[2].__setitem__(row, gains[2][row] + random.uniform(1, 300)),
        "negative damper": lambda: gains[2].__setitem__(row, -random.uniform(0.1, 50)),
        "stiffer wall": lambda: _grow(problem["environment"], "stiffness_n_per_m", random, 1.02, 50),
        "later": lambda: problem["device"].update(delay_samples=problem["device"]["delay_samples"] + 1),
        "slower": lambda: _grow(problem["device"], "sample_time_s", random, 1.02, 10),
        "lighter hands": lambda: problem["hands"].update(
            mass_kg=[problem["hands"]["mass_kg"][0] * random.uniform(0.2, 0.98), problem["hands"]["mass_kg"][1]]
        ),
        "looser hands": lambda: problem["hands"].update(
            stiffness_n_per_m=[random.uniform(0, 150), problem["hands"]["stiffness_n_per_m"][1]]
        ),
        "neighbours only": lambda: proof.update(order="neighbours"),
        "not said to be proved": lambda: proof.update(outcome="open"),
    }
