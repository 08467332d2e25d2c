"""Adapted gains under a mean force: no sag while they follow a frequency, and the row's own stiffness at rest."""

import numpy as np
import pytest

import avc_casadi as avc
from avc_casadi.design.methods import solve
from avc_casadi.design.scene_coupling import simulate
from avc_casadi.files.problem_file import load_problem
from avc_casadi.model.gains import Gains, GainTable
from avc_casadi.simulation.run import Run
from avc_casadi.simulation.runtime.adaptation import AdaptationSettings, adaptation_step

ADAPTIVE = [{"kind": "estimator"}, {"kind": "adaptation"}]


def rocked(problem: avc.Problem, gains: Gains | GainTable) -> Run:
    """A hand presses into the wall and then moves to and fro at 8 Hz, without losing contact."""
    listed = [{"kind": kind} for kind in ("hand", "wall", "encoder", "coulomb-friction")]
    listed += [{"kind": "delay"}] if problem.device.delay_samples else []
    listed += ADAPTIVE if isinstance(gains, GainTable) else []
    motion = {"kind": "stroke", "frequency_hz": 8.0, "amplitude_m": 0.004, "end_m": 0.012}
    return simulate(problem.changed(scene={"effects": listed, "duration_s": 7.0, "motion": motion}), gains)


# A device with the delay of a real loop, and of a slow one.
CASES = {
    "ve3 late by a sample": ("ve3", {"delay_samples": 1}, "direct"),
    "ve3 late by two": ("ve3", {"delay_samples": 2}, "direct"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", CASES)
def test_a_preload_does_not_sag_while_the_hand_moves(name: str) -> None:
    """Mean depth and mean force are those of the row of rest; the row of 8 Hz alone gives way."""
    file, device, method = CASES[name]
    problem = load_problem(file).changed(device=device)
    table = GainTable.of(solve(problem, method))
    runs = [rocked(problem, gains) for gains in (table, table.at_rest, Gains(*table(8.0).tolist()))]
    assert runs[0].interaction_hz is not None
    late = slice(3500, 5500)
    assert np.nanmedian(runs[0].interaction_hz[late]) == pytest.approx(8.0, rel=0.02)
    assert np.median(runs[0].stiffness_n_per_m[late]) < 0.6 * table.rest_stiffness_n_per_m
    assert all(run.force_n[late].min() > 0 for run in runs)
    depth, rest, soft = (run.position_m[late].mean() for run in runs)
    assert soft > 1.03 * rest
    assert depth == pytest.approx(rest, rel=0.005)


def given_too_much(sample_time_s: float, damping: float) -> np.ndarray:
    """Move springs to ground while their gains jump at random; return what each gave beyond what it took, J.

    Its energies are drawn up beside the step: the held force, as it acts on the hand, and what the spring stores.
    """
    lanes, seconds = 100, 0.6
    rng = np.random.default_rng(7)
    step = adaptation_step(sample_time_s, AdaptationSettings(return_s=0.02, mean_s=0.05, tank_j=0.02))
    function = step.function.map(lanes)
    rest = 10.0 ** rng.uniform(3, 5, lanes)
    # Levels that last from 7 to 60 ms, and a motion of three sines either way of the anchor.
    lasting, levels = rng.integers(7, 60, lanes), 10.0 ** rng.uniform(2, 5, (100, lanes))
    hertz, phase = rng.uniform(0.5, 20, (3, lanes)), rng.uniform(0, 2 * np.pi, (3, lanes))
    state = np.zeros((len(step.states), lanes))
    x = force = taken = np.zeros(lanes)
    least, anchored = np.zeros(lanes), np.zeros(lanes)
    for tick in range(round(seconds / sample_time_s)):
        time = tick * sample_time_s
        moved = 3e-4 * (np.sin(2 * np.pi * hertz * time + phase) - np.sin(phase)).sum(axis=0)
        taken = taken + force * (moved - x)
        inputs = dict.fromkeys(step.inputs, np.zeros(lanes)) | {
            "wanted_stiffness_n_per_m": levels[np.floor(time / (1e-3 * lasting) + 1e-9).astype(int), np.arange(lanes)],
            "wanted_damping_ns_per_m": np.full(lanes, damping),
            "deflection_m": x,
            "held_force_n": force,
            "position_m": moved,
            "touching": np.ones(lanes),
            "rest_stiffness_n_per_m": rest,
        }
        following, outputs = function(state, np.array(list(inputs.values())), np.zeros((0, lanes)))
        state, found = following.full(), dict(zip(step.outputs, outputs.full(), strict=True))
        stretch = moved - found["anchor_m"]
        force = found["stiffness_n_per_m"] * stretch + damping * (moved - x) / sample_time_s
        x = moved
        least = np.minimum(least, taken - 0.5 * found["stiffness_n_per_m"] * stretch**2)
        anchored = np.maximum(anchored, np.abs(found["anchor_m"]))
    assert np.all(anchored > 1e-5)
    return -least


@pytest.mark.thorough
@pytest.mark.parametrize("damping", [0.0, 5.0])
def test_jumping_gains_create_no_more_than_the_hold_of_a_force(damping: float) -> None:
    """What is missing goes to nothing with the sample time, as it does for constant gains."""
    slow, fast = (given_too_much(sample_time_s, damping) for sample_time_s in (1e-3, 2e-4))
    assert slow.max() > 1e-4
    assert fast.max() < 0.25 * slow.max()
    assert np.median(fast) < 0.25 * np.median(slow)
