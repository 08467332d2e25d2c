"""Stored proofs are accepted by code that shares nothing with the prover; one changed thing and they are rejected.

A few changes leave a proof a proof: then the project replays it too, or proves what it claims anew. The study of
thousands is benchmarks/tampered_proofs.py.
"""

import dataclasses
import json

import numpy as np
import pytest
from tampered_proofs import (
    CHANGES,
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

from avc_casadi.claims.prove.hands import HandsProof
from avc_casadi.claims.prove.rest import Rest

# Deeds that leave nothing that could be a proof of anything.
NEVER = {
    "negative tap",
    "tap at lag 0",
    "hands that push away",
    "box turned round",
    "negative damper",
    "two clocks",
    "gated",
    "not said to be proved",
    "cell left out",
    "cut left out",
    "stiffer wall in the problem alone",
    "later in the problem alone",
    "more hands in the problem alone",
    "other member",
    "shorter circle",
    "cell made smaller",
    "cell turned round",
    "norm of zeros",
    "lighter hands",
}


@pytest.fixture(scope="module")
def proofs():
    found = {("L7", case): stored_rest(case) for case in REST} | {("L5", case): stored_hands(case) for case in HANDS}
    pytest.importorskip("clarabel")
    return found | {("L8", case): stored_changes(case) for case in CHANGES}


@pytest.mark.thorough
def test_they_are_accepted_and_survive_their_file(proofs):
    for (level, case), whole in proofs.items():
        assert accepted(whole, points=1), (level, case)
        assert replayed(whole), (level, case)
        again = {"L5": HandsProof, "L7": Rest}.get(level)
        if again is not None:
            assert again.from_document(whole["proof"]).document() == whole["proof"]


@pytest.mark.thorough
def test_what_was_read_again_is_verified_and_not_believed(proofs):
    document = proofs["L7", "late"]["proof"]
    assert Rest.from_document(document).verified()
    weak = {lag: 0.2 * tap for lag, tap in document["multiplier"].items()}
    assert not Rest.from_document(document | {"multiplier": weak}).verified()


@pytest.mark.thorough
def test_a_proof_over_hands_is_stored_in_a_few_kilobytes(proofs):
    sizes = {case: len(json.dumps(whole["proof"])) for (level, case), whole in proofs.items() if level == "L5"}
    assert max(sizes.values()) < 20_000, sizes


@pytest.mark.thorough
def test_tampered_ones_are_rejected_and_what_is_believed_replays(proofs):
    random = np.random.default_rng(5)
    objects = list(proofs.values())
    rejected = 0
    for number in range(156):
        deed, changed = tampered(objects[number % len(objects)], random)
        if not accepted(changed, points=1):
            rejected += 1
            continue
        assert deed not in NEVER, (changed["level"], deed)
        # Values at points may keep to a half plane that an enclosure of the whole cell does not.
        assert replayed(changed) or proved_anew(changed), (changed["level"], deed)
    assert rejected > 110


@pytest.mark.parametrize("deed", ["box turned round", "two clocks"])
def test_what_speaks_of_no_loop_is_not_verified(proofs, deed):
    found = Rest.from_document(proofs["L7", "late"]["proof"])
    if deed == "two clocks":
        changed = dataclasses.replace(found, device=found.device.model_copy(update={"sample_time_s": 2e-3}))
    else:
        low, high = found.hand["mass_kg"]
        changed = dataclasses.replace(found, hand={**found.hand, "mass_kg": (high, low)})
    assert not changed.verified()
