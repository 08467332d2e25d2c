"""With no effects listed a scene holds all that the device declares; a list says what it leaves out."""

import numpy as np
import pytest
from scene_reference import Reference, scene_problem

import avc_casadi as avc
from avc_casadi.model.declared import declared_effects
from avc_casadi.model.gains import NO_COUPLING, Gains
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.scene import compile_for, simulate

HAND, WALL = 'kind = "hand"', 'kind = "wall"'
DEVICE = """
[device]
mass_kg = 0.1
damping_ns_per_m = 2.0
delay_samples = 1.25
coulomb_friction_n = 0.2
encoder_resolution_m = 2e-5
position_noise_rms_m = 1e-6
amplifier_bandwidth_hz = 500.0
amplifier_order = 2
max_force_n = 8.0
backlash_m = 1e-4
resonance = {{ frequency_hz = 150.0, damping_ratio = 0.05, mass_ratio = 0.5 }}
[environment]
damping_ns_per_m = {b_e}
stiffness_n_per_m = {k_e}
"""
ALL = {
    "hand",
    "wall",
    "resonance",
    "coulomb-friction",
    "backlash",
    "noise",
    "encoder",
    "delay",
    "saturation",
    "amplifier",
}
SOFT = {"b_e": 1.0, "k_e": 3e3}
QUICK = 'kind = "press"\nspeed_m_per_s = 0.2\nstart_m = -0.002\n'


@pytest.mark.thorough
def test_the_declared_device_agrees_with_an_independent_integration():
    listed = "\n[[scene.effects]]\n".join(("", *(f'kind = "{kind}"' for kind in sorted(ALL))))
    problem = scene_problem(head=DEVICE, **SOFT, scene="duration_s = 0.12\n", motion=QUICK)
    gains = Gains(2.0, 1.5e3)
    scene = compile_scene(problem)
    noise = dict(zip(scene.inputs, scene.input_values(), strict=True))["noise_m"]
    same = avc.parse_problem(avc.dump_problem(problem) + listed, name="listed")
    device = Reference(same, gains, scene.target.position_m, scene.target.device_start_m)
    reference = device.run(120, noise)
    run = simulate(problem, gains)
    assert reference[2].max() > 0.1
    for mine, other, size in zip(
        (run.position_m, run.velocity_m_per_s, run.force_n), reference, (1e-10, 1e-7, 1e-6), strict=True
    ):
        assert np.abs(mine - other).max() < size
    held = execute(
        compile_for(problem, build_effects(problem), gains), scene.parameter_values(gains), scene.input_values()
    )
    for name, other, size in zip(("held_m", "held_m_per_s"), device.handle, (1e-10, 1e-7), strict=True):
        assert np.ptp(other - reference[0 if name == "held_m" else 1]) > 0
        assert np.abs(held[name][0] - other).max() < size


def test_at_the_handle_the_encoder_sees_the_handle():
    device = {"encoder_at": "handle", "backlash_m": 0.0}
    problem = scene_problem(head=DEVICE, **SOFT).changed(device=device)
    (encoder,) = [effect for effect in build_effects(problem) if effect.kind == "encoder"]
    assert encoder.sensed_body == "handle"
    ideal = problem.changed(device={"encoder_resolution_m": 0.0})
    (encoder,) = [effect for effect in build_effects(ideal) if effect.kind == "encoder"]
    assert (encoder.sensed_body, encoder.resolution_m) == ("handle", 0.0)
    # Backlash lies before the handle.
    assert "backlash" not in {e.kind for e in declared_effects(problem.changed(device={"backlash_m": 1e-3}))}


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_projection_splits_the_sample_where_the_force_changes(share):
    effects = (HAND, WALL, 'kind = "coulomb-friction"', f'kind = "delay"\nsamples = {1 + share}')
    gains = Gains(10.0, 3e3)

    def run(integrator, substeps):
        scene = f'duration_s = 0.3\nintegrator = "{integrator}"\nsubsteps = {substeps}\n'
        # A moment of sticking that falls on a substep makes one error small by chance: not under this law.
        problem = scene_problem(effects, scene=scene, motion=QUICK, **SOFT).changed(coupling={"contact": "gated"})
        return simulate(problem, gains).position_m

    exact = run("exact", 1)
    coarse, fine = (np.abs(run("projected", n) - exact).max() for n in (1, 16))
    assert coarse < 2e-5
    assert fine < coarse / 4
    # Without friction both are exact, and substeps change nothing.
    free = tuple(effect for effect in effects if "friction" not in effect)
    one, four = (
        simulate(
            scene_problem(free, scene=f"duration_s = 0.3\nsubsteps = {n}\n", motion=QUICK, **SOFT), gains
        ).position_m
        for n in (1, 4)
    )
    np.testing.assert_allclose(one, four, rtol=0, atol=1e-13)


def test_a_delay_that_tends_to_whole_samples_tends_to_the_whole_delay():
    def run(samples):
        effects = (HAND, WALL, f'kind = "delay"\nsamples = {samples}')
        return simulate(
            scene_problem(effects, scene="duration_s = 0.2\n", motion=QUICK, **SOFT), Gains(10.0, 3e3)
        ).position_m

    whole = run(2)
    for near in (1.999, 2.001):
        assert 0 < np.abs(run(near) - whole).max() < 3e-6
    assert np.abs(run(1.5) - whole).max() > 1e-5


def test_play_holds_the_measured_position_until_it_is_taken_up():
    effects = (
        HAND,
        'kind = "environment"\nstiffness_n_per_m = 100.0\ndamping_ns_per_m = 0.0',
        'kind = "backlash"\ngap_m = 2e-3',
    )
    run = simulate(
        scene_problem(effects, scene="duration_s = 1.0\n", motion='kind = "free"\nstart_m = 0.0\n'), NO_COUPLING
    )
    seen = run.force_n / 100.0
    assert np.abs(run.position_m - seen).max() == pytest.approx(1e-3, rel=1e-9)
    moving = np.abs(np.diff(seen)) > 0
    assert 0.1 < moving.mean() < 0.9
    assert np.all(np.abs((run.position_m - seen)[1:][moving]) == pytest.approx(1e-3, rel=1e-9))
