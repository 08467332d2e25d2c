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


def test_two_sided_wall_of_1e7_diverges_and_says_so():
    run = simulate(scene_problem((HAND, 'kind = "environment"'), k_e=1e7), NO_COUPLING)
    assert run.judgement.diverged
    assert run.claim == "unstable"
    assert run.buzzing
    assert is_json(run)
    assert run.document()["apparent_stiffness_n_per_m"] is None


def test_friction_that_sticks_and_slips_in_one_sample():
    motion = 'kind = "tap"\nstart_m = -0.0005\nend_m = 0.0005\nfrequency_hz = 200.0\n'
    effects = (HAND, WALL, 'kind = "coulomb-friction"\nforce_n = 4.0')
    coarse, fine = (
        simulate(scene_problem(effects, motion=motion, scene=f"duration_s = 1.1\nsubsteps = {n}\n"), Gains(5.0, 2e4))
        for n in (1, 16)
    )
    moving = coarse.velocity_m_per_s != 0
    assert np.count_nonzero(np.diff(moving.astype(int))) > 10
    np.testing.assert_allclose(coarse.position_m, fine.position_m, rtol=0, atol=1e-13)


def test_encoder_step_larger_than_the_penetration():
    effects = (HAND, WALL, 'kind = "encoder"\nresolution_m = 0.004')
    run = simulate(scene_problem(effects, k_e=2000.0, b_e=0.0), NO_COUPLING)
    # 5 N of the hand would press 2.5 mm deep; the encoder knows of 0 and 4 mm only.
    assert set(np.round(run.force_n[run.force_n > 0][-500:] / 2000.0 / 0.004, 6)) <= {1.0}
    assert run.judgement.mean_penetration_m < 0.004
    assert is_json(run)


def test_saturation_in_every_sample():
    effects = (HAND, WALL, 'kind = "saturation"\nforce_n = 1e-3')
    run = simulate(scene_problem(effects), Gains(10.0, 7e3))
    touching = run.tool_m > 1e-6
    assert touching[-500:].all()
    assert (run.force_n[touching] == 1e-3).all()
    assert run.position_m[-1] == pytest.approx(0.01 - 1e-3 / 500.0, abs=1e-9)


def test_zero_hand_mass():
    hand = 'kind = "hand"\nmass_kg = 0.0'
    run = simulate(scene_problem((hand, WALL)), Gains(5.0, 2e3))
    assert run.claim == "asymptotic"
    assert run.apparent_stiffness_n_per_m == pytest.approx(1 / (1 / 2e3 + 1e-5), rel=1e-6)


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


def test_motion_that_never_touches_the_wall():
    motion = 'kind = "press"\nstart_m = -0.02\nend_m = -0.005\n'
    run = simulate(scene_problem((HAND, WALL, FRICTION), motion=motion), Gains(10.0, 7e3))
    assert run.claim == "asymptotic"
    assert not run.force_n.any()
    assert not run.buzzing
    assert run.energy_generated_j == 0
    document = run.document()
    assert document["apparent_stiffness_n_per_m"] is None
    assert document["rate_hardness_n_per_m"] is None


def test_duration_of_one_sample():
    for effects in ((HAND, WALL), (HAND, WALL, FRICTION, 'kind = "encoder"', 'kind = "delay"\nsamples = 5')):
        run = simulate(scene_problem(effects, scene="duration_s = 1e-3\n"), Gains(10.0, 7e3))
        assert run.samples == 1
        assert run.stable
        assert is_json(run)


def test_oscillating_motions_come_to_rest_or_run_out():
    for kind in ("tap", "stroke", "free"):
        for duration in (0.3, 3.0, 3.7):
            run = simulate(
                scene_problem((HAND, WALL), motion=f'kind = "{kind}"\n', scene=f"duration_s = {duration}\n"),
                Gains(10.0, 7e3),
            )
            assert is_json(run)
            assert run.stable == (duration > 1)


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


def test_long_delay():
    run = simulate(scene_problem((HAND, WALL, 'kind = "delay"\nsamples = 20'), k_e=300.0, b_e=1.0), NO_COUPLING)
    assert run.states == 23
    assert run.claim == "asymptotic"


def test_thousands_of_times_stiffer_hand_and_heavier_device():
    hand = 'kind = "hand"\nmass_kg = 1e-6\ndamping_ns_per_m = 1e4\nstiffness_n_per_m = 1e8'
    run = simulate(scene_problem((hand, WALL), k_e=1000.0), NO_COUPLING)
    assert is_json(run)
    np.testing.assert_allclose(run.position_m[1:], run.target_m[1:], atol=1e-5)


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


def test_as_many_samples_are_dropped_as_said():
    effects = ('kind = "hand"', 'kind = "wall"', 'kind = "jitter"\nrms_s = 0.0\ndropped_share = 0.1')
    compiled = compile_scene(scene_problem(effects, scene="duration_s = 20.0\n"))
    dropped = dict(zip(compiled.inputs, compiled.input_values(), strict=True))["dropped"]
    assert dropped.mean() == pytest.approx(0.1, abs=0.01)
