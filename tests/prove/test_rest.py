"""Stored proofs are accepted by code that shares nothing with the prover; one changed thing and they are rejected."""

import numpy as np
import pytest
from tampered_proofs import REST, accepted, proved_anew, replayed, stored_rest, tampered

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
    "lighter hands",
}


@pytest.fixture(scope="module")
def proofs():
    return {case: stored_rest(case) for case in REST}


@pytest.mark.slow
def test_they_are_accepted_and_survive_their_file(proofs):
    for case, proof in proofs.items():
        assert accepted(proof, points=1), case
        assert replayed(proof), case
        assert Rest.from_document(proof).document() == proof


@pytest.mark.slow
def test_what_was_read_again_is_verified_and_not_believed(proofs):
    document = proofs["late"]
    assert Rest.from_document(document).verify()
    weak = {lag: 0.2 * tap for lag, tap in document["multiplier"].items()}
    assert not Rest.from_document(document | {"multiplier": weak}).verify()


@pytest.mark.slow
def test_tampered_ones_are_rejected_and_what_is_believed_replays(proofs):
    random = np.random.default_rng(5)
    objects = list(proofs.values())
    rejected = 0
    for number in range(72):
        deed, changed = tampered(objects[number % len(objects)], random)
        if not accepted(changed, points=1):
            rejected += 1
            continue
        assert deed not in NEVER, deed
        assert replayed(changed) or proved_anew(changed), deed
    assert rejected > 60
