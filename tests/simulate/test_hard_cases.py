"""The hard cases of scenes: each ends in a right answer, or in an answer that says that the loop has gone."""

import numpy as np
import pytest
from scene_reference import scene_problem

from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.scene import simulate_batch

HAND, WALL, FRICTION = 'kind = "hand"', 'kind = "wall"', 'kind = "coulomb-friction"'


def test_hands_of_a_batch_are_those_of_single_runs():
    problem = scene_problem((HAND, WALL, FRICTION))
    mass, damping, stiffness = np.array([[0.05, 3.0, 200.0], [0.3, 20.0, 800.0], [0.0, 10.0, 500.0]]).T
    many = simulate_batch(problem, Hand(mass, damping, stiffness), Gains(200.0, 1e5))
    for row in range(3):
        one = simulate(problem, Gains(200.0, 1e5), hand=Hand(mass[row], damping[row], stiffness[row]))
        for name, values in vars(many).items():
            np.testing.assert_allclose(values[row], getattr(one.judgement, name), rtol=1e-9, atol=1e-12, err_msg=name)


def test_seeds_repeat_and_differ():
    problem = scene_problem((HAND, WALL, 'kind = "noise"\nrms_m = 1e-5\nseed = 3', 'kind = "jitter"\nrms_s = 1e-4'))
    one, again, other = (simulate(problem, Gains(10.0, 7e3), seed=seed).position_m for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 1e-7
    noise = dict(zip(compile_scene(problem).inputs, compile_scene(problem).input_values(), strict=True))["noise_m"]
    assert noise.std() == pytest.approx(1e-5, rel=0.05)
