"""An orbit that refutes rest is a motion of the project's own scene, and of a simulator that knows nothing of it."""

import numpy as np
import pytest
from clip_last_simulator import Simulator
from drawn_loops import contradiction, drawn_loop

import avc_casadi as avc
from avc_casadi.claims.prove.held_device import HAND
from avc_casadi.claims.prove.law import ContactLaw
from avc_casadi.claims.prove.orbits import Orbit, find_orbit
from avc_casadi.claims.prove.rest import prove_rest
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.effects.hand import Grip
from avc_casadi.simulation.effects.registry import build_effects

LIGHT = Hand(*(np.array([value]) for value in (0.05, 3.0, 200.0)))
# Contact law, delay, b, k, b_p of loops that are stable in contact with the light hand, and bounce all the same.
CASES = {
    "gated": ("gated", 0, 287.4, 2.913e6, 84.82),
    "gated series": ("gated", 0, 158.07, 75576.8, 0.0),
    "clip-last": ("clip-last", 0, 287.4, 2.913e6, 60.0),
}


def problem_of(contact, delay, wall=1e5):
    kinds = ["hand", "wall"] + ["delay"] * (delay > 0)
    return avc.load_problem("ve7").changed(
        coupling={"contact": contact, "structure": "damped", "contact_damping_ns_per_m": (0.0, 1e3)},
        device={"delay_samples": delay},
        environment={"stiffness_n_per_m": wall},
        scene={"effects": tuple({"kind": kind} for kind in kinds)},
    )


def orbit_of(case, hands=LIGHT):
    contact, delay, b, k, b_p = CASES[case]
    problem = problem_of(contact, delay)
    law = ContactLaw.of(problem, b, k, b_p)
    return problem, Gains(b, k, b_p), find_orbit(law, contact, problem.device, hands, starts=32)


def scene_state(scene, orbit):
    """The first state of an orbit as the scene names its states."""
    first = dict(zip(orbit.state_names, orbit.states[0], strict=True))
    before, stretch = first["position_before_m"], first["deflection_m"]
    values = {
        "device_position_m": first["device_position_m"] + orbit.target_m,
        "device_velocity_m_per_s": first["device_velocity_m_per_sample"] / scene.sample_time_s,
        "coupling_deflection_before_m": stretch,
        "environment_deflection_before_m": first.get("depth_before_m", before - stretch),
        "contact_position_before_m": before,
    }
    return np.array([values[name] for name in scene.states])


@pytest.mark.parametrize("case", ["gated", "clip-last"])
def test_the_scene_returns_to_where_it_began(case):
    problem, gains, orbit = orbit_of(case)
    assert orbit is not None
    assert orbit.enclosed
    assert orbit.multiplier > 1
    grip = Hand(**orbit.hand)
    effects = tuple(Grip(grip) if isinstance(one, Grip) else one for one in build_effects(problem))
    scene = compile_scene(problem, effects, damped=True)
    numbers = scene.parameter_values(gains)[0]
    start = state = scene_state(scene, orbit)
    force = []
    for _ in range(orbit.period):
        state, traces = (part.full().ravel() for part in scene.function(state, [orbit.target_m, 0.0], numbers))
        force.append(traces[scene.traces.index("force_n")])
    assert np.abs(state - start).max() < 1e-9 * np.abs(start).max()
    np.testing.assert_allclose(force, orbit.force_n, rtol=1e-6, atol=1e-6)
    assert min(force) == 0 < max(force)
    assert np.ptp(orbit.states[:, 1]) / scene.sample_time_s > 0.01


@pytest.mark.thorough
def test_the_light_hand_bounces_at_the_stiff_wall_behind_the_gate_and_not_when_clipped_last():
    """The constant design for figure 5's wall: an orbit of a few milliseconds, which rests once the clip comes last."""
    problem, gains, orbit = orbit_of("gated")
    assert orbit.period < 20
    law = ContactLaw.of(problem, *vars(gains).values())
    box = {name: getattr(problem.hands, name) for name in HAND}
    assert prove_rest(law, "gated", problem.device, box).outcome == "refuted"
    assert prove_rest(law, "clip-last", problem.device, box).outcome == "proved"
    assert find_orbit(law, "clip-last", problem.device, LIGHT, starts=32) is None


def test_an_orbit_survives_its_document():
    _, _, orbit = orbit_of("gated")
    again = Orbit.from_document(orbit.document())
    assert again.document() == orbit.document()
    np.testing.assert_array_equal(again.states, orbit.states)


def test_hands_beside_the_orbit_leave_it_and_come_to_rest_where_rest_is_proved():
    """The simulator agrees with the proof on the very start that the gated law bounces from."""
    problem, gains, orbit = orbit_of("gated")
    numbers = {"b": gains.damping_ns_per_m, "k": gains.stiffness_n_per_m, "b_p": gains.contact_damping_ns_per_m}
    numbers |= {"b_e": problem.environment.damping_ns_per_m, "k_e": problem.environment.stiffness_n_per_m}
    hand = {name: np.array([value]) for name, value in orbit.hand.items()}
    simulator = Simulator(problem.device.model_dump(), numbers, hand, np.array([orbit.target_m]))
    position, velocity = orbit.states[0, 0] + orbit.target_m, orbit.states[0, 1] / 1e-3
    simulator.start(np.array([position]), np.array([velocity]))
    _, speeds, _ = simulator.run(3000)
    assert np.abs(speeds[:20]).max() > 0.05
    assert np.abs(speeds[-500:]).max() < 1e-6


@pytest.mark.one_of(2)
@pytest.mark.parametrize("seed", range(12))
def test_nothing_speaks_against_a_random_loop(seed):
    """Proved loops rest from random states; witnesses of refuted ones replay: all in the simulator of its own."""
    assert contradiction(drawn_loop(seed, plain=True), seed) == ""
