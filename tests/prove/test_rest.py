"""Rest with hands on a stylus, five numbers each: proved over a box, confirmed elsewhere, refuted where unstable."""

import numpy as np
import pytest
import rest_proof_checker
from clip_last_simulator import Simulator, at_rest
from tampered_proofs import REST, accepted, proved_anew, replayed, stored_rest, tampered

import avc_casadi as avc
from avc_casadi.claims.prove.held_device import SampledPlantBox
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, prove_rest
from avc_casadi.model.hands import STYLUS_RANGES

PROBLEM = avc.load_problem("figure5").changed(environment={"damping_ns_per_m": 0.0})
# Half of each range, by its logarithm, about its geometric mean: a proof over all of it takes a quarter of a minute.
BOX = {
    name: tuple(float(np.sqrt(low * high) * (high / low) ** side) for side in (-1 / 4, 1 / 4))
    for name, (low, high) in STYLUS_RANGES.items()
}


def law_at(wall, share):
    return ContactLaw.of(PROBLEM.changed(environment={"stiffness_n_per_m": wall}), np.inf, np.inf, share * wall * 1e-3)


@pytest.fixture(scope="module")
def proof():
    return prove_rest(law_at(6.4e4, 1.56), "clip-last", PROBLEM.device, BOX)


@pytest.mark.slow
def test_every_stylus_hand_of_the_box_is_proved_to_rest(proof):
    assert proof.outcome == "proved"
    again = Rest.from_document(proof.document())
    assert again.verified()
    assert rest_proof_checker.accepts(proof.document(), hands=2)


def test_what_is_proved_comes_to_rest_in_a_simulator_of_its_own(proof):
    random = np.random.default_rng(5)
    drawn = np.concatenate(
        [
            SampledPlantBox(PROBLEM.device, BOX).corners(),
            random.uniform(*np.array(list(BOX.values())).T, (60, len(BOX))),
        ]
    )
    law = proof.law
    gains = {"b": np.inf, "k": np.inf, "b_p": law.contact_damping_ns_per_m, "b_e": 0.0, "k_e": 6.4e4}
    hands = dict(zip(BOX, drawn.T, strict=True))
    simulator = Simulator(PROBLEM.device.model_dump(), gains, hands, random.uniform(-0.01, 0.02, len(drawn)))
    simulator.start(random.uniform(-0.01, 0.002, len(drawn)), random.uniform(-0.3, 0.5, len(drawn)))
    assert at_rest(simulator, 3.0).all()


def test_an_unstable_hand_refutes():
    found = prove_rest(law_at(1.2e5, 1.2), "clip-last", PROBLEM.device, BOX)
    assert found.outcome == "refuted"
    assert found.unstable.spectral_radius > 1
    assert set(found.unstable.hand) == set(BOX)
    assert "grip stiffness" in found.sentence


# Stored proofs are accepted by code that shares nothing with the prover; one changed thing and they are rejected.

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
    assert Rest.from_document(document).verified()
    weak = {lag: 0.2 * tap for lag, tap in document["multiplier"].items()}
    assert not Rest.from_document(document | {"multiplier": weak}).verified()


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
