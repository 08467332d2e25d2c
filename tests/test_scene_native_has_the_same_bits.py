"""Generated C gives the bits of CasADi's own evaluation, for every effect, on one thread and on several."""

import numpy as np
import pytest
from scene_reference import scene_problem
from test_scene_agrees_with_solve_ivp import CASES, QUICK

from avc_casadi.scene import Gains, Hand, compile_scene, execute, simulate_batch
from avc_casadi.scene._native import NativeScene, compiler

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


def bits(traces):
    return {name: np.ascontiguousarray(values).view(np.int64) for name, values in traces.items()}


@pytest.mark.parametrize(
    "case", ["linear-series", "no-wall", "much-friction", "late-dropped-friction", "velocity-filter"]
)
def test_bits(case):
    effects, gains = CASES[case]
    scene = compile_scene(
        scene_problem(effects, motion=QUICK, scene="duration_s = 0.3\n"),
        coupled=not gains.rigid,
        damped=gains.contact_damping_ns_per_m > 0,
    )
    arguments = scene, scene.parameter_values(gains), scene.input_values()
    ours, native = bits(execute(*arguments, engine="casadi")), bits(execute(*arguments, engine="native"))
    assert ours.keys() == native.keys()
    for name, values in ours.items():
        np.testing.assert_array_equal(values, native[name], err_msg=name)


def test_threads_and_chunks_do_not_change_a_bit():
    problem = scene_problem(('kind = "hand"', 'kind = "wall"', 'kind = "coulomb-friction"'), scene="duration_s = 0.3\n")
    draw = np.random.default_rng(1).uniform
    hands = Hand(draw(0.05, 0.3, 300), draw(3, 20, 300), draw(200, 800, 300))
    effects = tuple(hands if effect.kind == "hand" else effect for effect in compile_scene(problem).effects)
    scene = compile_scene(problem, effects)
    parameters = scene.parameter_values(Gains(200.0, 1e5))
    native = NativeScene(scene.function)
    one, many = (native(scene.initial, scene.input_values().T, parameters, workers) for workers in (1, 3))
    np.testing.assert_array_equal(one.view(np.int64), many.view(np.int64))
    by_chunks = simulate_batch(problem, hands, Gains(200.0, 1e5))
    np.testing.assert_array_equal(by_chunks.peak_velocity_m_per_s, np.abs(one[:, -500:, 1]).max(axis=1))
