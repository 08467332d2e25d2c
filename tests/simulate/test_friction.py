"""Dry friction against what mechanics says on paper: stopping distances, true rest, breaking away, many changes."""

import numpy as np
import pytest
from scene_reference import Reference, scene_problem

from avc_casadi.design.scene_coupling import simulate
from avc_casadi.model.gains import NO_COUPLING
from avc_casadi.simulation.compile import compile_scene

HEAD = """
[device]
mass_kg = {mass}
damping_ns_per_m = 0.0
[environment]
damping_ns_per_m = 0.0
stiffness_n_per_m = 1.0
"""
SPRING = 'kind = "hand"\nmass_kg = 0.0\ndamping_ns_per_m = 0.0\nstiffness_n_per_m = {k}'
FRICTION = 'kind = "coulomb-friction"\nforce_n = {force}'


def released(k, force, *, mass=0.2, offset=-0.01, duration=2.0, substeps=1):
    """A mass on a spring with dry friction, released away from the spring's rest (the target of the hand)."""
    motion = f'kind = "press"\nstart_m = -0.02\nend_m = {-0.02 - offset}\nspeed_m_per_s = 100.0\n'
    scene = f"duration_s = {duration}\nsubsteps = {substeps}\n"
    effects = (SPRING.format(k=k), FRICTION.format(force=force))
    return simulate(scene_problem(effects, scene=scene, motion=motion, head=HEAD.format(mass=mass)), NO_COUPLING)


@pytest.mark.parametrize(("k", "force"), [(300.0, 0.4), (2000.0, 1.0), (80.0, 0.05), (300.0, 2.9)])
def test_each_half_swing_loses_twice_the_friction_over_the_stiffness(k, force):
    run = released(k, force)
    deflection = run.position_m - run.target_m[-1]
    expected, swings = [abs(run.position_m[0] - run.target_m[-1])], 0
    while expected[-1] > force / k:
        expected.append(abs(expected[-1] - 2 * force / k))
        swings += 1
    assert swings > 0
    # The first sample moves the target over; what is left is exact.
    assert abs(deflection[-1]) == pytest.approx(expected[-1], abs=2e-3 * expected[0])
    tail = run.position_m[-50:]
    assert np.ptp(tail) == 0
    assert not run.velocity_m_per_s[-50:].any()


def test_a_load_below_the_friction_moves_nothing_at_all():
    run = released(100.0, 1.1)
    assert np.ptp(run.position_m) == 0
    assert not run.velocity_m_per_s.any()


def test_it_breaks_away_when_the_load_exceeds_the_friction():
    motion = 'kind = "press"\nstart_m = -0.02\nend_m = -0.01\nspeed_m_per_s = 0.01\n'
    effects = (SPRING.format(k=200.0), FRICTION.format(force=0.8))
    run = simulate(scene_problem(effects, motion=motion, head=HEAD.format(mass=0.2)), NO_COUPLING)
    first = np.flatnonzero(run.velocity_m_per_s)[0]
    # 200 N/m stretched at 0.01 m/s reaches 0.8 N after 0.4 s.
    assert run.time_s[first] == pytest.approx(0.4, abs=2e-3)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("mass", "k", "force", "frequency_hz"),
    [
        (0.005, 28851.0, 8.788, 159.0),
        (0.005, 11014.0, 5.845, 218.0),
        (0.02, 110679.0, 32.18, 151.0),
        # Here the velocity, or what friction can still hold, dips below 0 between two samples that tell nothing of it.
        (0.005, 40538.99341275645, 4.125698169283224, 200.67311840140897),
    ],
)
def test_it_stops_and_breaks_away_again_within_one_sample(mass, k, force, frequency_hz):
    """A fast target pulls the mass loose in the sample in which it came to rest: as scipy finds both events."""
    motion = f'kind = "free"\nstart_m = -0.02\namplitude_m = 0.001\nfrequency_hz = {frequency_hz}\n'
    effects = (SPRING.format(k=k), FRICTION.format(force=force))
    problem = scene_problem(effects, scene="duration_s = 0.06\n", motion=motion, head=HEAD.format(mass=mass))
    run = simulate(problem, NO_COUPLING)
    target = compile_scene(problem).target
    reference = Reference(problem, NO_COUPLING, target.position_m, target.device_start_m)
    position, velocity, _ = reference.run(len(run.position_m))
    np.testing.assert_allclose(run.position_m, position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.velocity_m_per_s, velocity, rtol=0, atol=1e-8)
