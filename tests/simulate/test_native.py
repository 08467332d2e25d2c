"""Generated C gives the bits of CasADi's own evaluation: any scene, in any lane, on one thread and on several."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_cases import CASES, QUICK
from scene_reference import scene_problem

import avc_casadi as avc
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import build_effects, compile_scene
from avc_casadi.simulation.execute import LANES, NativeScene, compiler, execute
from avc_casadi.simulation.scene import resolve, simulate_batch

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def compiled_scene(effects, gains, scene=""):
    problem = scene_problem(effects, motion=QUICK, scene=scene)
    bound, chosen, _ = resolve(problem, build_effects(problem), gains or avc.solve(problem, "exact"))
    found = compile_scene(problem, bound, chosen)
    return found, found.parameter_values(chosen)[0]


def several(row, runs, seed, spread):
    """Different numbers in every lane: hands, walls and gains of nobody."""
    return row * (1 + spread * np.random.default_rng(seed).uniform(-1, 1, (runs, len(row))))


def assert_same_bits(ours, theirs):
    """Not a number may have any sign."""
    ours, theirs = (np.ascontiguousarray(np.where(np.isnan(one), np.nan, one)) for one in (ours, theirs))
    np.testing.assert_array_equal(ours.view(np.int64), theirs.view(np.int64))


@pytest.mark.slow
@settings(max_examples=8)
@given(
    case=st.sampled_from(sorted(CASES)),
    damping=st.sampled_from([0.0, 10.0, 200.0]),
    stiffness=st.floats(1e2, 1e7),
    contact=st.sampled_from([0.0, 15.0]),
    integrator=st.sampled_from(["exact", "projected"]),
    runs=st.integers(1, 2 * LANES + 3),
    spread=st.sampled_from([1e-3, 0.3, 3.0]),
    seed=st.integers(0, 10**6),
)
def test_any_scene_in_any_lane(case, damping, stiffness, contact, integrator, runs, spread, seed):
    if integrator == "projected" and "rms_s = 0.0" not in str(CASES[case]) and "jitter" in str(CASES[case]):
        integrator = "exact"  # late forces break substeps up
    how = f'duration_s = 0.05\nintegrator = "{integrator}"\nsubsteps = 2\n'
    scene, row = compiled_scene(CASES[case][0], Gains(damping, stiffness, contact), how)
    parameters, inputs = several(row, runs, seed, spread), scene.input_values()
    with np.errstate(all="ignore"), pytest.MonkeyPatch.context() as without:
        lanes = NativeScene(scene)(scene.initial, inputs.T, parameters, 1)
        without.setenv("CC", "no-such-compiler")
        alone = execute(scene, parameters, inputs)
    for index, (name, values) in enumerate(alone.items()):
        assert name == scene.traces[index]
        assert_same_bits(lanes[:, :, index], values)


# The hard cases of scenes: each ends in a right answer, or in an answer that says that the loop has gone.

HARD_CASES_HAND, HARD_CASES_WALL, HARD_CASES_FRICTION = 'kind = "hand"', 'kind = "wall"', 'kind = "coulomb-friction"'


def test_hands_of_a_batch_are_those_of_single_runs():
    problem = scene_problem((HARD_CASES_HAND, HARD_CASES_WALL, HARD_CASES_FRICTION))
    mass, damping, stiffness = np.array([[0.05, 3.0, 200.0], [0.3, 20.0, 800.0], [0.0, 10.0, 500.0]]).T
    many = simulate_batch(problem, Hand(mass, damping, stiffness), Gains(200.0, 1e5))
    for row in range(3):
        one = simulate(problem, Gains(200.0, 1e5), hand=Hand(mass[row], damping[row], stiffness[row]))
        for name, values in vars(many).items():
            np.testing.assert_allclose(values[row], getattr(one.judgement, name), rtol=1e-9, atol=1e-12, err_msg=name)


def test_seeds_repeat_and_differ():
    problem = scene_problem(
        (HARD_CASES_HAND, HARD_CASES_WALL, 'kind = "noise"\nrms_m = 1e-5\nseed = 3', 'kind = "jitter"\nrms_s = 1e-4')
    )
    one, again, other = (simulate(problem, Gains(10.0, 7e3), seed=seed).position_m for seed in (0, 0, 1))
    np.testing.assert_array_equal(one, again)
    assert np.abs(one - other).max() > 1e-7
    noise = dict(zip(compile_scene(problem).inputs, compile_scene(problem).input_values(), strict=True))["noise_m"]
    assert noise.std() == pytest.approx(1e-5, rel=0.05)
