"""A recommendation says of rest with every hand: proved, refuted, open or simulated."""

import json

import pytest

import avc_casadi as avc
from avc_casadi.claims.deployable import certified
from avc_casadi.claims.prove.rest import Rest
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.model.runtime import Runtime
from avc_casadi.recommendation.limit_cycle_freedom import likely_provable, with_rest

WALL = 8.9e4


def coupling_of(gains, runtime=None, contact="clip-last", wall=WALL, device=()):
    problem = avc.load_problem("figure5").changed(
        environment={"stiffness_n_per_m": wall}, device=dict(device), coupling={"contact": contact}
    )
    return Coupling.constant(problem, gains, "by hand", runtime)


# Too little damping to be proved before this wall, and enough to be stable.
LEAN = Gains(0.0, 1e8, 55.0)
PROVED = Gains(0.0, 1e8, 84.0)


def known(coupling):
    return with_rest(certified(coupling))


@pytest.mark.thorough
def test_the_recommended_coupling_carries_its_proof():
    found = avc.recommend("spring", hands=10)
    document = json.loads(json.dumps(found.data(), allow_nan=False))
    assert document["rest"]["word"] == "proved"
    level = document["certificate"]["levels"]["L7"]
    assert (level["outcome"], level["claim"]) == ("proved", document["rest"]["sentence"])
    assert Rest.from_document(level["proofs"][0]).verified()


def test_an_open_one_says_why():
    coupling, rest = known(coupling_of(LEAN))
    assert rest.word == "open"
    assert "no multiplier" in rest.sentence
    assert coupling.certificate["levels"]["L7"]["outcome"] == "open"


def test_an_unstable_one_is_refuted():
    _, rest = known(coupling_of(Gains(0.0, 1e8, 500.0)))
    assert rest.word == "refuted"
    assert "spectral radius" in rest.sentence


def test_of_equals_those_with_a_proof_in_sight_come_first():
    class Judged:
        def __init__(self, coupling):
            self.coupling = coupling

    sure, unsure = Judged(coupling_of(PROVED)), Judged(coupling_of(LEAN))
    beside = Judged(coupling_of(PROVED, Runtime(observer_mass_kg=0.16)))
    assert likely_provable([unsure, sure, beside]) == [sure]
    assert likely_provable([unsure, beside]) == [unsure, beside]
    assert likely_provable([beside]) == [beside]
