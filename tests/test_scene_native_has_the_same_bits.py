"""Generated C gives the bits of CasADi's own evaluation, for every effect, on one thread and on several."""

import numpy as np
import pytest
from scene_cases import CASES, FRICTION, HAND, QUICK, WALL
from scene_reference import scene_problem

import avc_casadi as avc
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.native import NativeScene, compiler
from avc_casadi.simulation.scene import compile_for, held_by, settled, simulate_batch

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")


MORE = {
    "stiff-amplifier-with-friction": (
        (HAND, WALL, FRICTION, 'kind = "amplifier"\nbandwidth_hz = 900.0'),
        Gains(10.0, 7e3),
    ),
    "friction-in-free-space": ((HAND, FRICTION), Gains(10.0, 7e3)),
    "friction-without-a-hand": ((WALL, FRICTION), Gains(10.0, 7e3)),
    "adapted-gains": ((HAND, WALL, 'kind = "estimator"', 'kind = "adaptation"', FRICTION), None),
}


def bits(traces):
    return {name: np.ascontiguousarray(values).view(np.int64) for name, values in traces.items()}


@pytest.mark.thorough
@pytest.mark.parametrize(
    "case",
    [
        "linear-series",
        "no-wall",
        "much-friction",
        "late-dropped-friction",
        "velocity-filter",
        "everything",
        *MORE,
    ],
)
def test_bits(case):
    effects, gains = (CASES | MORE)[case]
    problem = scene_problem(effects, motion=QUICK, scene="duration_s = 0.3\n")
    settled_effects, gains, _ = settled(problem, build_effects(problem), gains or avc.solve(problem, "exact"))
    scene = compile_for(problem, settled_effects, gains)
    assert scene.branches == ("coulomb-friction" in str(effects))
    arguments = scene, scene.parameter_values(gains), scene.input_values()
    ours, native = bits(execute(*arguments, engine="casadi")), bits(execute(*arguments, engine="native"))
    assert ours.keys() == native.keys()
    for name, values in ours.items():
        np.testing.assert_array_equal(values, native[name], err_msg=name)


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
