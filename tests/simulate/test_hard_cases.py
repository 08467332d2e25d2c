"""The hard cases of scenes: each ends in a right answer, or in an answer that says that the loop has gone."""

import json
import math

import numpy as np
import pytest
from scene_reference import HEAD, scene_problem

import avc_casadi as avc
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import NO_COUPLING, Gains, gains_at
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.scene import simulate_batch

HAND, WALL, FRICTION = 'kind = "hand"', 'kind = "wall"', 'kind = "coulomb-friction"'


def is_json(run):
    json.loads(json.dumps(run.document(), allow_nan=False))
    return True


@pytest.mark.parametrize("gains", [NO_COUPLING, Gains(10.0, 7e3), Gains(math.inf, math.inf, 80.0), Gains(200.0, 1e7)])
def test_wall_of_1e7(gains):
    run = simulate(scene_problem((HAND, WALL, FRICTION), k_e=1e7), gains)
    assert is_json(run)
    assert np.isfinite(run.position_m).all()
    if gains.stiffness_n_per_m == 7e3:
        assert run.claim == "asymptotic"
        # In series with the coupling the wall counts no more.
        assert run.apparent_stiffness_n_per_m == pytest.approx(7e3, rel=0.05)
    else:
        assert not run.stable


def test_gain_table_that_jumps_by_1e4_between_rows():
    problem = scene_problem((HAND, WALL))
    table = avc.solve(problem, "exact")
    stiffness = np.where(np.arange(table.rows) % 2, 10.0, 1e5)
    jumping = type(table)(**{**vars(table), "stiffness_n_per_m": stiffness})
    low, high = jumping.frequency_hz[10:12]
    for share in (0.0, 1e-9, 0.5, 1 - 1e-9, 1.0):
        gains = gains_at(jumping, float(low ** (1 - share) * high**share))
        assert 10.0 * (1 - 1e-9) <= gains.stiffness_n_per_m <= 1e5 * (1 + 1e-9)
        assert is_json(simulate(problem, gains))
    assert gains_at(jumping, float(low)).stiffness_n_per_m == 1e5
    assert gains_at(jumping, float(math.sqrt(low * high))).stiffness_n_per_m == pytest.approx(50005.0, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.parametrize("sample_time", [1e-5, 1e-2])
def test_sample_times(sample_time):
    head = HEAD.replace("[environment]", f"sample_time_s = {sample_time}\n[environment]")
    head += "[frequency]\nstart_hz = 0.1\nstop_hz = 20.0\n"
    k_e = 1e5 if sample_time < 1e-3 else 150.0
    scene = f"duration_s = {1.1 if sample_time < 1e-3 else 1.5}\n"
    run = simulate(scene_problem((HAND, WALL), head=head, b_e=0.0, k_e=k_e, scene=scene), NO_COUPLING)
    assert run.claim == "asymptotic"
    assert run.apparent_stiffness_n_per_m == pytest.approx(k_e, rel=1e-3)


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
