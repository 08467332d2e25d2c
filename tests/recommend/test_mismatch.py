"""What is recommended is tried on devices a tenth off their file too, and it is told how that ends."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.coupling import Coupling
from avc_casadi.loops.walls import damping_range, stiffest_wall
from avc_casadi.model.corners import device_corners, linear_values
from avc_casadi.model.gains import Gains, near_rigid_n_per_m
from avc_casadi.model.hands import hand_corners, with_released
from avc_casadi.recommendation.perturbed_devices import off_file, perturbed

WALL_N_PER_M = 20e3


def rigid(problem):
    """A contact damper in the middle of what is linearly stable with everybody."""
    people = with_released(hand_corners(problem.hands))
    found = damping_range(problem.device, people, problem.environment.stiffness_n_per_m)
    damping = (found.lowest_ns_per_m + found.highest_ns_per_m) / 2
    return Coupling.constant(problem, Gains(0.0, near_rigid_n_per_m(problem.device), damping), "contact damper")


def before(wall, **device):
    """A bare wall before an ideal device, and hands so light that the device alone matters."""
    return avc.load_problem("figure5").changed(
        environment={"stiffness_n_per_m": wall, "damping_ns_per_m": 0.0},
        device={"coulomb_friction_n": 0.0, "encoder_resolution_m": 0.0, **device},
        hands={"mass_kg": (1e-3, 2e-3)},
    )


@pytest.mark.thorough
def test_a_wall_at_its_limit_moves_on_lighter_devices_and_one_far_from_it_does_not():
    bare = before(WALL_N_PER_M)
    limit = stiffest_wall(bare.device, with_released(hand_corners(bare.hands))).stiffness_n_per_m
    brittle, safe = (off_file(rigid(before(share * limit))) for share in (0.97, 0.5))
    assert safe.trial.counts()["at_rest_without_friction"] == safe.trial.hands == 128
    assert brittle.trial.counts()["at_rest_without_friction"] < brittle.trial.hands


def radius_let_go(device, stiffness, damping):
    """Of a mass before a spring and a damper on the sampled position, held over each sample; by hand."""
    mass, rubs, period = device.mass_kg, device.damping_ns_per_m, device.sample_time_s
    left = np.exp(-rubs / mass * period)
    coast = (1 - left) * mass / rubs
    push = np.array([(period - coast) / rubs, (1 - left) / rubs, 0.0])
    free = np.array([[1.0, coast, 0.0], [0.0, left, 0.0], [1.0, 0.0, 0.0]])
    law = -np.array([stiffness + damping / period, 0.0, -damping / period])
    return max(abs(np.linalg.eigvals(free + np.outer(push, law))))


@pytest.mark.thorough
def test_a_wall_that_only_a_hand_holds_is_told_to_be_unstable_let_go():
    bare = before(WALL_N_PER_M)
    wall = 0.99 * stiffest_wall(bare.device, with_released(hand_corners(bare.hands))).stiffness_n_per_m
    held = bare.changed(
        hands={"mass_kg": (1.0, 1.2), "damping_ns_per_m": (20.0, 25.0)},
        environment={"stiffness_n_per_m": wall},
    )
    coupling = rigid(held)
    assert all(claim.passed for claim in avc.deployable(coupling).claims if claim.name != "disk-margin")
    found = off_file(coupling)
    assert found.trial.counts()["at_rest_without_friction"] == found.trial.hands
    damping = float(coupling.table.gains[2, 0])
    expected = [radius_let_go(device, wall, damping) > 1 for device in perturbed(held.device, found.keys, 0)]
    assert found.unstable == found.document()["linearly_unstable"] == sum(expected)
    assert 0 < sum(expected) < len(expected)


def test_each_number_is_a_tenth_off_up_or_down():
    device = before(WALL_N_PER_M).device
    values = linear_values(device)
    keys = tuple(key for key, value in values.items() if value > 0)
    drawn = [one for seed in range(4) for one in perturbed(device, keys, seed)]
    for key in keys:
        assert {round(linear_values(one)[key] / values[key], 9) for one in drawn} == {0.9, 1.1}


@pytest.mark.thorough
def test_numbers_with_a_range_stay_and_none_is_left_where_all_have_one():
    some = off_file(rigid(before(WALL_N_PER_M, range={"mass_kg": (0.09, 0.12)})))
    assert "mass_kg" not in some.keys
    assert set(some.keys) < set(linear_values(before(WALL_N_PER_M).device))
    device = before(WALL_N_PER_M).device
    ranges = {key: (0.99 * value, 1.01 * value) for key, value in linear_values(device).items() if value > 0}
    whole = before(WALL_N_PER_M, range=ranges)
    assert len(device_corners(whole.device)) == 2 ** len(ranges)
    assert off_file(rigid(whole)) is None
