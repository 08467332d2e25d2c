"""The loop of a coupling with state feedback: the Jacobian of its scene, its step in time, its stiffness at rest."""

import casadi as ca
import numpy as np
import pytest
from hardware_bench import believer
from quick import first

import avc_casadi as avc
from avc_casadi.claims.hands import worst_case_behind_observer
from avc_casadi.coupling import Coupling
from avc_casadi.design.observer_law import GUESSES, regulator
from avc_casadi.loops.loop import Body
from avc_casadi.loops.wall import closed, frozen_law, law_at_rest
from avc_casadi.model.device import Device
from avc_casadi.model.gains import Gains
from avc_casadi.model.hands import Hand, hand_ranges, joined, released_hand
from avc_casadi.model.law import Law
from avc_casadi.model.plant import sampled_plant
from avc_casadi.model.problem import Hands
from avc_casadi.model.runtime import Runtime
from avc_casadi.simulation.compile import build_effects, compile_scene
from avc_casadi.simulation.effects.mechanics import Grip
from avc_casadi.simulation.runtime.observer import state_feedback_step

HAND = Hand(0.12, 7.0, 450.0)


def random_device(rng):
    keys = {"mass_kg": rng.uniform(0.05, 0.5), "damping_ns_per_m": rng.uniform(0.1, 5), "delay_samples": 0}
    keys["delay_samples"] = float(rng.choice([0, 1, 2, 0.4, 1.25]))
    if rng.random() < 0.6:
        keys["resonance"] = {
            "frequency_hz": rng.uniform(60, 300),
            "damping_ratio": rng.uniform(0.01, 0.1),
            "mass_ratio": rng.uniform(0.2, 0.8),
        }
    if rng.random() < 0.6:
        keys |= {"amplifier_bandwidth_hz": rng.uniform(200, 3000), "amplifier_order": int(rng.integers(1, 3))}
    return Device.model_validate(keys | {"encoder_at": str(rng.choice(["motor", "handle"]))})


def law_of(rng, share=1.0):
    found = believer(int(rng.integers(0, 1000)))
    gain = tuple(share * value for value in found.innovation)
    zone = ("dead_zone_m", "face_m", "opens_m", "open_m", "kept", "smoothing")
    return found.model_copy(update={"innovation": gain} | dict.fromkeys(zone, 0.0))


def scene_eigenvalues(device, law, gains, wall):
    """Of the Jacobian of one sample in a wall on both sides, the law begun and without dead zone."""
    kinds = ["hand", "environment"] + ["resonance"] * (device.resonance is not None)
    kinds += ["amplifier"] * (device.amplifier_bandwidth_hz is not None) + ["delay"] * (device.delay_samples > 0)
    if device.resonance is not None and device.encoder_at == "handle":
        kinds.append("encoder")
    text = "[device]\nmass_kg = 1.0\ndamping_ns_per_m = 1.0\n[frequency]\nstop_hz = 10.0\n[environment]\n"
    text += f"damping_ns_per_m = {wall[0]}\nstiffness_n_per_m = {wall[1]}\n"
    text += "".join(f'[[scene.effects]]\nkind = "{kind}"\n' for kind in kinds)
    problem = avc.parse_problem(text).changed(device=device)
    listed = (*problem.scene.effects, law)
    problem = problem.changed(scene={"effects": listed})
    built = tuple(Grip(HAND) if isinstance(one, Grip) else one for one in build_effects(problem))
    scene = compile_scene(problem, built, gains)
    shape = [scene.function.numel_in(place) for place in range(3)]
    symbols = [ca.SX.sym(name, count) for name, count in zip("xup", shape, strict=True)]
    slope = ca.Function("slope", symbols, [ca.jacobian(scene.function(*symbols)[0], symbols[0])])
    now = np.array([1.0 if name == "state_feedback_started" else 1e-3 for name in scene.states])
    jacobian = slope(now, np.zeros(shape[1]), scene.parameter_values(gains)[0]).full()
    return np.linalg.eigvals(jacobian), problem


@pytest.mark.parametrize("seed", range(40))
def test_its_eigenvalues_are_those_of_the_jacobian(seed):
    rng = np.random.default_rng(seed)
    device, share = random_device(rng), float(rng.choice([1.0, 0.3]))
    law = law_of(np.random.default_rng(seed), share)
    gains = Gains(0.0, float(rng.uniform(1e3, 1e5))) if seed % 3 else Gains(rng.uniform(0, 20), rng.uniform(1e3, 1e4))
    wall = (0.0, 5e3) if seed % 2 else (3.0, 5e3)
    expected, problem = scene_eigenvalues(device, law, gains, wall)
    frozen = frozen_law(problem, gains.damping_ns_per_m, gains.stiffness_n_per_m).pick(0)
    plants = Body.of(sampled_plant(device, HAND)).flat()
    # The share may stand in the innovation or beside it.
    whole = law_of(np.random.default_rng(seed))
    for built in (frozen.behind(law), frozen.behind(whole).at_slopes(dead_zone=share)):
        ours = np.linalg.eigvals(closed(plants, built).maps[0])
        ours, theirs = (np.sort_complex(values[np.abs(values) > 1e-3]) for values in (ours, expected))
        assert len(ours) == len(theirs)
        distance = np.abs(ours[:, None] - theirs)
        assert distance.min(axis=0).max() < 1e-6
        assert distance.min(axis=1).max() < 1e-6


