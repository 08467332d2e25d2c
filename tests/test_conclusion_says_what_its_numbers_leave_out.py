"""The conclusion of a recommendation says where a force begins before the wall, and whom a median leaves out."""

import copy

import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.model.gains import Gains
from avc_casadi.recommendation.contact_onset import NOTICED_N, contact_onset_m
from avc_casadi.recommendation.told import conclusion_lines


@pytest.fixture(scope="module")
def document():
    return avc.recommend("soft", hands=10).document()


def lines_of(document, word):
    return [line for line in conclusion_lines(document) if line.startswith(f"{word}: ")]


@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("damping", [0.5, 30.0])
def test_a_contact_damper_that_pushes_early_is_told(damping, soft):
    """Cut at 0, k x + b v begins at -b v/k, with k of wall and coupling together."""
    problem = avc.load_problem("spring").changed(
        environment={"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 0.0}, device={"sample_time_s": 1e-4}
    )
    coupling = Coupling.constant(problem, Gains(0.0, 6000.0 if soft else 1e8, damping), "x")
    felt = 1500.0 if soft else 2000.0
    for speed, depth in contact_onset_m(coupling).items():
        # A sample late at most, and the force grows from 0 to what is noticed.
        assert depth == pytest.approx((NOTICED_N - damping * float(speed)) / felt, abs=2e-4 * float(speed) + 2e-5)


def test_the_edge_of_a_device_that_turns_is_told_in_its_own_units():
    """A wheel of 0.1 m with a contact damper, beside the same device as it is felt at the rim."""
    radius, gains = 0.1, Gains(0.0, 1e8, 30.0)
    rim = avc.load_problem("spring").changed(
        environment={"stiffness_n_per_m": 2000.0, "damping_ns_per_m": 0.0}, device={"sample_time_s": 1e-4}
    )
    turn = {"mass_kg": rim.device.mass_kg * radius**2, "damping_ns_per_m": rim.device.damping_ns_per_m * radius**2}
    wheel = rim.changed(
        environment={"stiffness_n_per_m": 2000.0 * radius**2},
        device={"motion": "rotary", "handle_radius_m": radius, **turn},
    )
    own = Gains(0.0, gains.stiffness_n_per_m * radius**2, gains.contact_damping_ns_per_m * radius**2)
    at_rim = contact_onset_m(Coupling.constant(rim, gains, "x"))
    of_turn = contact_onset_m(Coupling.constant(wheel, own, "x"))
    assert [float(speed) * radius for speed in of_turn] == pytest.approx([float(speed) for speed in at_rim])
    assert [depth * radius for depth in of_turn.values()] == pytest.approx(list(at_rim.values()), rel=1e-3)


@pytest.mark.thorough
def test_a_wall_that_begins_elsewhere_is_told(document):
    changed = copy.deepcopy(document)
    for edges, said in (({"0.1": 1e-5, "0.4": -4e-4}, False), ({"0.1": 1e-5, "0.4": -6e-4}, True), ({}, False)):
        changed["felt"]["edge_m"] = edges
        assert bool(lines_of(changed, "edge")) == said
    changed["felt"]["edge_m"] = {"0.1": 2.5e-3, "0.4": None}
    (line,) = lines_of(changed, "edge")
    assert line.startswith("edge: a hand that comes fast meets the wall's first 0.1 N elsewhere: ")
    assert line.endswith(": 2.5 mm behind its face at 0.1 m/s, not in its first 10 mm at 0.4 m/s")
    # Of a wheel of 0.1 m: half a millimetre at its rim is 5 mrad.
    changed["felt"]["edge_force_n"] = 0.01
    for depth, said in ((-4e-3, False), (-6e-3, True)):
        changed["felt"]["edge_m"] = {"1": depth}
        assert bool(lines_of(changed, "edge")) == said


@pytest.mark.thorough
def test_hands_that_move_beyond_a_proof_are_told(document):
    changed = copy.deepcopy(document)
    changed["rest"]["word"], changed["trial"]["at_rest_without_friction"] = "proved", 3
    assert lines_of(changed, "beyond the proof") == [
        "beyond the proof: with what it leaves out 7 of 10 simulated hands do not settle without dry friction"
    ]
    changed["trial"]["at_rest_without_friction"] = 10
    assert lines_of(changed, "beyond the proof") == []


@pytest.mark.thorough
def test_how_long_those_are_watched_who_still_move_is_told_where_it_is_longer_than_usual(document):
    changed = copy.deepcopy(document)
    assert "watched" not in lines_of(changed, "trial")[0]
    changed["trial"]["longest_s"] = 12.5
    assert lines_of(changed, "trial")[0].endswith("; all are watched for 12.5 s")


def test_a_loop_that_grows_beside_hands_that_rest_says_with_whom(document):
    changed = copy.deepcopy(document)
    assert changed["off_file"]["linearly_unstable"] == 0
    assert "unstable" not in lines_of(changed, "model mismatch")[0]
    changed["off_file"]["linearly_unstable"] = 4
    told = lines_of(changed, "model mismatch")[0]
    assert (
        "on 4 of them the loop is linearly unstable all the same: with other hands of [hands], near rest, or released"
        in told
    )
    assert "[device.range]" in told


def test_hands_at_the_force_limit_are_no_part_of_what_is_felt(document):
    changed = copy.deepcopy(document)
    assert "median of" not in lines_of(changed, "rendered")[0]
    changed["trial"]["at_force_limit"] = 7
    assert "(median of the 3 hands that stay below the force limit)" in lines_of(changed, "rendered")[0]
    assert conclusion_lines(changed)[0].startswith("deploy, though most hands push through the wall, on ")
    changed["trial"]["at_force_limit"] = 5
    assert conclusion_lines(changed)[0].startswith("deploy on ")


def test_hands_that_feel_another_stiffness_are_told(document):
    over_hands = document["trial"]["stiffness_n_per_m"]
    low, high = over_hands["nine_in_ten"]
    assert over_hands["lowest"] <= low <= over_hands["median"] <= high <= over_hands["highest"]
    assert "nine hands in ten" not in lines_of(document, "rendered")[0]
    changed = copy.deepcopy(document)
    low, high = 0.5 * over_hands["median"], 1.01 * over_hands["median"]
    changed["trial"]["stiffness_n_per_m"]["nine_in_ten"] = [low, high]
    assert f"; {low:.4g} to {high:.4g} N/m for nine hands in ten" in lines_of(changed, "rendered")[0]


def test_a_press_with_friction_is_where_no_vibration_is_felt(document):
    (line,) = lines_of(document, "trial")
    assert "10 press without a vibration above the vibrotactile threshold, and" in line
    changed = copy.deepcopy(document)
    changed["felt"]["friction_n"] = 0.2
    assert (
        "10 press without a vibration above the vibrotactile threshold, with the declared friction, and"
        in lines_of(changed, "trial")[0]
    )


def test_the_trial_of_a_device_with_ranges_is_said_to_be_on_the_nominal_one(document):
    assert conclusion_lines(document)[2].startswith("trial: ")
    changed = copy.deepcopy(document)
    changed["confirmed"]["devices"] = 16
    told = conclusion_lines(changed)[2]
    assert told.startswith("trial on the nominal device: ")
    assert "20 of 20 others on 16 devices of the ranges; " in told


def test_a_wall_of_which_hardly_anything_is_left_is_said_to_be_that_first(document):
    changed = copy.deepcopy(document)
    assert conclusion_lines(changed)[0].startswith("deploy on soft: ")
    changed["felt"]["share_of_wall"] = 0.05
    assert conclusion_lines(changed)[0].startswith("deploy, though hardly anything of the wall is left, on soft: ")


def test_a_wall_that_is_stiff_at_rest_and_soft_in_motion_is_told(document):
    changed = copy.deepcopy(document)
    changed["felt"]["complex_error"]["1"] = 0.468
    assert lines_of(changed, "in motion") == []
    changed["coupling"]["runtime"]["state_feedback"] = {"innovation": [1.0], "dead_zone_m": 1e-5}
    assert "the error of 46.8 % at 1 Hz" in lines_of(changed, "in motion")[0]
    changed["felt"]["complex_error"]["1"] = 0.1
    assert lines_of(changed, "in motion") == []
    changed["felt"]["complex_error"]["1"], changed["felt"]["share_of_wall"] = 0.468, 0.5
    assert lines_of(changed, "in motion") == []


def test_an_error_of_a_law_that_nobody_feels_is_said_to_be_that(document):
    changed = copy.deepcopy(document)
    assert "; impedance error against the physical wall" in lines_of(changed, "rendered")[0]
    changed["felt"]["stiffness_n_per_m"] = None
    assert "; impedance error of the law alone, which no hand feels, against" in lines_of(changed, "rendered")[0]


def test_friction_that_nobody_declared_is_nothing_to_lean_on(document):
    assert document["felt"]["friction_n"] == 0
    assert document["with_friction_n_per_m"] is None
    changed = copy.deepcopy(document)
    changed["with_friction_n_per_m"] = 2 * changed["felt"]["stiffness_n_per_m"]
    assert lines_of(changed, "friction")
