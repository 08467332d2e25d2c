"""Every effect, alone and together, against an independent integration whose events are located."""

import numpy as np
import pytest
from scene_cases import CASES, QUICK
from scene_reference import Reference, scene_problem

import avc_casadi as avc
from avc_casadi.design.scene_coupling import scene_coupling, simulate
from avc_casadi.model.gains import NO_COUPLING, Gains
from avc_casadi.simulation.compile import build_effects, compile_scene
from avc_casadi.simulation.execute import execute
from avc_casadi.simulation.scene import resolve


def both(problem, gains, samples):
    """Traces of the scene and of the reference, which draws nothing itself."""
    run = simulate(problem, gains)
    scene = compile_scene(problem, gains=gains)
    inputs = dict(zip(scene.inputs, scene.input_values(), strict=True))
    reference = Reference(problem, gains, scene.target.position_m, scene.target.device_start_m).run(
        samples, inputs.get("noise_m"), inputs.get("late_share"), inputs.get("dropped")
    )
    return np.array([run.position_m, run.velocity_m_per_s, run.force_n])[:, :samples], reference


def one_sided(case):
    """Whether the contact law has something to act on."""
    effects, gains = CASES[case]
    return gains.stiffness_n_per_m > 0 and any('"wall"' in effect for effect in effects)


LAWS = [(case, "gated") for case in CASES] + [(case, "clip-last") for case in filter(one_sided, CASES)]


@pytest.mark.slow
@pytest.mark.parametrize(("case", "contact"), LAWS[::2])
def test_effects_agree_with_an_event_accurate_integration(case, contact):
    effects, gains = CASES[case]
    problem = scene_problem(effects, scene="duration_s = 0.12\n", motion=QUICK).changed(coupling={"contact": contact})
    ours, reference = both(problem, gains, 120)
    assert np.all(np.ptp(reference[:2], axis=1) > 0)
    if gains.stiffness_n_per_m and "wall" in str(effects):
        assert reference[2].max() > 0.1
    for name, mine, other, size in zip("xvF", ours, reference, (1e-13, 1e-10, 1e-8), strict=True):
        assert np.abs(mine - other).max() < size, name


SCENES = [entry.name for entry in avc.catalogue() if entry.name.startswith("scenes/")]
# Without a coupling the loop is unstable: what rounding differs grows by 40 % a sample.
SAMPLES = {"scenes/stiff-wall-uncoupled": 170}


# Found once by its tuning, which takes seconds.
GIVEN = {"scenes/stiff-wall-tuned": Gains(0.0056, 5.1e5, 67.5)}
# What these compute has tests of its own; here their forces are replayed.
LEARNING = {"estimator", "adaptation", "guard", "observer"}


def replayed(problem, samples):
    """Traces of a scene, and the reference moved by the forces of the scene's computer."""
    run = simulate(problem)
    target = compile_scene(problem).target
    reference = Reference(problem, NO_COUPLING, target.position_m, target.device_start_m)
    ours = np.array([run.position_m, run.velocity_m_per_s, run.force_n])[:, :samples]
    return ours, reference.run(samples, commands=run.force_n)


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES[::2])
def test_catalogue_scenes_agree_with_an_event_accurate_integration(name):
    problem = avc.load_problem(name)
    samples = SAMPLES.get(name, 300)
    if LEARNING & {effect.kind for effect in problem.scene.effects}:
        ours, reference = replayed(problem, samples)
    else:
        gains = GIVEN.get(name) or resolve(problem, build_effects(problem), scene_coupling(problem))[1]
        ours, reference = both(problem, gains, samples)
    assert np.ptp(reference[0]) > 1e-5
    for trace, mine, other, size in zip("xvF", ours, reference, (1e-13, 1e-10, 1e-8), strict=True):
        assert np.abs(mine - other).max() < size, trace


# The energy ledger: what a held force passes, what springs hold, what sampling creates.

FREE = """
[device]
mass_kg = 0.1
damping_ns_per_m = {b_d}
[environment]
damping_ns_per_m = {{b_e}}
stiffness_n_per_m = {{k_e}}
"""
SPRING = ['kind = "environment"\nstiffness_n_per_m = 900.0\ndamping_ns_per_m = 0.0']
RELEASED = 'kind = "hold"\nend_m = -0.002\n'


def test_a_held_spring_creates_half_k_dx_squared_at_every_step():
    run = simulate(scene_problem(SPRING, motion=RELEASED), NO_COUPLING)
    step = np.diff(run.position_m)
    created = np.diff(run.ledger.stored_j) - np.diff(run.ledger.absorbed_j)
    assert created.max() > 1e-9
    np.testing.assert_allclose(created, 900.0 * step**2 / 2, rtol=1e-9, atol=1e-16)
    np.testing.assert_allclose(-np.diff(run.ledger.dissipated_j), created, rtol=1e-9, atol=1e-16)