def at(law, stiffness, frequency_hz, sample_time_s):
    whole = Law.gain(stiffness, sample_time_s).behind(law)
    return whole.transfer(np.exp(2j * np.pi * frequency_hz * sample_time_s))


@pytest.mark.parametrize("seed", first(range(3)))
def test_force_over_position_is_that_of_the_step_in_time(seed):
    law = believer(seed)
    step, hz, t = state_feedback_step(law), 30.0, 1e-3
    rng = np.random.default_rng(seed)
    state, asked = np.zeros(len(step.states)), 0.0
    state[0] = 1.0
    numbers = law.numbers()
    numbers[-len(law.zone_numbers) :] = 0.0
    ticks = np.arange(6000)
    position = np.sin(2 * np.pi * hz * ticks * t + rng.uniform(0, 6))
    forces = []
    for value in position:
        state, (seen,) = (part.full().ravel() for part in step.function(state, [value, asked], numbers))
        asked = 800.0 * seen
        forces.append(asked)
    last = slice(-2000, None)
    turn = np.exp(-2j * np.pi * hz * ticks[last] * t)
    expected = (np.array(forces)[last] @ turn) / (position[last] @ turn)
    np.testing.assert_allclose(at(law, 800.0, np.array([hz]), t)[0], expected, rtol=1e-6)


@pytest.mark.parametrize("seed", range(20))
def test_at_rest_the_wall_has_its_own_stiffness(seed):
    """A law believes in a hand of its own; what it renders at rest does not depend on it."""
    rng = np.random.default_rng(seed)
    device = random_device(rng)
    stiffness = float(np.exp(rng.uniform(np.log(300), np.log(2e4))))
    law = regulator(device, Hands(), stiffness, GUESSES[seed % 3])
    force = at(law, stiffness, np.array([1e-7 / device.sample_time_s]), device.sample_time_s)[0]
    assert force.real == pytest.approx(stiffness, rel=1e-3)


def feedback(problem, guess, slower=1.0):
    """The wall of a problem behind a regulator, its observer slowed."""
    law = regulator(problem.device, problem.hands, problem.environment.stiffness_n_per_m, GUESSES[guess])
    law = law.model_copy(update={"innovation": tuple(slower * np.array(law.innovation))})
    return Coupling.constant(problem, Gains(0.0, 1e8), "x", Runtime(state_feedback=law))


def radii(coupling, hands, shares, of_force):
    plants = Body.of(sampled_plant(coupling.problem.device, hands)).flat()
    law = law_at_rest(coupling)
    return np.array(
        [
            closed(plants, law.at_slopes(dead_zone=e, force_limit=f)).radius
            for e, f in zip(shares, of_force, strict=True)
        ]
    )


@pytest.mark.parametrize("seed", [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 8))])
def test_no_drawn_hand_and_share_is_worse_than_the_worst_that_is_found(seed):
    rng = np.random.default_rng(seed)
    name, wall = (("reference-r1", 4000.0), ("reference-r2", 2500.0), ("reference-r3", 1400.0))[seed % 3]
    problem = avc.load_problem(name).changed(environment={"stiffness_n_per_m": wall})
    made = feedback(problem, seed % 3, rng.uniform(0.8, 1.2))
    low, high = hand_ranges(problem.hands).T
    drawn = Hand(*(low + (high - low) * rng.random((500, 3))).T)
    found, slack = worst_case_behind_observer(made), 1e-6
    assert (
        radii(made, drawn, np.exp(rng.uniform(np.log(0.01), 0.0, 12)), np.ones(12)).max()
        <= found["dead-zone"].radius + slack
    )
    assert radii(made, drawn, [1.0], [1.0]).max() <= found["hands"].radius + slack
    clipped = radii(made, joined(drawn, released_hand()), np.ones(12), np.exp(rng.uniform(np.log(0.01), 0.0, 12)))
    assert clipped.max() <= found["clip"].radius + slack


def test_a_law_that_is_unstable_at_a_lower_gain_of_its_force_is_not_deployable():
    claims = avc.deployable(feedback(avc.load_problem("figure5"), 2, slower=0.3)).claims
    assert [one.name for one in claims if not one.passed] == ["clip"]


@pytest.mark.parametrize("name", ["reference-r1", "reference-r3"])
def test_a_law_begins_at_rest(name):
    law = feedback(avc.load_problem(name), 1).runtime.state_feedback
    begun = np.isin(np.arange(law.states), law.positions).astype(float)
    assert np.array(law.state) @ begun == pytest.approx(begun, abs=1e-6)
    assert np.array(law.feedback) @ begun > 0  # no force outside the wall
