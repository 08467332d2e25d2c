"""Stored proofs of rest are accepted by a checker of its own, which rejects them once they are tampered with."""

import copy
import json
import math

import numpy as np
import pytest
from proof_checker import accepts

import avc_casadi as avc
from avc_casadi.proof import HAND, ContactLaw, Rest, prove_rest

RIGID = (math.inf, math.inf)
# Sample time, delay, b, k, b_p, b_e, k_e: near what can be proved at all.
CASES = {
    "figure5": (1e-3, 0, 287.4, 2.913e6, 84.82, 10.0, 1e5),
    "stiffest": (1e-3, 0, *RIGID, 145.0, 0.0, 1.05e5),
    "late": (1e-3, 1, *RIGID, 61.0, 0.0, 2.38e4),
    "later": (1e-3, 2, *RIGID, 35.0, 0.0, 9e3),
    "fast": (2.5e-4, 1, *RIGID, 230.0, 0.0, 3.5e5),
    "series": (1e-3, 0, 158.07, 75576.8, 0.0, 10.0, 1e5),
}


def proved(case):
    t, delay, b, k, contact, b_e, k_e = CASES[case]
    problem = avc.load_problem("figure5").changed(
        device={"sample_time_s": t, "delay_samples": delay},
        environment={"damping_ns_per_m": b_e, "stiffness_n_per_m": k_e},
    )
    law = ContactLaw.of(problem, b, k, contact)
    box = {name: getattr(problem.hands, name) for name in HAND}
    return prove_rest(law, "clip-last", problem.device, box, orbits=False)


@pytest.fixture(scope="module")
def proofs():
    return {case: proved(case) for case in CASES}


@pytest.mark.parametrize("case", CASES)
def test_it_is_proved_and_accepted(proofs, case):
    found = proofs[case]
    assert found.outcome == "proved", found.sentence
    text = json.dumps(found.document(), allow_nan=False)
    assert Rest.from_document(json.loads(text)) == found
    assert accepts(json.loads(text))


def test_a_proof_that_was_read_again_can_be_verified(proofs):
    again = Rest.from_document(json.loads(json.dumps(proofs["late"].document())))
    assert again.verified()
    weak = {lag: 0.2 * tap for lag, tap in again.multiplier.taps.items()}
    document = again.document() | {"multiplier": weak}
    assert not Rest.from_document(document).verified()


def tampered(document, random):
    """Change one thing for the worse."""
    changed = copy.deepcopy(document)
    taps, law, device, hand = (changed[key] for key in ("multiplier", "law", "device", "hand"))
    lag = str(random.choice(list(taps)))

    def grow(table, key, low, high):
        table[key] = table[key] * random.uniform(low, high)

    def faster():
        law["sample_time_s"] = device["sample_time_s"] = law["sample_time_s"] * random.uniform(1.3, 3)

    def stiffer():
        grow(law, "wall_stiffness_n_per_m", 1.3, 10)
        if law["stiffness_n_per_m"] is not None:
            grow(law, "stiffness_n_per_m", 3, 10)

    deeds = {
        "negative tap": lambda: taps.update({lag: -random.uniform(1e-6, 1)}),
        "too much": lambda: taps.update({str(random.choice([-7, 3, 9])): random.uniform(0.05, 1)}),
        "tap at lag 0": lambda: taps.update({"0": random.uniform(1e-6, 1)}),
        "weak": lambda: [grow(taps, one, 0.0, 0.7) for one in taps],
        "mirrored": lambda: changed.update(multiplier={str(-int(one)): tap for one, tap in taps.items()}),
        "stiffer wall": stiffer,
        "late": lambda: device.update(delay_samples=device["delay_samples"] + int(random.integers(1, 4))),
        "slow": faster,
        "lighter hands": lambda: (hand.update(mass_kg=[0.0, 0.3]), grow(device, "mass_kg", 0.1, 0.6)),
        "loose hands": lambda: hand.update(stiffness_n_per_m=[-random.uniform(1, 500), 800.0]),
        "turned box": lambda: hand.update(damping_ns_per_m=hand["damping_ns_per_m"][::-1]),
        "negative damper": lambda: law.update(contact_damping_ns_per_m=-random.uniform(0.1, 100)),
        "two clocks": lambda: grow(law, "sample_time_s", 1.01, 2),
        "other law": lambda: changed.update(contact="gated"),
        "other word": lambda: changed.update(outcome="open"),
    }
    deed = str(random.choice(list(deeds)))
    deeds[deed]()
    return deed, changed


def test_a_thousand_tampered_ones_are_rejected(proofs):
    random = np.random.default_rng(5)
    documents = [json.loads(json.dumps(found.document())) for found in proofs.values()]
    believed = []
    for number in range(1000):
        deed, changed = tampered(documents[number % len(documents)], random)
        if accepts(changed, hands=0):
            believed.append((number % len(documents), deed))
    assert not believed