def test_the_energy_that_passes_is_the_kinetic_energy_of_an_undamped_device():
    problem = scene_problem(SPRING, motion=RELEASED, head=FREE.format(b_d=0.0), scene="duration_s = 0.5\n")
    run = simulate(problem, NO_COUPLING)
    kinetic = 0.05 * run.velocity_m_per_s**2
    assert kinetic.max() > 1e-4
    np.testing.assert_allclose(-run.ledger.absorbed_j, kinetic, rtol=1e-10, atol=1e-14)


# Dry friction against what mechanics says on paper: stopping distances, true rest, breaking away, many changes.

HEAD = """
[device]
mass_kg = {mass}
damping_ns_per_m = 0.0
[environment]
damping_ns_per_m = 0.0
stiffness_n_per_m = 1.0
"""
FRICTION_SPRING = 'kind = "hand"\nmass_kg = 0.0\ndamping_ns_per_m = 0.0\nstiffness_n_per_m = {k}'
FRICTION_FRICTION = 'kind = "coulomb-friction"\nforce_n = {force}'


def released(k, force, *, mass=0.2, offset=-0.01, duration=2.0, substeps=1):
    """A mass on a spring with dry friction, released away from the spring's rest (the target of the hand)."""
    motion = f'kind = "press"\nstart_m = -0.02\nend_m = {-0.02 - offset}\nspeed_m_per_s = 100.0\n'
    scene = f"duration_s = {duration}\nsubsteps = {substeps}\n"
    effects = (FRICTION_SPRING.format(k=k), FRICTION_FRICTION.format(force=force))
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
    effects = (FRICTION_SPRING.format(k=200.0), FRICTION_FRICTION.format(force=0.8))
    run = simulate(scene_problem(effects, motion=motion, head=HEAD.format(mass=0.2)), NO_COUPLING)
    first = np.flatnonzero(run.velocity_m_per_s)[0]
    # 200 N/m stretched at 0.01 m/s reaches 0.8 N after 0.4 s.
    assert run.time_s[first] == pytest.approx(0.4, abs=2e-3)


@pytest.mark.slow
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
    effects = (FRICTION_SPRING.format(k=k), FRICTION_FRICTION.format(force=force))
    problem = scene_problem(effects, scene="duration_s = 0.06\n", motion=motion, head=HEAD.format(mass=mass))
    run = simulate(problem, NO_COUPLING)
    target = compile_scene(problem).target
    reference = Reference(problem, NO_COUPLING, target.position_m, target.device_start_m)
    position, velocity, _ = reference.run(len(run.position_m))
    np.testing.assert_allclose(run.position_m, position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.velocity_m_per_s, velocity, rtol=0, atol=1e-8)


# With no effects listed a scene holds all that the device declares; a list says what it leaves out.

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
SLOW_PRESS = 'kind = "press"\nspeed_m_per_s = 0.2\nstart_m = -0.002\n'


@pytest.mark.slow
def test_the_declared_device_agrees_with_an_independent_integration():
    listed = "\n[[scene.effects]]\n".join(("", *(f'kind = "{kind}"' for kind in sorted(ALL))))
    problem = scene_problem(head=DEVICE, **SOFT, scene="duration_s = 0.12\n", motion=SLOW_PRESS)
    gains = Gains(2.0, 1.5e3)
    scene = compile_scene(problem, gains=gains)
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
        compile_scene(problem, build_effects(problem), gains), scene.parameter_values(gains), scene.input_values()
    )
    for name, other, size in zip(("handle_m", "handle_m_per_s"), device.handle, (1e-10, 1e-7), strict=True):
        assert np.ptp(other - reference[0 if name == "handle_m" else 1]) > 0
        assert np.abs(held[name][0] - other).max() < size


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_projection_splits_the_sample_where_the_force_changes(share):
    effects = (HAND, WALL, 'kind = "coulomb-friction"', f'kind = "delay"\nsamples = {1 + share}')
    gains = Gains(10.0, 3e3)

    def run(integrator, substeps):
        scene = f'duration_s = 0.3\nintegrator = "{integrator}"\nsubsteps = {substeps}\n'
        # A moment of sticking that falls on a substep makes one error small by chance: not under this law.
        problem = scene_problem(effects, scene=scene, motion=SLOW_PRESS, **SOFT).changed(coupling={"contact": "gated"})
        return simulate(problem, gains).position_m

    exact = run("exact", 1)
    coarse, fine = (np.abs(run("projected", n) - exact).max() for n in (1, 16))
    assert coarse < 2e-5
    assert fine < coarse / 4
    # Without friction both are exact, and substeps change nothing.
    free = tuple(effect for effect in effects if "friction" not in effect)
    one, four = (
        simulate(
            scene_problem(free, scene=f"duration_s = 0.3\nsubsteps = {n}\n", motion=SLOW_PRESS, **SOFT), gains
        ).position_m
        for n in (1, 4)
    )
    np.testing.assert_allclose(one, four, rtol=0, atol=1e-13)
