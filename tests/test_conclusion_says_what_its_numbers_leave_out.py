"""The conclusion of a recommendation says where a force begins before the wall, and whom a median leaves out."""

import copy

import pytest

import avc_casadi as avc
from avc_casadi.recommendation import conclusion_lines


@pytest.fixture(scope="module")
def document():
    return avc.recommend("soft", hands=10).document()


def lines_of(document, word):
    return [line for line in conclusion_lines(document) if line.startswith(f"{word}: ")]


@pytest.mark.parametrize(("damping", "said"), [(0.5, False), (30.0, True)])
def test_a_contact_damper_that_pushes_early_is_told(document, damping, said):
    changed = copy.deepcopy(document)
    changed["coupling"]["table"]["contact_damping_ns_per_m"] = [damping]
    changed["coupling"]["wall"] = {"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 2.0}
    found = lines_of(changed, "edge")
    assert bool(found) == said
    if said:
        assert found[0].endswith("a hand at 0.1 m/s from 1.6 mm on by 3.2 N")
    changed["coupling"]["contact"] = "gated"
    assert lines_of(changed, "edge") == []


def test_hands_at_the_force_limit_are_no_part_of_what_is_felt(document):
    changed = copy.deepcopy(document)
    assert "median of" not in lines_of(changed, "felt")[0]
    changed["trial"]["at_force_limit"] = 7
    assert "(median of the 3 hands that stay below the force limit)" in lines_of(changed, "felt")[0]


def test_a_press_with_friction_is_where_no_vibration_is_felt(document):
    (line,) = lines_of(document, "trial")
    assert "10 press without a vibration that is felt, with the declared friction" in line
