"""An effect that is not listed leaves no state, input, parameter or instruction; a listed one leaves only its own."""

import casadi as ca
import pytest
from scene_reference import scene_problem

from avc_casadi.model.gains import Gains
from avc_casadi.model.registries import EFFECTS
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.screen import explain

BASE = ('kind = "hand"', 'kind = "wall"')
# States and inputs that each effect adds to a hand at a wall, coupled in series.
ADDS = {
    'kind = "viscous-friction"\ndamping_ns_per_m = 1.0': ((), (), False),
    'kind = "coulomb-friction"': ((), (), True),
    'kind = "resonance"\nfrequency_hz = 150.0\ndamping_ratio = 0.1\nmass_ratio = 0.2': (
        ("handle_position_m", "handle_velocity_m_per_s"),
        (),
        True,
    ),
    'kind = "encoder"': ((), (), True),
    'kind = "noise"\nrms_m = 1e-6': ((), ("noise_m",), True),
    'kind = "velocity-filter"\ncutoff_hz = 100.0': (
        ("coupling_deflection_rate_m_per_s", "environment_deflection_rate_m_per_s"),
        (),
        True,
    ),
    'kind = "delay"\nsamples = 3': (("delayed_1_n", "delayed_2_n", "delayed_3_n"), (), True),
    'kind = "delay"\nsamples = 0.5': (("delayed_1_n",), (), True),
    'kind = "backlash"\ngap_m = 1e-4': (("backlash_position_m",), (), True),
    'kind = "notch"\nfrequency_hz = 100.0': (("notch_first_m", "notch_second_m"), (), True),
    'kind = "state-feedback"\nstate = [[1.0]]\nforce_m_per_n = [-1e-6]\ninnovation = [0.5]\nfeedback = [1.0]\n'
    "positions = [0]": (
        ("asked_force_n", "state_feedback_started", "state_feedback_s1_m"),
        (),
        True,
    ),
    'kind = "amplifier"\nbandwidth_hz = 200.0\norder = 2': (("actuator_force_n", "actuator_rate_n_per_s"), (), True),
    'kind = "jitter"\nrms_s = 1e-4': (("force_before_n",), ("late_share",), True),
    'kind = "jitter"\nrms_s = 0.0\ndropped_share = 0.1': (("force_before_n",), ("dropped",), True),
    'kind = "amplifier"\nbandwidth_hz = 200.0': (("actuator_force_n",), (), True),
    'kind = "saturation"': ((), (), True),
}


@pytest.mark.parametrize("effect", ADDS, ids=lambda effect: effect.split('"')[1])
def test_two_scenes_that_differ_in_one_effect_differ_by_that_effect_alone(effect):
    states, inputs, instructions = ADDS[effect]
    without, with_it = compile_scene(scene_problem(BASE)), compile_scene(scene_problem((*BASE, effect)))
    assert {name for name in with_it.states if name not in without.states} == set(states)
    assert set(without.states) <= set(with_it.states)
    assert tuple(name for name in with_it.inputs if name not in without.inputs) == inputs
    assert (with_it.instructions > without.instructions) == instructions


def test_cheap_effects_cost_their_own_instructions_whatever_stands_beside_them():
    encoder, saturation = 'kind = "encoder"', 'kind = "saturation"'
    friction = 'kind = "coulomb-friction"'

    def count(*more):
        return compile_scene(scene_problem((*BASE, *more))).instructions

    of_encoder, of_saturation = count(encoder) - count(), count(saturation) - count()
    assert 0 < of_encoder < 10
    assert 0 < of_saturation < 10
    # A constant that something else needs too counts once.
    assert count(friction, encoder) - count(friction) in (of_encoder, of_encoder - 1)
    assert count(friction, saturation) - count(friction) in (of_saturation, of_saturation - 1)
    assert count(encoder, saturation) - count() == of_encoder + of_saturation


def test_every_state_input_and_parameter_is_used():
    alone = ("dropped_share", "samples = 0.5", "order = 2")
    everything = (*BASE, *(effect for effect in ADDS if not any(part in effect for part in alone)))
    for effects in (BASE, everything, ('kind = "hand"',)):
        function = compile_scene(scene_problem(effects), damped=True).function
        symbols = [ca.SX.sym(name, function.sparsity_in(i)) for i, name in enumerate("xup")]
        outputs = ca.veccat(*function(*symbols))
        for symbol in symbols:
            assert all(ca.which_depends(outputs, symbol, 1, False)) or symbol.numel() == 0


def test_nothing_of_an_absent_wall_or_hand_is_active():
    free = compile_scene(scene_problem(('kind = "hand"',))).function
    still = compile_scene(scene_problem(('kind = "wall"',))).function
    whole = compile_scene(scene_problem(BASE)).function
    assert free.numel_in(0) == 2
    assert free.numel_out(1) == 2  # position and velocity, no force
    assert still.numel_in(1) == 0  # no target
    assert all(whole.activity([True] * whole.nnz_in()))
    # With all inputs inactive and the states at 0, an absent hand leaves a device at rest; a hand still moves it.
    at_rest = {f: [False] * f.nnz_in(0) + [True] * (f.nnz_in(1) + f.nnz_in(2)) for f in (still, whole)}
    assert not any(still.activity(at_rest[still]))
    assert any(whole.activity(at_rest[whole]))


def test_gains_are_parameters_only_where_there_is_a_coupling():
    problem = scene_problem(BASE)
    rigid, series = compile_scene(problem, coupled=False), compile_scene(problem)
    damped = compile_scene(problem, coupled=False, damped=True)
    assert rigid.instructions < series.instructions
    assert rigid.instructions < damped.instructions
    assert set(series.states) - set(rigid.states) == {"coupling_deflection_before_m"}
    assert set(damped.states) - set(rigid.states) == {"contact_position_before_m"}


def test_explain_counts_what_each_effect_adds():
    problem = scene_problem((*BASE, 'kind = "encoder"', 'kind = "delay"\nsamples = 2'))
    found = explain(problem, Gains(10.0, 7e3))
    costs = {cost.kind: cost for cost in found.effects}
    assert list(costs) == ["hand", "encoder", "wall", "delay"]
    assert costs["encoder"].states == 0
    rest = compile_scene(scene_problem((*BASE, 'kind = "delay"\nsamples = 2')))
    assert costs["encoder"].instructions == found.instructions - rest.instructions > 0
    assert costs["delay"].states == 2
    assert costs["wall"].states >= 2
    assert found.states == len(found.state_names) == 6
    assert set(found.absent) | set(costs) == set(EFFECTS)
    assert found.ns_per_step > 0
    assert found.scatter_ns >= 0
    assert not set(found.absent) & set(costs)
