"""Every effect, alone and together, against an independent integration whose events are located."""

import numpy as np
import pytest
from scene_cases import CASES, QUICK
from scene_reference import Reference, scene_problem

import avc_casadi as avc
from avc_casadi.design.scene_coupling import scene_coupling, simulate
from avc_casadi.model.gains import NO_COUPLING, Gains
from avc_casadi.simulation.compile import compile_scene
from avc_casadi.simulation.effects.registry import build_effects
from avc_casadi.simulation.scene import settled


def both(problem, gains, samples):
    """Traces of the scene and of the reference, which draws nothing itself."""
    run = simulate(problem, gains)
    scene = compile_scene(problem, coupled=not gains.rigid)
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


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize(("case", "contact"), LAWS)
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


@pytest.mark.thorough
@pytest.mark.one_of(2)
@pytest.mark.parametrize("name", SCENES)
def test_catalogue_scenes_agree_with_an_event_accurate_integration(name):
    problem = avc.load_problem(name)
    samples = SAMPLES.get(name, 300)
    if LEARNING & {effect.kind for effect in problem.scene.effects}:
        ours, reference = replayed(problem, samples)
    else:
        gains = GIVEN.get(name) or settled(problem, build_effects(problem), scene_coupling(problem))[1]
        ours, reference = both(problem, gains, samples)
    assert np.ptp(reference[0]) > 1e-5
    for trace, mine, other, size in zip("xvF", ours, reference, (1e-13, 1e-10, 1e-8), strict=True):
        assert np.abs(mine - other).max() < size, trace
