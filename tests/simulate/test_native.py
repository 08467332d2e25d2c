"""Generated C gives the bits of CasADi's own evaluation: any scene, in any lane, on one thread and on several."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scene_cases import CASES, FRICTION, HAND, QUICK, WALL
from scene_reference import scene_problem

import avc_casadi as avc
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.execute import execute, execute_to_speed
from avc_casadi.simulation.judge import judge
from avc_casadi.simulation.native import LANES, NativeScene, compiler
from avc_casadi.simulation.scene import compile_for, held_by, settled, simulate_batch

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")

ENCODER = 'kind = "encoder"\nresolution_m = 2e-6'
RESONANCE = 'kind = "resonance"\nfrequency_hz = 180.0\ndamping_ratio = 0.02\nmass_ratio = 0.3'
ADAPTED = (HAND, WALL, 'kind = "estimator"', 'kind = "adaptation"', FRICTION, ENCODER)


def compiled_scene(effects, gains, scene=""):
    problem = scene_problem(effects, motion=QUICK, scene=scene)
    bound, chosen, _ = settled(problem, build_effects(problem), gains or avc.solve(problem, "exact"))
    found = compile_for(problem, bound, chosen)
    return found, found.parameter_values(chosen)[0]


def several(row, runs, seed, spread):
    """Different numbers in every lane: hands, walls and gains of nobody."""
    return row * (1 + spread * np.random.default_rng(seed).uniform(-1, 1, (runs, len(row))))


def assert_same_bits(ours, theirs):
    """Not a number may have any sign."""
    ours, theirs = (np.ascontiguousarray(np.where(np.isnan(one), np.nan, one)) for one in (ours, theirs))
    np.testing.assert_array_equal(ours.view(np.int64), theirs.view(np.int64))


@pytest.mark.thorough
@settings(max_examples=8)
@given(
    case=st.sampled_from(sorted(CASES)),
    damping=st.sampled_from([0.0, 10.0, 200.0]),
    stiffness=st.floats(1e2, 1e7),
    contact=st.sampled_from([0.0, 15.0]),
    integrator=st.sampled_from(["exact", "projected", "rk4"]),
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
    with np.errstate(all="ignore"):
        lanes = NativeScene(scene)(scene.initial, inputs.T, parameters, 1)
        alone = execute(scene, parameters, inputs, engine="casadi")
    for index, (name, values) in enumerate(alone.items()):
        assert name == scene.traces[index]
        assert_same_bits(lanes[:, :, index], values)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("effects", "gains"),
    [
        (ADAPTED, None),
        ((HAND, WALL, FRICTION, ENCODER), Gains(10.0, 1e5)),
        ((RESONANCE, HAND, WALL, ENCODER), Gains(10.0, 1e5)),
    ],
)
def test_peaks_and_rest_are_those_of_the_traces(effects, gains):
    scene, row = compiled_scene(effects, gains, 'duration_s = 0.8\nintegrator = "projected"\nsubsteps = 4\n')
    parameters, inputs = several(row, LANES + 5, 3, 0.05), scene.input_values()
    assert scene.speeds == ("velocity_m_per_s", "held_m_per_s")[: 1 + (RESONANCE in effects)]
    lanes = NativeScene(scene)
    alone = np.stack(list(execute(scene, parameters, inputs, engine="casadi").values()), axis=-1)
    assert_same_bits(lanes(scene.initial, inputs.T, parameters, 3), alone)
    with np.errstate(all="ignore"):
        peaks = lanes.peaks(scene.initial, inputs.T, parameters, 2, scene.samples - 500)
        np.testing.assert_array_equal(peaks[:, 0], np.abs(alone[:, :, 0]).max(axis=1))
        named = {name: alone[..., place] for place, name in enumerate(scene.traces)}
        speeds = [np.abs(named[name][:, -500:]).max(axis=1) for name in scene.speeds]
        np.testing.assert_array_equal(peaks[:, 1], np.max(speeds, axis=0))
        moved, force, time = (named["position_m"], named["velocity_m_per_s"]), named["force_n"], scene.sample_time_s
        judged = judge(*moved, force, time, held_m_per_s=named.get("held_m_per_s"))
        speed = execute_to_speed(scene, parameters, inputs, engine="native")
        few = execute_to_speed(scene, parameters[:3], inputs, engine="casadi")
    np.testing.assert_array_equal(speed < 1, judged.stable)
    np.testing.assert_array_equal(few, speed[:3])


@pytest.mark.thorough
def test_threads_and_chunks_do_not_change_a_bit():
    problem = scene_problem(('kind = "hand"', 'kind = "wall"', 'kind = "coulomb-friction"'), scene="duration_s = 0.3\n")
    draw = np.random.default_rng(1).uniform
    hands = Hand(draw(0.05, 0.3, 300), draw(3, 20, 300), draw(200, 800, 300))
    effects = held_by(problem, compile_scene(problem).effects, hands)
    scene = compile_scene(problem, effects)
    parameters = scene.parameter_values(Gains(200.0, 1e5))
    native = NativeScene(scene)
    one, many = (native(scene.initial, scene.input_values().T, parameters, workers) for workers in (1, 3))
    np.testing.assert_array_equal(one.view(np.int64), many.view(np.int64))
    by_chunks = simulate_batch(problem, hands, Gains(200.0, 1e5))
    np.testing.assert_array_equal(by_chunks.peak_velocity_m_per_s, np.abs(one[:, -500:, 1]).max(axis=1))
