"""A stated law in scenes: its step beside a law that is written out sample by sample, and whole scenes beside SciPy."""

import numpy as np
import pytest
from quick import first
from scene_reference import Reference
from stated_law import StatedLaw, drawn_law, wandering

import avc_casadi as avc
from avc_casadi.files.problem_file import load_any
from avc_casadi.model.declared import with_law_alone
from avc_casadi.simulation.runtime.law import law_step

SAMPLES = 1500


def forces(step, positions):
    """The forces of a step at positions, one after the other."""
    state = list(step.initial)
    result = []
    for x in positions:
        after, out = step.function(state, [x], [])
        state = after.full().ravel()
        result.append(float(out))
    return np.array(result)


@pytest.mark.parametrize("seed", first(range(12)))
def test_the_step_gives_the_forces_of_the_law_that_is_written_out(seed):
    problem = load_any(drawn_law(seed))
    device = problem.device
    positions = wandering(seed, SAMPLES, device.encoder_resolution_m)
    start = float(positions[0])
    step = law_step(problem.law, device.sample_time_s, one_sided=problem.law_in_wall, start_m=start)
    written = StatedLaw(problem.law, device.sample_time_s, problem.law_in_wall, start)
    expected = np.array([written.force(x) for x in positions])
    assert np.abs(expected).max() > 0.01
    assert forces(step, positions) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3, 5, 8])
def test_a_scene_of_a_law_agrees_with_an_integration_by_other_means(seed):
    problem = with_law_alone(load_any(drawn_law(seed)).changed(scene={"duration_s": 0.6}))
    run = avc.simulate(problem)
    device = problem.device
    reference = Reference(problem, None, run.target_m, run.target_m[0])
    computer = StatedLaw(problem.law, device.sample_time_s, problem.law_in_wall, run.target_m[0])
    position, _, force = reference.run(run.samples, computer=computer)
    assert run.position_m == pytest.approx(position, abs=1e-7)
    assert np.abs(run.force_n - force).max() < 1e-3 * max(1.0, np.abs(force).max())


def test_a_problem_with_a_law_simulates_that():
    tables = drawn_law(1)
    run = avc.simulate(tables)
    assert run.coupling == "law"
    assert "law" in run.effects
    assert "wall" not in run.effects
    with pytest.raises(avc.InputError, match=r"\[law\] is missing"):
        avc.simulate(
            {
                "device": tables["device"],
                "environment": {"stiffness_n_per_m": 1.0, "damping_ns_per_m": 0.0},
                "scene": {"coupling": "none", "effects": [{"kind": "hand"}, {"kind": "law"}]},
            }
        )
