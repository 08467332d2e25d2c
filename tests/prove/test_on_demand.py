"""Level L7 is there when it is asked for, says proved, refuted or open, and why a loop is open."""

import functools

import numpy as np
import pytest
from boxes_of_hands import brute_force
from hardware_bench import believer

import avc_casadi as avc
from avc_casadi.claims.certify import admits_quick_proof, certify
from avc_casadi.claims.prove.held_device import HAND
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.rest import Rest, prove_rest
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime

SOFT = Gains(20.0, 8e3, 0.0)
STIFF = Gains(287.4, 2.913e6, 84.82)


def coupling_of(gains=SOFT, contact="clip-last", runtime=None, problem="figure5", **changes):
    changes["coupling"] = {"contact": contact, "structure": "damped", "contact_damping_ns_per_m": (0.0, 1e3)}
    return Coupling.constant(avc.load_problem(problem).changed(**changes), gains, "by hand", runtime)


@functools.cache
def outcome(coupling):
    return certify(coupling.problem, coupling, prove=True).levels["L7"]


@pytest.mark.slow
def test_the_same_gains_are_proved_clipped_last_and_open_behind_the_gate():
    clipped, gated = outcome(coupling_of(STIFF)), outcome(coupling_of(STIFF, "gated"))
    assert (clipped.outcome, clipped.passed, clipped.word) == ("proved", True, "proved")
    assert (gated.outcome, gated.passed) == ("open", False)
    assert 'contact = "gated"' in gated.claim


@pytest.mark.slow
def test_a_loop_that_is_unstable_in_contact_is_refuted_by_its_hand():
    coupling = coupling_of(Gains(0.0, 1e6))
    found = outcome(coupling)
    assert found.outcome == "refuted"
    document = found.detail.proofs[0]
    assert document["unstable"]["spectral_radius"] > 1
    assert certify(coupling.problem, coupling).levels["L5"].passed is False


def test_an_observer_is_proved_without_its_dead_zone_and_open_with_it():
    observer = believer(0)
    runtime = Runtime(state_feedback=observer)
    coupling = coupling_of(Gains(0.0, 1e8), runtime=runtime, environment={"stiffness_n_per_m": 2e3})
    plain = type(observer)(**{**vars(observer), "dead_zone_m": 0.0})
    zone = type(observer)(**{**vars(observer), "dead_zone_m": 1e-5})
    box = {name: getattr(coupling.problem.hands, name) for name in HAND}
    found = {}
    for name, law in (("plain", plain), ("zone", zone)):
        whole = ContactLaw.of(coupling.problem, 0.0, 1e8, 0.0, law)
        found[name] = prove_rest(whole, "clip-last", coupling.problem.device, box)
    assert "dead zone of 10.0 um" in found["zone"].sentence
    assert found["zone"].outcome == "open"
    assert (found["plain"].outcome == "proved") == (found["zone"].multiplier is not None)


@pytest.mark.slow
@pytest.mark.parametrize("device", [{"backlash_m": 1e-4}, {"range": {"backlash_m": (0.0, 1e-5)}}])
def test_nothing_is_proved_of_a_device_with_play(device):
    """Play is a hysteresis in the loop: what comes to rest without it may bounce for ever with it."""
    sure, coupling = coupling_of(), coupling_of(device=device)
    assert outcome(sure).outcome == "proved"
    level = outcome(coupling)
    assert level.outcome == "open"
    assert "play of" in level.claim
    assert admits_quick_proof(sure)
    assert not admits_quick_proof(coupling)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("device", "b_p", "wall", "word"),
    [
        ({"amplifier_bandwidth_hz": 700.0}, 6.0, 4e3, "proved"),
        ({"resonance": {"frequency_hz": 200.0, "damping_ratio": 0.1, "mass_ratio": 0.4}}, 6.0, 4e3, "proved"),
        ({"amplifier_bandwidth_hz": 700.0}, 0.0, 2e5, "refuted"),
    ],
)
def test_what_is_said_of_a_device_that_is_not_rigid_agrees_with_brute_force(device, b_p, wall, word):
    """Beside it the spectral radius of the whole loop over a lattice of hands."""
    hands = {"mass_kg": [0.1, 0.12], "damping_ns_per_m": [6.0, 8.0], "stiffness_n_per_m": [300.0, 400.0]}
    coupling = coupling_of(Gains(0.0, 1e8, b_p), device=device, environment={"stiffness_n_per_m": wall}, hands=hands)
    found = outcome(coupling)
    assert found.outcome == word, found.claim
    radius = brute_force(coupling.problem, np.array([0.0]), np.array([1e8]), np.array([b_p]), 5)[0]
    assert (radius < 1) == (word == "proved")
    assert word == "refuted" or Rest.from_document(found.detail.proofs[0]).verify()
