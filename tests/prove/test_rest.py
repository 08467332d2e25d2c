"""Rest with hands on a stylus, five numbers each: proved over a box, confirmed elsewhere, refuted where unstable."""

import numpy as np
import pytest
import rest_proof_checker
from clip_last_simulator import Simulator, at_rest

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


@pytest.mark.thorough
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
