"""Stored proofs of L7, near what can be proved; deeds that tamper with them; who checks them.

A stored proof is what `avc certify --prove --proof-out` writes of one row.
"""

from __future__ import annotations

import copy
import json
import math

import rest_proof_checker

import avc_casadi as avc
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


def stored_rest(case):
    t, delay, b, k, contact, b_e, k_e = REST[case]
    problem = _problem(t, delay, b_e, k_e)
    law, box = ContactLaw.of(problem, b, k, contact), {name: getattr(problem.hands, name) for name in HAND}
    proof = prove_rest(law, "clip-last", problem.device, box)
    assert proof.outcome == "proved", proof
    return json.loads(json.dumps(proof.document(), allow_nan=False))


def _problem(t, delay, b_e, k_e):
    return avc.load_problem("figure5").changed(
        device={"sample_time_s": t, "delay_samples": delay},
        environment={"damping_ns_per_m": b_e, "stiffness_n_per_m": k_e},
    )


def accepted(proof, points=4):
    """Whether the checker, which shares no code with the prover, believes a stored proof."""
    return rest_proof_checker.accepts(proof, hands=points)


def replayed(proof):
    """Whether the project believes it once more; a file that cannot be read is not believed."""
    try:
        found = Rest.from_document(proof)
        return (found.outcome, found.contact) == ("proved", "clip-last") and found.verify()
    except (avc.AvcError, ValueError, IndexError):
        return False


def proved_anew(proof):
    """Whether what a stored proof claims can be proved from nothing."""
    law, device = ContactLaw.from_document(proof["law"]), Device.model_validate(proof["device"])
    box = {name: tuple(ends) for name, ends in proof["hand"].items()}
    SampledPlantBox(device, box)
    return prove_rest(law, "clip-last", device, box).outcome == "proved"


def tampered(proof, random):
    """Return what was done, and the stored proof with that one thing changed."""
    changed = copy.deepcopy(proof)
    deeds = _deeds(changed, random)
    deed = str(random.choice(list(deeds)))
    deeds[deed]()
    return deed, changed


def _grow(table, key, random, low, high):
    table[key] = table[key] * random.uniform(low, high)


def _deeds(proof, random):
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
